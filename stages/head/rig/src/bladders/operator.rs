//! `rig.one_bladder`, `rig.three_bladders` and `rig.eight_bladders`: the rig with its valves at one end and its camera
//! at the other.

use nalgebra::Isometry3;
use rand::Rng;
use stillpoint_mechanics::plant::rigs::RIGS;
use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{
    AdoptError, FrameRule, Input, Kind, Output, ParamConflict, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_samples::{
    Cause, Command, ConsoleCommand, Contacts, DepthImage, Diagnostics, Duties, Metric, Pose, RigState, Sample,
};

use super::fault::{Fault, FaultError, FaultText};
use super::params::BladderParams;
use super::rigs;
use super::simulation::{Mobility, Rig};
use crate::camera_view::{COUCH, CameraView, Living, exact_pose, refusal};
use crate::phantom::Phantom;
use crate::{phantom_params, setting};

const DUTIES: usize = 0;
const FAULT: usize = 1;
const DEPTH: usize = 0;
const TRUTH: usize = 1;
const STATE: usize = 2;
const CONTACTS: usize = 3;
const DIAGNOSTICS: usize = 4;
/// Numbers on `diagnostics`.
const METRICS: usize = 3;

const PLANT_LAP: usize = 0;
const CAMERA_LAP: usize = 1;

/// A head on the bladders of entry `RIG` of the table of rigs. Its `frame:` places the camera over the couch.
///
/// Each tick advances the plant to the time of the tick with the duties that held before, and then takes the newest
/// duties, which act from this tick on. If no duties came for `time_to_live`, the rig goes to its safe state by itself.
pub struct BladderRig<const RIG: usize> {
    rig: Box<dyn Rig>,
    camera_view: CameraView,
    /// Where the head is seen at the start.
    rest: Isometry3<f64>,
    /// What lies there in place of the head.
    phantom: Option<Phantom>,
    /// Ticks of the timer from one image to the next.
    ticks_per_image: u64,
    lost: f64,
    /// Period of the timer, ns.
    every: u64,
    /// Ticks from the first to that of the next image.
    next_image: u64,
    /// What `diagnostics` said last.
    reported: Option<Mobility>,
    /// Time of the first tick and its number.
    begin: Option<(u64, u64)>,
}

impl<const RIG: usize> Operator for BladderRig<RIG> {
    type Params = BladderParams;
    const KIND: Kind = Kind {
        name: RIGS[RIG].kind,
        about: RIGS[RIG].about,
        role: Role::Operator,
        inputs: &[
            Input {
                name: "duties",
                sample: Duties::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Duties of the valves. If it is not connected, the valves stay shut.",
            },
            Input {
                name: "fault",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(16),
                required: false,
                about: "Faults that people cause during the run: `console.fault`.",
            },
        ],
        outputs: &[
            Output {
                name: "depth",
                sample: DepthImage::KIND,
                frame: FrameRule::Key,
                about: "The depth image, in counts of 0.1 mm.",
            },
            Output {
                name: "truth",
                sample: Pose::KIND,
                frame: FrameRule::Named(COUCH),
                about: "The head's true pose, couch_from_head; its origin is between the ear canals.",
            },
            Output {
                name: "state",
                sample: RigState::KIND,
                frame: FrameRule::None,
                about: "Pressures, air, valve openings and faults.",
            },
            Output {
                name: "contacts",
                sample: Contacts::KIND,
                frame: FrameRule::None,
                about: "Force of each bladder along the normal and along the contact, and the margin of its friction cone. A bladder that pushes with less than 1 N is low.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Mobility of head and bladders, and how many contacts push and slide, at the first tick and when they change.",
            },
        ],
        timer: Timer::Required,
    };
    const LAPS: &'static [&'static str] = &["plant", "camera"];

    fn validate(params: &BladderParams) -> Result<(), ParamConflict> {
        params
            .check_faults(RIGS[RIG].bladders())
            .map_err(|why| ParamConflict::inside(&["faults"], refusal(why.to_string())))?;
        phantom_params::check(params.phantom.as_deref())
    }

    fn validate_period(params: &BladderParams, every: u64) -> Result<(), ParamConflict> {
        params.check_period(every).map_err(|reason| ParamConflict::inside(&["camera"], reason))
    }

    fn validate_input(_: &BladderParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        let bladders = RIGS[RIG].bladders();
        if input == DUTIES {
            return from.check_bladders(bladders as u64);
        }
        let script = from.param(&["script"]).and_then(|s| s.as_array());
        for line in script.into_iter().flatten().filter(|line| line["say"] == "fault") {
            scripted(line, bladders).map_err(|why| FeederConflict {
                reason: format!("the script of {} has a fault that this rig refuses: {why}", from.operator),
                help: "change the values of that fault: its number, the part, the amount, the seconds"
                    .to_owned(),
            })?;
        }
        Ok(())
    }

    fn new(params: BladderParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let every = setup.every.unwrap_or(0);
        let rig = rigs::simulated(&RIGS[RIG], params.setup(every)?).map_err(refusal)?;
        let rest = setting::Setting::from(params.setting).rest(params.head_scale);
        let living =
            Living { neck: params.neck, expressions: params.expressions.as_deref().unwrap_or(&[]), rest };
        Ok(Self {
            rig,
            camera_view: CameraView::new(
                &params.camera.image(),
                params.setting,
                params.head_scale,
                &living,
                setup,
            )?,
            rest,
            phantom: phantom_params::phantom(params.phantom.as_deref()).map_err(refusal)?,
            ticks_per_image: params.camera.every / every.max(1),
            lost: params.camera.lost,
            every,
            next_image: 0,
            reported: None,
            begin: None,
        })
    }

    fn adopt(&mut self, params: BladderParams) -> Result<(), AdoptError> {
        // The period is a multiple of the timer's: `validate_period` has seen to it.
        self.ticks_per_image = params.camera.every / self.every.max(1);
        self.lost = params.camera.lost;
        Ok(())
    }

    fn capacities(params: &BladderParams) -> Vec<usize> {
        vec![params.camera.image().pixels(), 1, 1, 1, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.cause != Cause::Timer && self.begin.is_none() {
            // Before its first tick there is no time at the rig: what a person breaks acts from its start.
            return self.obey(activation);
        }
        let (begin, first_tick) = *self.begin.get_or_insert((activation.time, activation.tick));
        let now = activation.time.saturating_sub(begin);
        self.rig.advance(now);
        if let Some(view) = activation.fresh::<Duties>(DUTIES)
            && let Some(duties) = view.first()
            && !self.is_lost(activation)
        {
            self.rig.command(duties, view.header.stamp.saturating_sub(begin), now);
        }
        if activation.cause != Cause::Timer {
            return self.obey(activation);
        }
        outputs.lap(PLANT_LAP);
        // A camera measures now, however old the duties are that moved the head.
        outputs.acquired_at(activation.time);
        let couch_from_head = match &self.phantom {
            Some(phantom) => phantom.couch_from_head(now, &self.rest),
            None => self.rig.couch_from_head(&self.rest),
        };
        let tick = activation.tick.saturating_sub(first_tick);
        if tick >= self.next_image {
            self.next_image = (tick / self.ticks_per_image + 1) * self.ticks_per_image;
            self.look(&couch_from_head, now, activation, outputs)?;
        }
        outputs.lap(CAMERA_LAP);
        outputs.send::<Pose>(TRUTH, &exact_pose(&couch_from_head))?;
        outputs.send::<RigState>(STATE, &self.rig.state())?;
        outputs.send::<Contacts>(CONTACTS, &self.rig.contacts())?;
        self.report(outputs)
    }
}

impl<const RIG: usize> BladderRig<RIG> {
    /// How the contacts hold the head, when that has changed.
    fn report(&mut self, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let found = self.rig.mobility();
        if self.reported == Some(found) {
            return Ok(());
        }
        self.reported = Some(found);
        let Mobility { count, touching, sliding } = found;
        let metrics: [Metric; METRICS] = [
            Metric::new("mobility", count as f64),
            Metric::new("contacts_touching", f64::from(touching)),
            Metric::new("contacts_sliding", f64::from(sliding)),
        ];
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)
    }

    /// Begins or removes the fault of a person's command.
    fn obey(&mut self, activation: &Activation<'_>) -> Result<(), StepError> {
        let command = activation.fresh::<ConsoleCommand>(FAULT);
        let Some(command) = command.as_ref().and_then(|view| view.first()) else { return Ok(()) };
        match FaultText::of(command).map_err(|e| StepError(e.to_string()))? {
            FaultText::Break(fault, lasts) => {
                self.rig.break_now(fault, lasts).map_err(|e| StepError(e.to_string()))
            }
            FaultText::Mend => {
                self.rig.mend();
                Ok(())
            }
        }
    }

    /// Whether the duties that arrive with this activation got lost on their way.
    fn is_lost(&self, activation: &Activation<'_>) -> bool {
        let arriving = self.rig.arriving();
        arriving < 1.0 && chance(activation, 1) >= arriving
    }

    fn look(
        &mut self,
        couch_from_head: &Isometry3<f64>,
        now: u64,
        activation: &Activation<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        let is_lost = self.lost > 0.0 && chance(activation, 0) < self.lost;
        let faults = self.rig.faults();
        if is_lost || faults & Fault::SilentCamera.bit() != 0 {
            return Ok(());
        }
        if faults & Fault::BlindCamera.bit() != 0 {
            return self.camera_view.send_blind(outputs, DEPTH);
        }
        self.camera_view.freeze(faults & Fault::FrozenCamera.bit() != 0);
        self.camera_view.send(couch_from_head, now as f64 * 1e-9, activation, outputs, DEPTH)
    }
}

/// A number from 0 up to 1. The noise of the image uses the beginning of the activation's random stream, whether or not
/// an image is lost.
fn chance(activation: &Activation<'_>, draw: u128) -> f64 {
    let mut random = activation.random();
    random.set_word_pos((1 << 40) + draw);
    f64::from(random.next_u32()) / (f64::from(u32::MAX) + 1.0)
}

/// Whether a rig of so many bladders takes the fault of a line of a script.
fn scripted(line: &serde_json::Value, bladders: usize) -> Result<(), FaultError> {
    let mut command = Command::default();
    let values = line["values"].as_array().into_iter().flatten().filter_map(serde_json::Value::as_f64);
    for (to, value) in command.values.iter_mut().zip(values) {
        *to = value;
        command.given += 1;
    }
    FaultText::of(&command)?.check(bladders)
}
