//! `rig.patient`: a camera over a drawn patient. The head of the patient moves as the head of a rig does.

use nalgebra::{Isometry3, Translation3};
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_rig::noise::{DEPTH_UNIT_M, NoiseModel};
use stillpoint_rig::patient::PatientError;
use stillpoint_rig::patient::worn::Mask;
use stillpoint_rig::render::Renderer;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_samples::{DepthImage, FarEnd, Intrinsics, Pose, PoseElement, Sample};

use crate::observed::isometry;

use super::scene::{Case, Event};

const TRUTH: usize = 0;
const FAR: usize = 1;
const DEPTH: usize = 0;
const TRUE_POSE: usize = 1;

/// Latest time of the event after the first tick, s.
pub const LATEST: f64 = 9.0;
/// The same in a scene without a head, s.
const LATEST_EMPTY: f64 = 2.0;
/// Number of pixels of the largest image.
const MOST: usize = 640 * 480;

/// Entry of `rig.patient` in the list of kinds.
pub const STAGE: Stage = Stage::of::<PatientCamera>();

/// Parameters of `rig.patient`.
#[derive(Clone, Debug, Params)]
pub struct PatientParams {
    /// Number of the scene.
    pub number: u64,
    /// Time from one image to the next: a multiple of `every`.
    #[param(unit = "ns", default = "100 ms", min = "1 ms", max = "10 s")]
    pub period: u64,
}

/// The camera and the scene that it shows.
pub struct PatientCamera {
    case: Case,
    renderer: Renderer,
    sensor: DepthSensor,
    intrinsics: Intrinsics,
    mask: Option<Mask>,
    period: u64,
    /// Time of the first tick, ns, and pose of the rig's head at that time.
    begin: Option<(u64, Isometry3<f64>)>,
    /// Number of the next image.
    next: u64,
    /// Time of the event after the first tick, s. `None` until the beam is on.
    event_at: Option<f64>,
    happened: bool,
    /// The last image, which a frozen camera repeats.
    retained: Vec<u16>,
}

impl PatientCamera {
    fn build(params: &PatientParams) -> Result<Self, PatientError> {
        let case = Case::of(params.number)?;
        let p = &case.patient;
        let pinhole = p.kind.pinhole()?;
        let head = case.worn.on_head(p.scale)?;
        let mask = match case.is_masked {
            true => Some(Mask::new(pinhole, &p.couch_from_camera, p.scale, &p.couch_from_head)?),
            false => None,
        };
        let [width, height] = p.kind.size.map(|s| s as u32);
        Ok(Self {
            renderer: Renderer::new(pinhole, &p.couch_from_camera, &p.scene, head)?,
            sensor: DepthSensor::new(&pinhole, NoiseModel::new((p.kind.noise)())?),
            intrinsics: Intrinsics {
                fx: p.kind.focal,
                fy: p.kind.focal,
                cx: pinhole.cx(),
                cy: pinhole.cy(),
                depth_unit: DEPTH_UNIT_M,
                width,
                height,
                reserved: 0,
                length: width * height,
            },
            mask,
            case,
            period: params.period,
            begin: None,
            next: 0,
            event_at: None,
            happened: false,
            retained: Vec::new(),
        })
    }

    /// Begins the event, and adds its objects to the scene.
    fn happen(&mut self) -> Result<(), PatientError> {
        self.happened = true;
        let things = self.case.comes()?;
        if !things.is_empty() {
            let p = &self.case.patient;
            let mut scene = p.scene.clone();
            scene.add(things);
            let head = self.case.worn.on_head(p.scale)?;
            self.renderer = Renderer::new(*self.renderer.camera(), &p.couch_from_camera, &scene, head)?;
        }
        Ok(())
    }

    fn image(
        &mut self,
        pose: &Isometry3<f64>,
        activation: &Activation<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        let event = if self.happened { self.case.event } else { Event::Nothing };
        if event == Event::Silent {
            return Ok(());
        }
        let pixels = self.intrinsics.length as usize;
        let mut image = outputs.open::<DepthImage>(DEPTH, pixels)?;
        *image.body() = self.intrinsics;
        match event {
            Event::Blind => image.elements().fill(0),
            Event::Frozen if self.retained.len() == pixels => {
                image.elements().copy_from_slice(&self.retained)
            }
            _ => {
                let view = self.renderer.render(pose).map_err(failure)?;
                let mut random = activation.random();
                match &self.mask {
                    None => self.sensor.sense(view, &mut random, image.elements()).map_err(failure)?,
                    Some(mask) => {
                        let mut view = view.clone();
                        mask.cover(&mut view);
                        self.sensor.sense(&view, &mut random, image.elements()).map_err(failure)?;
                    }
                }
                self.retained.clear();
                self.retained.extend_from_slice(image.elements());
            }
        }
        image.finish(pixels)
    }
}

impl Operator for PatientCamera {
    type Params = PatientParams;
    const KIND: Kind = Kind {
        name: "rig.patient",
        about: "A camera over a drawn patient, whose head moves as that of a rig.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "truth",
                sample: Pose::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The true pose of the rig's head.",
            },
            Input {
                name: "far",
                sample: FarEnd::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The beam at the far end: the event of the scene comes after it is on.",
            },
        ],
        outputs: &[
            Output {
                name: "depth",
                sample: DepthImage::KIND,
                frame: FrameRule::Key,
                about: "The depth image.",
            },
            Output {
                name: "truth",
                sample: Pose::KIND,
                frame: FrameRule::Named("couch"),
                about: "The patient's true pose at each tick, couch_from_head.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: PatientParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Self::build(&params).map_err(|e| SetupError(e.to_string()))
    }

    fn capacities(_: &PatientParams) -> Vec<usize> {
        vec![MOST, 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let truth = activation.input::<Pose>(TRUTH);
        let Some(rig) = truth.as_ref().and_then(|t| t.first()).map(isometry) else { return Ok(()) };
        let (begin, first) = *self.begin.get_or_insert((activation.time, rig));
        let elapsed = activation.time.saturating_sub(begin);
        let seconds = elapsed as f64 * 1e-9;
        let is_on = activation.input::<FarEnd>(FAR).is_some_and(|f| f.first().is_some_and(|f| f.beam == 1));
        if self.event_at.is_none() && is_on {
            self.event_at = Some(seconds + self.case.wait);
        }
        let latest = if self.case.patient.has_head() { LATEST } else { LATEST_EMPTY };
        let at = self.event_at.unwrap_or(latest).min(latest);
        if seconds >= at && !self.happened {
            self.happen().map_err(failure)?;
        }
        // The patient's head moves from its own rest pose by the motion of the rig's head.
        let rest = self.case.patient.couch_from_head;
        let moved = rig.translation.vector - first.translation.vector;
        let turned = rig.rotation * first.rotation.inverse();
        let mut pose = Isometry3::from_parts(
            Translation3::from(rest.translation.vector + moved),
            turned * rest.rotation,
        );
        if self.happened {
            pose = self.case.pose(&pose, seconds - at);
        }
        outputs.acquired_at(activation.time);
        if elapsed / self.period >= self.next {
            self.next = elapsed / self.period + 1;
            self.image(&pose, activation, outputs)?;
        }
        let q = pose.rotation.quaternion();
        let element = PoseElement {
            position: pose.translation.vector.into(),
            orientation: [q.w, q.i, q.j, q.k],
            covariance: [0.0; 36],
        };
        outputs.send::<Pose>(TRUE_POSE, &element)
    }
}

fn failure(error: impl std::fmt::Display) -> StepError {
    StepError(error.to_string())
}
