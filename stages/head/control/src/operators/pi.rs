//! `control.pi`: the baseline.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{AdoptError, Kind, ParamConflict, Role, SetupError, StepError, Timer};
use stillpoint_operator::{Feeder, FeederConflict};

use crate::operators::controller_shell::{ControllerShell, INPUTS, Look, OUTPUTS, STATE, named};
use crate::operators::followed;
use crate::operators::params::PlantParams;
use crate::pi::{Pi, PiGains};

/// Parameters of `control.pi`.
#[derive(Clone, Debug, Params)]
pub struct PiParams {
    /// The controlled channels and the bladders that move them.
    pub plant: PlantParams,
    /// Commanded speed of a channel per error of that channel.
    #[param(unit = "Hz", default = "1 1/s", min = "0 1/s", max = "100 1/s", live)]
    pub proportional: f64,
    /// Growth of that speed per second for a lasting error, in 1/s2.
    #[param(default = 0.15, min = 0, max = 1000, live)]
    pub integral: f64,
    /// Rise time of the reference model from 10 % to 90 % of a step of the target; with 0 s the model is the step
    /// itself.
    #[param(unit = "s", default = "20 s", min = "0 s", max = "10 min", live)]
    pub rise: f64,
    /// Time for which an estimate is used after its newest measurement.
    #[param(unit = "ns", default = "300 ms", min = "1 ms", max = "10 s")]
    pub stale: u64,
}

/// Proportional and integral control of each channel through the inverse of the bladders' effect (SCIENCE E11).
///
/// The head approaches the target as the reference model of (4.24) does. The speed of the model is fed forward. The
/// error from the model is that of the pose's own time, predicted to when the order acts (SCIENCE Y2, Y3). The
/// integrals stand still where a change of them would only demand more of a fully open valve. The operator is idle,
/// with all valves shut, while the estimate or the target is missing, old or not finite. Afterwards it begins from
/// where the head is, with integrals of zero.
pub struct ControlPi {
    shell: ControllerShell,
    law: Pi,
    net: Vec<f64>,
}

impl Operator for ControlPi {
    type Params = PiParams;
    const KIND: Kind = Kind {
        name: "control.pi",
        about: "Proportional and integral control of the channels through the inverse of the bladders' effect.",
        role: Role::Operator,
        inputs: INPUTS,
        outputs: OUTPUTS,
        timer: Timer::Required,
    };

    fn validate(params: &PiParams) -> Result<(), ParamConflict> {
        params.plant.checked().map(drop).map_err(|e| ParamConflict::inside(&["plant"], e))
    }

    fn validate_input(params: &PiParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        if input == STATE { followed::check(&params.plant.channels, from) } else { Ok(()) }
    }

    fn new(params: PiParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let plant = params.plant.checked()?;
        let law = Pi::new(gains(&params), plant.effect.clone());
        let net = vec![0.0; plant.effect.bladders()];
        let names: Vec<String> = plant
            .channels
            .iter()
            .flat_map(|c| [named("error", c), named("model", c), format!("integral_{}", c.name())])
            .collect();
        Ok(Self { shell: ControllerShell::new(plant, params.rise, params.stale, setup, names)?, law, net })
    }

    fn adopt(&mut self, params: PiParams) -> Result<(), AdoptError> {
        self.law.set_gains(gains(&params));
        self.shell.set_rise(params.rise);
        Ok(())
    }

    fn capacities(params: &PiParams) -> Vec<usize> {
        vec![1, ControllerShell::metrics(&params.plant, 3 * params.plant.channels.len())]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (dt, begins, reasons) = match self.shell.look(activation) {
            Look::Ready { dt, begins, reasons } => (dt, begins, reasons),
            Look::Idle(reasons) => return self.shell.idle(outputs, reasons),
        };
        if begins {
            self.law.restart();
        }
        self.law.step(&self.shell.tracking().errors(), dt, &mut self.net);
        self.shell.bound(&mut self.net);
        self.shell.acted(self.law.moved(&self.net));
        for (i, integral) in self.law.integral().iter().enumerate() {
            let [error, model] = self.shell.error_and_model(i);
            self.shell.say(3 * i, -error);
            self.shell.say(3 * i + 1, model);
            self.shell.say(3 * i + 2, *integral);
        }
        self.shell.act(outputs, &self.net, reasons).map(drop)
    }
}

fn gains(params: &PiParams) -> PiGains {
    PiGains { proportional: params.proportional, integral: params.integral }
}
