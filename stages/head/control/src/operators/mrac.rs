//! `control.mrac`: the adaptive controller.

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{AdoptError, Kind, ParamConflict, Role, SetupError, StepError, Timer};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_samples::DutyReason;

use crate::channels::Channel;
use crate::features::{Features, Learned};
use crate::mrac::{Learning, Mrac, MracDesign};
use crate::operators::controller_shell::{ControllerShell, INPUTS, Look, OUTPUTS, STATE, named};
use crate::operators::followed;
use crate::operators::params::{CheckedPlant, PerChannel, PlantParams};
use crate::predictor::Predictor;
use crate::projection::Ball;
use crate::reference::pole_of_rise;

/// What Theta learns its weights over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum FeatureMap {
    /// 1 and the hyperbolic tangent of each channel.
    Tanh,
    /// The last hidden state of the trained network in `model`, and 1.
    Lstm,
}

/// Parameters of `control.mrac`.
#[derive(Clone, Debug, Params)]
pub struct MracParams {
    /// The controlled channels and the bladders that move them.
    pub plant: PlantParams,
    /// Rise time of the reference model from 10 % to 90 % of a step of the target.
    #[param(unit = "s", default = "20 s", min = "0.1 s", max = "10 min", live)]
    pub rise: f64,
    /// Decay rate of an error from the reference model.
    #[param(unit = "Hz", default = "2.37 1/s", min = "0 1/s", max = "100 1/s", live)]
    pub feedback: f64,
    /// Learning rate of the gains on the pose, K_y, in 1/s2.
    #[param(default = 0, min = 0, max = 1000, live)]
    pub learn_pose: f64,
    /// Learning rate of the gains on the target, K_r, in 1/s2.
    #[param(default = 0, min = 0, max = 1000, live)]
    pub learn_target: f64,
    /// Learning rate of the weights of the features, Theta, in 1/s2. A feature of 1 and an error of one scale change the
    /// demanded rate by this many scales per second in each second.
    #[param(default = 1, min = 0, max = 1000, live)]
    pub learn_features: f64,
    /// Decay rate of the gains (sigma-modification).
    #[param(unit = "Hz", default = "0.0005 1/s", min = "0 1/s", max = "100 1/s", live)]
    pub leak: f64,
    /// Refused: `learn_pose` takes its place.
    pub learning_pose: Option<f64>,
    /// Refused: `learn_target` takes its place.
    pub learning_target: Option<f64>,
    /// Refused: `learn_features` takes its place.
    pub learning_features: Option<f64>,
    /// Refused: the learning rates need no weight.
    pub weight: Option<f64>,
    /// Largest norm of the gains of a bladder on one regressor (projection), in full duties per scale.
    #[param(default = 1, above = 0, max = 1000)]
    pub greatest_gain: f64,
    /// Error below which the gains do not change.
    #[param(
        default = "{ x: 0.05 mm, y: 0.05 mm, z: 0.05 mm, pitch: 0.02 deg, roll: 0.02 deg, yaw: 0.02 deg }"
    )]
    pub dead_zone: PerChannel,
    /// The features that the weights Theta multiply.
    #[param(default = "tanh")]
    pub features: FeatureMap,
    /// The network of `features: lstm`, a file of `stillpoint-research train controller`.
    #[param(file)]
    pub model: Option<String>,
    /// Time for which an estimate is used after its newest measurement.
    #[param(unit = "ns", default = "300 ms", min = "1 ms", max = "10 s")]
    pub stale: u64,
}

/// Model-reference adaptive control (4.23)-(4.38) as corrected in SCIENCE E2-E11 and Y1 to Y3.
///
/// The nominal effect of the bladders makes the pose follow the reference model, whose speed is fed forward. The error
/// from the model is the one at the time of the pose, predicted to the time at which the order acts. Gains on the pose,
/// the target and features of the motion learn the rest. No rate depends on `rise`. The gains do not change while a valve
/// is fully open, while the estimate is old, or inside the dead zone. The controller is idle, with all valves shut, if
/// estimate or target are missing, old or not finite. After that the reference model begins at the present pose, and the
/// learned gains stay.
pub struct ControlMrac {
    shell: ControllerShell,
    law: Mrac,
    /// The law as it began, should its numbers be lost.
    initial: Mrac,
    net: Vec<f64>,
}

/// Numbers of the diagnostics that do not belong to a channel.
const NAMES: [&str; 4] = ["learning", "gain_pose", "gain_target", "gain_features"];

impl Operator for ControlMrac {
    type Params = MracParams;
    const KIND: Kind = Kind {
        name: "control.mrac",
        about: "Model-reference adaptive control of the bladders, with features of the pose or of a trained network.",
        role: Role::Operator,
        inputs: INPUTS,
        outputs: OUTPUTS,
        timer: Timer::Required,
    };

    fn validate(params: &MracParams) -> Result<(), ParamConflict> {
        refuse_old_rates(params)?;
        params.plant.checked().map(drop).map_err(|e| ParamConflict::inside(&["plant"], e))
    }

    fn validate_input(params: &MracParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        if input == STATE { followed::check(&params.plant.channels, from) } else { Ok(()) }
    }

