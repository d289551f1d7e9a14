//! A small case, and kinds that feed requests and poses.

#![allow(clippy::unwrap_used, dead_code)]

use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, Stage, StepError, Timer};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, CaseParts, Mask, Prescription, Role as Is, Structure, to_bytes};
use stillpoint_samples::{ConsoleCommand, PlanRequest, PlanRequestElement, Pose, PoseElement, Sample};

/// A cylinder of water with a ball in its middle as target and a rod beside it to spare.
pub fn case() -> Case {
    let (counts, spacing) = ([20, 20, 14], 8.0);
    let origin_mm = counts.map(|n| -0.5 * spacing * (n as f64 - 1.0));
    let grid = Grid { counts, spacing_mm: [spacing; 3], origin_mm };
    let mask = |inside: &dyn Fn([f64; 3]) -> bool| {
        Mask::from_fn(grid.len(), |i| inside(grid.centre_mm(grid.voxel(i))))
    };
    let body = mask(&|[x, y, _]| x.hypot(y) < 72.0);
    let target = mask(&|[x, y, z]| x.hypot(y).hypot(z) < 22.0);
    let rod = mask(&|[x, y, _]| (x - 5.0).hypot(y - 42.0) < 14.0);
    let hu = (0..grid.len()).map(|i| if body.contains(i) { 0 } else { -1000 }).collect();
    let structure = |name: &str, role, mask| Structure { name: name.into(), role, mask };
    Case::new(CaseParts {
        name: "small".into(),
        grid,
        hu,
        structures: vec![
            structure("Body", Is::External, body),
            structure("PTV", Is::Target, target),
            structure("Rectum", Is::Organ, rod),
        ],
        isocentre_mm: None,
        prescription: vec![Prescription { structure: "PTV".into(), dose_gy: 60.0 }],
        fractions: None,
        reference_dose_gy: None,
        uids: None,
        provenance: "a test".into(),
    })
    .unwrap()
}

/// The content hash of the case as requests have it.
pub fn hash() -> [u64; 4] {
    let bytes = to_bytes(&case()).unwrap().1.0;
    [0, 8, 16, 24].map(|at| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()))
}

pub fn files() -> MemoryFiles {
    MemoryFiles { files: [("small.case".to_owned(), to_bytes(&case()).unwrap().0)].into() }
}

/// A request for five beams in a set-up with this shift, mm.
pub fn request(shift_mm: [f64; 3]) -> PlanRequestElement {
    PlanRequestElement {
        position: shift_mm.map(|mm| mm * 1e-3),
        orientation: [1.0, 0.0, 0.0, 0.0],
        case_hash: hash(),
        beams: 5,
        budget: 8,
    }
}

/// Requests that a bench feeds.
pub struct Requests;

impl Operator for Requests {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.requests",
        about: "Requests that a bench feeds.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            Output { name: "out", sample: PlanRequest::KIND, frame: FrameRule::None, about: "Requests." },
            Output {
                name: "accept",
                sample: ConsoleCommand::KIND,
                frame: FrameRule::None,
                about: "What a person accepts.",
            },
        ],
        timer: Timer::Optional,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}

/// Poses of a patient who moves by 9 mm after two seconds.
pub struct Poses;

impl Operator for Poses {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.poses",
        about: "Poses of a patient who moves.",
        role: Role::Source,
        inputs: &[],
        outputs: &[Output { name: "out", sample: Pose::KIND, frame: FrameRule::Key, about: "Poses." }],
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let x = if activation.tick < 20 { 0.1 } else { 0.109 };
        let pose =
            PoseElement { position: [x, 0.2, 0.3], orientation: [1.0, 0.0, 0.0, 0.0], covariance: [0.0; 36] };
        outputs.send::<Pose>(0, &pose)
    }
}

/// The operators of the crate, and those of this file.
pub fn stages() -> Vec<Stage> {
    [stillpoint_planner::STAGES, &[Stage::of::<Requests>(), Stage::of::<Poses>()]].concat()
}
