//! `ingest.merge`: the clouds of two to four cameras become one.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_pose::extrinsic::{Extrinsic, ExtrinsicParams};
use stillpoint_samples::{Health, PointCloud, Sample, SensorHealth};
use zerocopy::{FromBytes, IntoBytes};

use super::points::send_cloud;
use crate::merge::{CAMERAS, Merge, MergeRules, MergedCamera, Part, Placement};

/// The frame in whose axes the region is.
const COUCH: &str = "couch";
const CLOUD: usize = 0;
const HEALTH: usize = 1;
const NAMES: [&str; CAMERAS] = ["first", "second", "third", "fourth"];

/// Parameters of `ingest.merge`.
#[derive(Clone, Debug, Params)]
pub struct MergeParams {
    /// A camera whose newest cloud was acquired longer than this before the newest of all is late, and left out: one and
    /// a half periods of cameras that are not triggered together.
    #[param(unit = "ns", default = "150 ms", min = "1 ms", max = "1 s")]
    pub max_age: u64,
    /// A cloud with fewer points in the region is that of a blocked camera, and left out.
    #[param(default = 2000, min = 1, max = 16777216)]
    pub min_points: u32,
    /// Middle of the region of which points are taken, in the axes of the frame `couch`. A gantry in front of a camera is
    /// outside of it.
    #[param(unit = "m", default = "[0 mm, 0 mm, 150 mm]", min = "-3 m", max = "3 m")]
    pub at: [f64; 3],
    /// Half of each side of the region. It has to hold the couch around the head, and the shoulders.
    #[param(unit = "m", default = "[400 mm, 500 mm, 200 mm]", min = "10 mm", max = "3 m")]
    pub half: [f64; 3],
    /// Conditions under which the place of a camera is valid. The frames are those between the camera and `couch`. A
    /// camera whose place was measured too long ago is left out.
    pub extrinsic: ExtrinsicParams,
    /// Largest number of points of the merged cloud. Of more, points that are evenly spread over their order are sent.
    #[param(default = 307200, min = 100, max = 4194304)]
    pub max_points: u32,
}

/// Merges the newest clouds of its cameras, and reports which of them take part.
///
/// The merged cloud is not organised. What follows looks at a cloud from the origin of its frame: so its `frame:` has
/// to be one over the head.
pub struct IngestMerge {
    merge: Merge,
    /// The connected input of each camera, and whether its place can be trusted.
    cameras: Vec<(usize, Extrinsic)>,
    max_points: usize,
    /// The parts that the log has.
    logged: Vec<Part>,
    /// Whether the last cloud had more points than are sent.
    is_thinned: bool,
}

const fn camera(port: usize, required: bool, about: &'static str) -> Input {
    Input { name: NAMES[port], sample: PointCloud::KIND, policy: Policy::Queue(2), required, about }
}

impl Operator for IngestMerge {
    type Params = MergeParams;
    const KIND: Kind = Kind {
        name: "ingest.merge",
        about: "Merges the clouds of two to four cameras into one, without cameras that are blocked, late or frozen.",
        role: Role::Operator,
        inputs: &[
            camera(0, true, "The clouds of a camera, in a frame that is placed on `couch`."),
            camera(1, true, "The clouds of another camera."),
            camera(2, false, "The clouds of a third camera."),
            camera(3, false, "The clouds of a fourth camera."),
        ],
        outputs: &[
            Output {
                name: "cloud",
                sample: PointCloud::KIND,
                frame: FrameRule::Key,
                about: "The merged cloud, not organised, in a frame over the head. Its acquisition is that of the oldest cloud in it. Empty if no camera takes part.",
            },
            Output {
                name: "health",
                sample: Health::KIND,
                frame: FrameRule::None,
                about: "With each merged cloud: which cameras take part, and why the others do not (waiting, late, blocked, frozen, old extrinsic).",
            },
        ],
        timer: Timer::No,
    };

    fn new(params: MergeParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let output = setup.output_frames.first().and_then(Option::as_deref).unwrap_or_default();
        let merged_from_couch = stillpoint_pose::of_frame(&placed(setup, output, COUCH)?);
        let rules = MergeRules {
            max_age: params.max_age,
            min_points: params.min_points as usize,
            at: params.at,
            half: params.half,
        };
        let (eye, top) = (merged_from_couch.inverse().translation.vector.z, rules.at[2] + rules.half[2]);
        if eye <= top {
            return Err(SetupError(format!(
                "a cloud is looked at from the origin of its frame, and `{output}` is {} mm over the couch, within or \
                 below the region: write `frame:` with a frame that is more than {} mm over it",
                mm(eye),
                mm(top)
            )));
        }
        let (mut placements, mut cameras, mut seen) = (Vec::new(), Vec::new(), Vec::<&str>::new());
        for (port, name) in NAMES.iter().enumerate().filter(|(port, _)| setup.is_connected(*port)) {
            let frame = setup.input_frames.get(port).and_then(Option::as_deref).unwrap_or_default();
            if seen.contains(&frame) {
                return Err(SetupError(format!(
                    "two of its clouds are in the frame `{frame}`: give each camera a frame of its own"
                )));
            }
            seen.push(frame);
            let couch_from_camera = stillpoint_pose::of_frame(&placed(setup, COUCH, frame)?);
            placements.push(Placement { couch_from_camera, merged_from_couch });
            cameras.push((port, extrinsic(&params.extrinsic, name, frame, setup)?));
        }
        let logged = vec![Part::Used; cameras.len()];
        Ok(Self {
            merge: Merge::new(rules, &placements),
            cameras,
            max_points: params.max_points as usize,
            logged,
            is_thinned: false,
        })
    }

