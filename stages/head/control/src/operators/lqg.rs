//! `control.lqg`: linear-quadratic control with an integrator.

use nalgebra::DMatrix;
use stillpoint_identify::InnovationModel;
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{AdoptError, Kind, ParamConflict, Role, SetupError, StepError, Timer};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_samples::Cause;

use crate::identified::Identified;
use crate::lqi::{Lqi, Plant, Weights};
use crate::operators::controller_shell::{ControllerShell, INPUTS, Look, OUTPUTS, STATE, named};
use crate::operators::followed;
use crate::operators::params::{CheckedPlant, PlantParams};
use crate::riccati::observer_gain;

/// Parameters of `control.lqg`.
#[derive(Clone, Debug, Params)]
pub struct LqgParams {
    /// The controlled channels and the bladders that move them.
    pub plant: PlantParams,
    /// A model of `stillpoint identify`, from the net duty of one bladder (`lqg.duties:net.0`) to one channel of the
    /// state; its sample time must be the timer's period. Without a model the channels integrate the effect of the
    /// bladders.
    #[param(file)]
    pub model: Option<String>,
    /// Cost of an error of one scale, per second.
    #[param(default = 1, above = 0, max = 1000000, live)]
    pub error_weight: f64,
    /// Cost of an integrated error of one scale times one second, per second.
    #[param(default = 0.1, above = 0, max = 1000000, live)]
    pub integral_weight: f64,
    /// Cost of a fully open valve, per second.
    #[param(default = 10, above = 0, max = 1000000000, live)]
    pub effort_weight: f64,
    /// Without `model`: variance of the drift of a channel from tick to tick, divided by the variance of its estimate.
    /// With a large value the observer trusts the estimate.
    #[param(default = 1, above = 0, max = 1000000)]
    pub drift: f64,
    /// Rise time of the reference model from 10 % to 90 % of a step of the target; with 0 s the model is the step
    /// itself.
    #[param(unit = "s", default = "20 s", min = "0 s", max = "10 min", live)]
    pub rise: f64,
    /// Time for which an estimate is used after its newest measurement.
    #[param(unit = "ns", default = "300 ms", min = "1 ms", max = "10 s")]
    pub stale: u64,
}

/// Linear-quadratic control with an integrator, an observer and a limit to what is integrated (SCIENCE D5-D7).
///
/// The gain is that of the discrete Riccati equation for the plant with its integrators, at the timer's period. So the
/// operator acts on its timer alone. The head approaches the target as the reference model of (4.24) does. The speed of
/// the model is fed forward. Without `model` the pose is predicted to when the order acts (SCIENCE Y2, Y3). The
/// operator is idle, with all valves shut, while the estimate or the target is missing, old or not finite. Afterwards
/// it begins from where the head is.
pub struct ControlLqg {
    shell: ControllerShell,
    law: Lqi,
    identified: Option<Identified>,
    net: Vec<f64>,
    /// The timer's period, s.
    period: f64,
    /// Input that moves the plant along with its set-point, then rates of the channels: all of them, and those that the
    /// integrators ask for.
    feed: Vec<f64>,
    moved: [Vec<f64>; 2],
    /// Pose, set-point, and a state of the plant at rest, as the law counts them.
    y: Vec<f64>,
    r: Vec<f64>,
    x: Vec<f64>,
}

impl Operator for ControlLqg {
    type Params = LqgParams;
    const KIND: Kind = Kind {
        name: "control.lqg",
        about: "Linear-quadratic control with an integrator and an observer, for an identified model or for the bladders' effect.",
        role: Role::Operator,
        inputs: INPUTS,
        outputs: OUTPUTS,
        timer: Timer::Required,
    };

    fn validate(params: &LqgParams) -> Result<(), ParamConflict> {
        params.plant.checked().map(drop).map_err(|e| ParamConflict::inside(&["plant"], e))
    }

    fn validate_input(params: &LqgParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        if input == STATE { followed::check(&params.plant.channels, from) } else { Ok(()) }
    }

    fn new(params: LqgParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let plant = params.plant.checked()?;
        let period = setup.every.map_or(0.1, |ns| ns as f64 * 1e-9);
        let identified = match &params.model {
            Some(name) => Some(identified(name, &setup.file(name)?, &plant, period)?),
            None => None,
        };
        let known = match &identified {
            Some(identified) => identified.plant().clone(),
            None => integrating(&plant, params.drift, period)?,
        };
        let (n, p, m) = (known.a.nrows(), known.c.nrows(), known.b.ncols());
        let weights = weights(&params, &known, period);
        let mut law =
            Lqi::design(known, &weights).map_err(|e| SetupError(format!("there is no gain: {e}")))?;
        law.limit(identified.as_ref().map_or([-1.0, 1.0], Identified::limits));
        let names: Vec<String> = plant
            .channels
            .iter()
            .flat_map(|c| [named("error", c), named("model", c), format!("integral_{}", c.name())])
            .collect();
        Ok(Self {
            law,
            identified,
            net: vec![0.0; m],
            period,
            feed: vec![0.0; m],
            moved: [vec![0.0; p], vec![0.0; p]],
            y: vec![0.0; p],
            r: vec![0.0; p],
            x: vec![0.0; n],
            shell: ControllerShell::new(plant, params.rise, params.stale, setup, names)?,
        })
    }

