//! Parameters that controllers share.

use nalgebra::DMatrix;
use stillpoint_operator::{Choice, Params, SetupError};

use crate::channels::{Channel, Channels};
use crate::effect::Effect;
use crate::rig::{Rig, RigKind};

/// A number for each channel that it is given for, in the channel's unit.
#[derive(Clone, Copy, Debug, PartialEq, Params)]
pub struct PerChannel {
    /// Along x.
    #[param(unit = "m")]
    pub x: Option<f64>,
    /// Along y.
    #[param(unit = "m")]
    pub y: Option<f64>,
    /// Along z.
    #[param(unit = "m")]
    pub z: Option<f64>,
    /// About x.
    #[param(unit = "rad")]
    pub pitch: Option<f64>,
    /// About y.
    #[param(unit = "rad")]
    pub roll: Option<f64>,
    /// About z.
    #[param(unit = "rad")]
    pub yaw: Option<f64>,
}

impl PerChannel {
    /// In the order of the six channels.
    pub fn all(&self) -> [Option<f64>; 6] {
        [self.x, self.y, self.z, self.pitch, self.roll, self.yaw]
    }

    /// One number for each of these channels, all of which must be given and above 0.
    pub fn of(&self, channels: &Channels, param: &str) -> Result<Vec<f64>, SetupError> {
        let all = self.all();
        let expected = |channel: Channel| match all[channel.place()] {
            Some(value) if value > 0.0 => Ok(value),
            Some(value) => {
                Err(SetupError(format!("`{param}.{}` is {value}: it must be above 0", channel.name())))
            }
            None => Err(SetupError(format!(
                "`{param}` lacks {}, which is controlled: add `{}: ... {}`",
                channel.name(),
                channel.name(),
                channel.unit()
            ))),
        };
        channels.iter().map(expected).collect()
    }
}

/// How fast a bladder moves each channel.
#[derive(Clone, Copy, Debug, PartialEq, Params)]
pub struct BladderRates {
    /// Along x.
    #[param(unit = "m/s", default = "0 m/s")]
    pub x: f64,
    /// Along y.
    #[param(unit = "m/s", default = "0 m/s")]
    pub y: f64,
    /// Along z.
    #[param(unit = "m/s", default = "0 m/s")]
    pub z: f64,
    /// About x.
    #[param(unit = "rad/s", default = "0 rad/s")]
    pub pitch: f64,
    /// About y.
    #[param(unit = "rad/s", default = "0 rad/s")]
    pub roll: f64,
    /// About z.
    #[param(unit = "rad/s", default = "0 rad/s")]
    pub yaw: f64,
}

/// The controlled channels and the bladders that move them.
#[derive(Clone, Debug, PartialEq, Params)]
pub struct PlantParams {
    /// The channels that the controller holds.
    #[param(default = "[z, pitch, roll]")]
    pub channels: Vec<Channel>,
    /// Speed of each channel when the inlet of a bladder is fully open: one entry for each bladder, in the order of the
    /// valves. The default is the simulated rig of three bladders.
    #[param(
        default = "[{ z: 13.23 mm/s, pitch: 6.225 deg/s }, { z: 9.05 mm/s, pitch: -9.272 deg/s, roll: 11.1 deg/s }, { z: 9.05 mm/s, pitch: -9.272 deg/s, roll: -11.1 deg/s }]"
    )]
    pub bladders: Vec<BladderRates>,
    /// The rig, if its mechanics are known: the effect of the bladders follows from them, and `bladders` is not used.
    #[param(default = "unknown")]
    pub rig: RigKind,
    /// Mass of the head on the rig.
    #[param(unit = "kg", default = "5 kg", min = "1 kg", max = "10 kg")]
    pub head_mass: f64,
    /// Unit of each channel: errors of these sizes have equal weight.
    #[param(default = "{ x: 10 mm, y: 10 mm, z: 11.5 mm, pitch: 1.35 deg, roll: 10 deg, yaw: 5 deg }")]
    pub scale: PerChannel,
    /// Distance from the reference model beyond which the reason `tracking error` is set. If it lasts,
    /// `actuate.valves` makes it a fault.
    #[param(default = "{ x: 3 mm, y: 3 mm, z: 3 mm, pitch: 2 deg, roll: 2 deg, yaw: 2 deg }")]
    pub error_limit: PerChannel,
    /// How long after an order the bladders begin to answer: the way to the valves and their lag. The error from the
    /// reference model is predicted over it.
    #[param(unit = "s", default = "30 ms", min = "0 s", max = "500 ms")]
    pub delay: f64,
    /// Whether the periodic motion of the patient, breath and nods, is learned and answered ahead.
    #[param(default = "ignored")]
    pub motion: Motion,
    /// Effect of an open outlet, in parts of that of the inlet.
    #[param(default = 1, min = 0.1, max = 2)]
    pub outlet: f64,
}

/// Whether the periodic motion of the patient is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Motion {
    /// It is not.
    Ignored,
    /// Two tones, with frequencies that are tracked.
    Learned,
}

/// Most bladders that duties have room for.
pub const MOST_BLADDERS: usize = 8;

/// [`PlantParams`], checked.
#[derive(Clone, Debug)]
pub struct CheckedPlant {
    /// The channels.
    pub channels: Channels,
    /// Scale of each, m or rad.
    pub scale: Vec<f64>,
    /// What the bladders do, in scales.
    pub effect: Effect,
    /// From an order to the bladders' answer, s.
    pub delay: f64,
    /// Largest distance of each channel from the reference model, in scales.
    pub error_limit: Vec<f64>,
    /// Whether the periodic motion is learned.
    pub motion: Motion,
}

impl PlantParams {
    /// Checks what no single parameter can.
    ///
    /// # Errors
    /// What to change.
    pub fn checked(&self) -> Result<CheckedPlant, SetupError> {
        let setup_error = |what: &str, e: &dyn std::fmt::Display| SetupError(format!("`plant.{what}`: {e}"));
        let channels = Channels::new(&self.channels).map_err(|e| setup_error("channels", &e))?;
        let scale = self.scale.of(&channels, "plant.scale")?;
        let mut error_limit = self.error_limit.of(&channels, "plant.error_limit")?;
        error_limit.iter_mut().zip(&scale).for_each(|(limit, scale)| *limit /= scale);
        let known = Rig::of(self.rig, self.head_mass).and_then(|rig| rig.rates());
        let listed = || self.bladders.iter().map(|b| [b.x, b.y, b.z, b.pitch, b.roll, b.yaw]).collect();
        let rates: Vec<[f64; 6]> = known.map_err(|e| setup_error("rig", &e))?.unwrap_or_else(listed);
        if rates.len() > MOST_BLADDERS {
            let (found, most) = (rates.len(), MOST_BLADDERS);
            return Err(SetupError(format!(
                "`plant.bladders` names {found} bladders: there is room for {most}"
            )));
        }
        let places: Vec<usize> = channels.iter().map(Channel::place).collect();
        let b = DMatrix::from_fn(places.len(), rates.len(), |i, j| rates[j][places[i]] / scale[i]);
        let effect = Effect::new(b).map_err(|e| setup_error("bladders", &e))?;
        let effect = effect.with_outlet(self.outlet);
        Ok(CheckedPlant { channels, scale, effect, delay: self.delay, error_limit, motion: self.motion })
    }
}