    fn capacities(params: &MergeParams) -> Vec<usize> {
        vec![params.max_points as usize, CAMERAS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let mut is_ready = false;
        for (camera, (port, _)) in self.cameras.iter().enumerate() {
            let Some(cloud) = activation.fresh::<PointCloud>(*port) else { continue };
            let points = <[[f32; 3]]>::ref_from_bytes(cloud.elements.as_bytes())
                .map_err(|e| StepError(format!("the cloud's points cannot be read in place: {e}")))?;
            // A camera whose clock is ahead makes the others no older.
            is_ready |= self.merge.take(camera, points, cloud.header.origin.min(activation.time));
        }
        if !is_ready {
            return Ok(());
        }
        let time = activation.time;
        let cameras = &self.cameras;
        let origin =
            self.merge.close(time, |k| cameras.get(k).is_some_and(|(_, place)| place.is_valid(time)));
        self.log();
        outputs.acquired_at(origin);
        let is_thinned = self.send(outputs)?;
        if !std::mem::replace(&mut self.is_thinned, is_thinned) && is_thinned {
            tracing::warn!(
                "a merged cloud has more than {} points, and some are left out: how much of the head is seen looks less; \
                 raise `max_points`",
                self.max_points
            );
        }
        outputs.send_slice::<Health>(HEALTH, &(), &self.health(time))
    }
}

impl IngestMerge {
    /// Sends the points of the cameras that take part, and says whether some had no room.
    fn send(&self, outputs: &mut Outputs<'_>) -> Result<bool, StepError> {
        let found: usize = self.merge.points().map(<[_]>::len).sum();
        let count = found.min(self.max_points);
        send_cloud(outputs, CLOUD, count, 1, |slots| {
            let mut slots = slots.iter_mut().enumerate().peekable();
            for (place, point) in self.merge.points().flatten().enumerate() {
                if slots.peek().is_some_and(|(k, _)| k * found / count == place)
                    && let Some((_, slot)) = slots.next()
                {
                    *slot = *point;
                }
            }
            Ok(())
        })?;
        Ok(count < found)
    }

    fn health(&self, time: u64) -> Vec<SensorHealth> {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let entry = |((port, _), camera): (&(usize, Extrinsic), &MergedCamera)| {
            let [used, left_out] = camera.counts();
            SensorHealth {
                age: camera.origin().map_or(f64::NAN, |origin| seconds(time.saturating_sub(origin))),
                since: seconds(time.saturating_sub(camera.since())),
                distance: f64::NAN,
                used,
                left_out,
                name: SensorHealth::field(NAMES[*port]),
                reason: SensorHealth::field(camera.part().name()),
            }
        };
        self.cameras.iter().zip(self.merge.cameras()).map(entry).collect()
    }

    /// Logs a camera that is left out, and that it takes part again.
    fn log(&mut self) {
        let cameras = self.cameras.iter().zip(self.merge.cameras());
        for (((port, _), camera), logged) in cameras.zip(&mut self.logged) {
            let part = camera.part();
            match (std::mem::replace(logged, part) == part, part) {
                (true, _) => {}
                (false, Part::Used) => tracing::info!("the {} camera takes part", NAMES[*port]),
                (false, part) => {
                    tracing::warn!("the {} camera is left out: {}", NAMES[*port], part.name());
                }
            }
        }
    }
}

/// The transform between two frames.
fn placed(setup: &Setup<'_>, to: &str, from: &str) -> Result<stillpoint_operator::frames::Rigid, SetupError> {
    let frame = if to == COUCH { from } else { to };
    setup.transform(to, from).ok_or_else(|| {
        SetupError(format!("place the frame `{frame}` in `frames` so that it is connected to `{COUCH}`"))
    })
}

/// The extrinsic of a camera: of the frames between its own and the couch.
fn extrinsic(
    params: &ExtrinsicParams,
    input: &str,
    frame: &str,
    setup: &Setup<'_>,
) -> Result<Extrinsic, SetupError> {
    let path = || setup.frames.between(frame, COUCH).into_iter().map(str::to_owned).collect();
    let frames = params.frames.clone().unwrap_or_else(path);
    let params = ExtrinsicParams { frames: Some(frames), ..params.clone() };
    let found = Extrinsic::of(&params, setup.frames, Some(COUCH)).map_err(|e| SetupError(e.to_string()))?;
    match found.fault() {
        None => Ok(found),
        Some(fault) => Err(SetupError(format!(
            "the camera of `{input}` cannot be merged, because {fault}: say in `frames` when and how well it was \
             measured, or say `extrinsic: {{ need: waived }}`"
        ))),
    }
}

fn mm(metres: f64) -> f64 {
    (metres * 1e6).round() / 1e3
}