    fn new(params: MracParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let plant = params.plant.checked()?;
        let mut dead_zone = params.dead_zone.of(&plant.channels, "dead_zone")?;
        dead_zone.iter_mut().zip(&plant.scale).for_each(|(zone, scale)| *zone /= scale);
        let features = features(&params, &plant, setup)?;
        let design = MracDesign {
            feedback: params.feedback,
            learning: learning(&params),
            leak: params.leak,
            ball: Ball { radius: params.greatest_gain, shell: 0.1 },
            dead_zone,
        };
        let law =
            Mrac::design(design, plant.effect.clone(), features).map_err(|e| SetupError(e.to_string()))?;
        let net = vec![0.0; plant.effect.bladders()];
        let of_channels = plant.channels.iter().flat_map(|c| [named("error", c), named("model", c)]);
        let predicted = plant.channels.iter().map(|c| named("predicted_change", c));
        let names: Vec<String> =
            NAMES.into_iter().map(str::to_owned).chain(of_channels).chain(predicted).collect();
        Ok(Self {
            shell: ControllerShell::new(plant, params.rise, params.stale, setup, names)?,
            initial: law.clone(),
            law,
            net,
        })
    }

    fn adopt(&mut self, params: MracParams) -> Result<(), AdoptError> {
        for law in [&mut self.law, &mut self.initial] {
            law.set_rates(params.feedback, learning(&params), params.leak);
        }
        self.shell.set_rise(params.rise);
        Ok(())
    }

    fn capacities(params: &MracParams) -> Vec<usize> {
        vec![1, ControllerShell::metrics(&params.plant, NAMES.len() + 3 * params.plant.channels.len())]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (dt, mut reasons) = match self.shell.look(activation) {
            Look::Ready { dt, begins, reasons } => {
                if begins {
                    self.law.restart();
                }
                (dt, reasons)
            }
            Look::Idle(reasons) => return self.shell.idle(outputs, reasons | DutyReason::Frozen.bit()),
        };
        let errors = self.shell.tracking().errors();
        let learning = self.law.step(self.shell.pose(), self.shell.target(), &errors, dt, &mut self.net);
        self.shell.bound(&mut self.net);
        self.shell.acted(self.law.moved(&self.net));
        if learning != Learning::On {
            reasons |= DutyReason::Frozen.bit();
        }
        self.shell.say(0, if learning == Learning::On { 1.0 } else { 0.0 });
        for (place, gains) in self.law.gains().into_iter().enumerate() {
            self.shell.say(1 + place, gains.norm());
        }
        let count = self.shell.pose().len();
        for i in 0..count {
            let [error, model] = self.shell.error_and_model(i);
            self.shell.say(NAMES.len() + 2 * i, error);
            self.shell.say(NAMES.len() + 2 * i + 1, model);
            if let Features::Learned(learned) = self.law.features() {
                let change = learned.predicted_change(i).unwrap_or(f64::NAN);
                self.shell.say(NAMES.len() + 2 * count + i, change);
            }
        }
        if !self.shell.act(outputs, &self.net, reasons)? {
            self.law = self.initial.clone();
        }
        Ok(())
    }
}

fn learning(params: &MracParams) -> [f64; 3] {
    [params.learn_pose, params.learn_target, params.learn_features]
}

/// Refuses the parameters of older builds, with the values to write in their place: P of the Lyapunov equation, `weight`
/// over twice the pole of the reference model, multiplied every learning rate.
fn refuse_old_rates(params: &MracParams) -> Result<(), ParamConflict> {
    let p = params.weight.unwrap_or(100.0) / (2.0 * pole_of_rise(params.rise));
    let old: [(&'static [&'static str], &str, Option<f64>); 3] = [
        (&["learning_pose"], "learn_pose", params.learning_pose),
        (&["learning_target"], "learn_target", params.learning_target),
        (&["learning_features"], "learn_features", params.learning_features),
    ];
    for (key, new, value) in old {
        if let Some(value) = value {
            let expected = value * p;
            let text = format!(
                "`{}` depended on the rise of the reference model: write `{new}: {expected:.3}`, which is the same rate, in 1/s2, at a \
                 rise of {} s",
                key.concat(),
                params.rise
            );
            return Err(ParamConflict::inside(key, SetupError(text)));
        }
    }
    if params.weight.is_some() {
        let text = "`weight` is not used any more: remove it".to_owned();
        return Err(ParamConflict::inside(&["weight"], SetupError(text)));
    }
    Ok(())
}

fn features(params: &MracParams, plant: &CheckedPlant, setup: &Setup<'_>) -> Result<Features, SetupError> {
    let name = match (params.features, &params.model) {
        (FeatureMap::Tanh, None) => return Ok(Features::Tanh),
        (FeatureMap::Lstm, Some(name)) => name,
        (FeatureMap::Tanh, Some(name)) => {
            return Err(SetupError(format!(
                "`model` is {name}, and `features: tanh` needs no model: set `features: lstm`, or remove `model`"
            )));
        }
        (FeatureMap::Lstm, None) => {
            return Err(SetupError(
                "`features: lstm` needs a network: add `model: ...`, a file of `stillpoint-research train controller`"
                    .into(),
            ));
        }
    };
    let setup_error = |e: String| SetupError(format!("`model`: {name}: {e}"));
    let predictor =
        Predictor::from_safetensors(&setup.file(name)?).map_err(|e| setup_error(e.to_string()))?;
    let names = |channels: &mut dyn Iterator<Item = Channel>| {
        channels.map(Channel::name).collect::<Vec<_>>().join(", ")
    };
    if predictor.channels() != &plant.channels || predictor.bladders() != plant.effect.bladders() {
        return Err(setup_error(format!(
            "it was trained for {} with {} bladders, and `plant` is {} with {}",
            names(&mut predictor.channels().iter()),
            predictor.bladders(),
            names(&mut plant.channels.iter()),
            plant.effect.bladders()
        )));
    }
    let every = setup.every.map_or(0.0, |ns| ns as f64 * 1e-9);
    if every > predictor.sample_time() * 1.001 {
        return Err(setup_error(format!(
            "its sample time is {} ms: the timer must tick at least as often",
            predictor.sample_time() * 1e3
        )));
    }
    Ok(Features::Learned(Box::new(Learned::new(predictor, &plant.scale))))
}
