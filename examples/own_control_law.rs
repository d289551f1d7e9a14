//! A control law of your own, in place of `control.pi`: each channel moves at a speed proportional to its error.

use stillpoint_control::channels::{Channels, difference};
use stillpoint_control::effect::Effect;
use stillpoint_control::operators::PlantParams;
use stillpoint_control::valves::split;
use stillpoint_operator::*;
use stillpoint_samples::{Duties, DutiesElement, DutyReason, Sample, SampleKind, Target, Track};

#[derive(Clone, Params)]
struct ProportionalParams {
    /// The controlled channels and the bladders that move them.
    plant: PlantParams,
    /// Commanded speed of a channel per error of that channel.
    #[param(unit = "Hz", default = "1 1/s", min = "0.01 1/s", max = "10 1/s")]
    gain: f64,
    /// Time for which an estimate is used.
    #[param(unit = "ns", default = "300 ms", min = "1 ms", max = "10 s")]
    stale: u64,
}

struct Proportional {
    gain: f64,
    stale: u64,
    channels: Channels,
    /// What counts as one of each channel: 1 mm or 1 degree.
    scale: Vec<f64>,
    /// How fast each bladder moves each channel, in scales per second, and the inverse of that.
    effect: Effect,
}

const fn latest(name: &'static str, sample: &'static SampleKind, about: &'static str) -> Input {
    Input { name, sample, policy: Policy::Latest, required: true, about }
}
const DUTIES: Output =
    Output { name: "duties", sample: Duties::KIND, frame: FrameRule::None, about: "How far valves open." };

impl Operator for Proportional {
    type Params = ProportionalParams;
    const KIND: Kind = Kind {
        name: "my.proportional",
        about: "Proportional control of the channels through the inverse of the bladders' effect.",
        role: Role::Operator,
        inputs: &[latest("state", Track::KIND, "Where it is."), latest("target", Target::KIND, "Target.")],
        outputs: &[DUTIES],
        timer: Timer::Required,
    };

    fn new(params: ProportionalParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let ProportionalParams { plant, gain, stale } = params;
        let plant = plant.checked()?;
        Ok(Self { gain, stale, channels: plant.channels, scale: plant.scale, effect: plant.effect })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let valves = 2 * self.effect.bladders() as u32;
        // A law that cannot act says why and has all valves shut: `actuate.valves` then holds, and vents if it lasts.
        let mut duties = DutiesElement { valves, ..DutiesElement::default() };
        match self.net(activation) {
            Err(reason) => duties = DutiesElement::shut(valves, reason.bit()),
            Ok(net) => {
                duties.net[..net.len()].copy_from_slice(&net);
                duties.saturated = split(&net, &mut duties.duty[..2 * net.len()]);
            }
        }
        outputs.send::<Duties>(0, &duties)
    }
}

impl Proportional {
    /// The duty of each bladder's inlet less that of its outlet, -1 to 1.
    fn net(&self, activation: &Activation<'_>) -> Result<Vec<f64>, DutyReason> {
        let state = activation.input::<Track>(0).ok_or(DutyReason::NoEstimate)?;
        // The age counts from the image, by the time of the activation: no operator reads a clock.
        if activation.time.saturating_sub(state.header.origin) > self.stale {
            return Err(DutyReason::Stale);
        }
        let target = activation.input::<Target>(1);
        let target = target.as_ref().and_then(|target| self.channels.of_target(target.first()?));
        let target = target.ok_or(DutyReason::NoTarget)?;
        let pose = state.first().and_then(|track| self.channels.of_track(track));
        let pose = pose.ok_or(DutyReason::MissingChannel)?;
        let speed = |(i, channel)| self.gain * difference(channel, target[i], pose[i]) / self.scale[i];
        let speeds: Vec<f64> = self.channels.iter().enumerate().map(speed).collect();
        let mut net = vec![0.0; self.effect.bladders()];
        self.effect.duties(&speeds, &mut net);
        // Too much for one bladder slows all of them: the head keeps its direction.
        let most = net.iter().fold(1.0, |most: f64, duty| most.max(duty.abs()));
        net.iter_mut().for_each(|duty| *duty /= most);
        if net.iter().all(|duty| duty.is_finite()) { Ok(net) } else { Err(DutyReason::NotFinite) }
    }
}

/// The list for `stillpoint::command(&[MY_LAWS])`, or for a registry.
pub const MY_LAWS: &[Stage] = &[Stage::of::<Proportional>()];
