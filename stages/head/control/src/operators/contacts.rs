//! `control.contacts`: how the bladders hold the head.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Actuation, Contacts, ContactsElement, RigState, Sample, Track};

use crate::channels::{Channels, difference};
use crate::contacts::BLADDERS;
use crate::rig::{Rig, RigKind};

const STATE: usize = 0;
const ACTUATION: usize = 1;
const MEASURED: usize = 2;

/// Parameters of `control.contacts`.
#[derive(Clone, Debug, Params)]
pub struct ContactsParams {
    /// The rig, whose mechanics have to be known.
    pub rig: RigKind,
    /// Mass of the head.
    #[param(unit = "kg", default = "5 kg", min = "1 kg", max = "20 kg")]
    pub head_mass: f64,
    /// Force below which a bladder counts as low.
    #[param(unit = "N", default = "1 N", min = "0 N", max = "100 N")]
    pub least: f64,
    /// Coefficient of sliding friction between bladder and head.
    #[param(default = 0.5, above = 0, max = 2)]
    pub friction: f64,
}

/// Sends, at each tick, the contact forces that follow from the pressures and from the pose. The pose is counted from
/// the first estimate, at which the rig counts as at rest.
pub struct ControlContacts {
    rig: Rig,
    channels: Channels,
    least: f64,
    friction: f64,
    start: Option<[f64; 6]>,
}

impl Operator for ControlContacts {
    type Params = ContactsParams;
    const KIND: Kind = Kind {
        name: "control.contacts",
        about: "Computes the force of each bladder on the head and the margin of its friction cone.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "Where the head is.",
            },
            Input {
                name: "actuation",
                sample: Actuation::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The estimated pressures.",
            },
            Input {
                name: "measured",
                sample: RigState::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Measured pressures, which replace the estimated ones.",
            },
        ],
        outputs: &[Output {
            name: "contacts",
            sample: Contacts::KIND,
            frame: FrameRule::None,
            about: "Force, tangential force and margin of each contact, at each tick.",
        }],
        timer: Timer::Required,
    };

    fn new(params: ContactsParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let rig = Rig::of(params.rig, params.head_mass).map_err(|e| SetupError(e.to_string()))?;
        let channels = rig.channels().ok_or_else(|| {
            SetupError("`rig` is unknown, but contact forces need its mechanics: name one of the rigs".into())
        })?;
        Ok(Self { rig, channels, least: params.least, friction: params.friction, start: None })
    }

    fn capacities(_: &ContactsParams) -> Vec<usize> {
        vec![1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        outputs.send::<Contacts>(0, &self.contacts(activation).unwrap_or_default())
    }
}

impl ControlContacts {
    /// The contacts; `None` while pose or pressures are not known.
    fn contacts(&mut self, activation: &Activation<'_>) -> Option<ContactsElement> {
        let track = activation.input::<Track>(STATE)?;
        let place = self.channels.of_track(track.first()?)?;
        let start = *self.start.get_or_insert(place);
        let mut moved = [0.0; 6];
        for (i, channel) in self.channels.iter().enumerate() {
            moved[i] = difference(channel, place[i], start[i]);
        }
        let measured = activation.input::<RigState>(MEASURED);
        let pressure = match measured.as_ref().and_then(|sample| sample.first()) {
            Some(rig) => rig.pressure,
            None => activation.input::<Actuation>(ACTUATION)?.first()?.pressure,
        };
        let (held, bladders) = self.rig.held(&self.channels.spread(&moved), &pressure)?;
        let mut element = ContactsElement {
            force: held.force,
            tangential: held.tangential,
            gap: held.gap,
            bladders: bladders as u32,
            ..ContactsElement::default()
        };
        for j in 0..bladders.min(BLADDERS) {
            element.margin[j] = self.friction * held.force[j] - held.tangential[j];
            // A force that is no number counts as none.
            let is_low = held.force[j].is_nan() || held.force[j] < self.least;
            element.low |= u32::from(is_low) << j;
            element.slides |= u32::from(element.margin[j] < 0.0) << j;
        }
        Some(element)
    }
}