    fn adopt(&mut self, params: LqgParams) -> Result<(), AdoptError> {
        let weights = weights(&params, self.law.plant(), self.period);
        self.law.weigh(&weights).map_err(|e| AdoptError(format!("there is no gain: {e}")))?;
        self.shell.set_rise(params.rise);
        Ok(())
    }

    fn capacities(params: &LqgParams) -> Vec<usize> {
        vec![1, ControllerShell::metrics(&params.plant, 3 * params.plant.channels.len())]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.cause != Cause::Timer {
            // The gain is that of the timer's period.
            self.shell.keep(activation);
            return Ok(());
        }
        let (begins, reasons) = match self.shell.look(activation) {
            Look::Ready { begins, reasons, .. } => (begins, reasons),
            Look::Idle(reasons) => return self.shell.idle(outputs, reasons),
        };
        self.count();
        if begins {
            match &self.identified {
                Some(identified) => drop(identified.moving(self.y[0], 0.0, &mut self.x)),
                None => self.x.copy_from_slice(&self.y),
            }
            self.law.restart(&self.x);
        }
        let errors = self.shell.tracking().errors();
        match &self.identified {
            Some(identified) => {
                self.feed[0] = identified.moving(self.r[0], errors.speed[0] * self.period, &mut self.x);
            }
            None => {
                self.x.copy_from_slice(&self.r);
                self.shell.plant().effect.duties(errors.speed, &mut self.feed);
            }
        }
        self.law.aim(&self.x);
        self.law.feed(&self.feed);
        self.law.step(&self.y, &self.r, &mut self.net);
        self.shell.bound(&mut self.net);
        let effect = &self.shell.plant().effect;
        let [moved, compensation] = &mut self.moved;
        effect.moved(&self.net, moved);
        self.law.integrated(&mut self.feed);
        effect.moved(&self.feed, compensation);
        self.shell.acted([&self.moved[0], &self.moved[1]]);
        if let Some(identified) = &self.identified {
            self.net[0] = identified.duty(self.net[0]);
        }
        for i in 0..self.y.len() {
            let [error, model] = self.shell.error_and_model(i);
            self.shell.say(3 * i, -error);
            self.shell.say(3 * i + 1, model);
            self.shell.say(3 * i + 2, self.law.integral()[i]);
        }
        self.shell.act(outputs, &self.net, reasons).map(drop)
    }
}

impl ControlLqg {
    /// Writes pose and set-point as the law counts them.
    ///
    /// Where the channels integrate, the set-point is the model when the order acts, and the pose is what it will be
    /// then. An identified plant has the delay of its record in its states: there both are those of the pose's time.
    fn count(&mut self) {
        let tracking = self.shell.tracking();
        let errors = tracking.errors();
        match (&self.identified, self.shell.start()) {
            (Some(identified), Some(start)) => {
                // The model counts from its own offset, the shell from where control began.
                self.r[0] = tracking.model()[0] + identified.counted(start[0]);
                self.y[0] = self.r[0] + errors.seen[0];
            }
            _ => {
                for (i, (r, y)) in self.r.iter_mut().zip(&mut self.y).enumerate() {
                    *r = tracking.ahead()[i];
                    *y = *r + errors.predicted[i];
                }
            }
        }
    }
}

/// The costs are those of a second, whatever the sample time; the integrators count samples.
fn weights(params: &LqgParams, plant: &Plant, period: f64) -> Weights {
    let (p, m) = (plant.c.nrows(), plant.b.ncols());
    Weights {
        state: plant.c.transpose() * &plant.c * (params.error_weight * period),
        integral: DMatrix::from_diagonal_element(p, p, params.integral_weight * period * period * period),
        effort: DMatrix::from_diagonal_element(m, m, params.effort_weight * period),
    }
}

/// Channels that integrate what the bladders do: `y(k+1) = y(k) + T B u`.
fn integrating(plant: &CheckedPlant, drift: f64, period: f64) -> Result<Plant, SetupError> {
    let n = plant.channels.count();
    let one = DMatrix::<f64>::identity(n, n);
    let k =
        observer_gain(&one, &one, &(&one * drift), &one).map_err(|e| SetupError(format!("`drift`: {e}")))?;
    Ok(Plant { a: one.clone(), b: plant.effect.matrix() * period, c: one, k })
}

fn identified(name: &str, bytes: &[u8], plant: &CheckedPlant, period: f64) -> Result<Identified, SetupError> {
    let setup_error = |e: String| SetupError(format!("`model`: {name}: {e}"));
    let model = InnovationModel::from_json(bytes).map_err(|e| setup_error(e.to_string()))?;
    let (Some(channel), 1, 1) =
        (plant.channels.iter().next(), plant.channels.count(), plant.effect.bladders())
    else {
        let (n, m) = (plant.channels.count(), plant.effect.bladders());
        return Err(setup_error(format!(
            "a model has one input and one output, and `plant` has {m} bladders and {n} channels: hold one channel with one bladder, or remove `model`"
        )));
    };
    Identified::new(&model, channel.unit(), plant.scale[0], period).map_err(|e| setup_error(e.to_string()))
}
