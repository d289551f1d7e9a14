//! What a config may say of a rig with bladders.

use stillpoint_operator::SetupError;
use stillpoint_operator::{Choice, Params};

use super::fault::{Fault, FaultError, FaultText, Scheduled};
use super::hardware::Imperfections;
use super::rigs;
use super::safety;
use super::simulation::{Push, Surroundings};
use crate::camera_view::{ExpressionParams, ImageParams, Neck, Noise, Setting, refusal};
use crate::involuntary::{Habit, Involuntary};
use crate::phantom_params::PhantomParams;

/// What the person does without wanting to.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Motion {
    /// Nothing.
    Still,
    /// Breathes and drifts.
    Breathes,
    /// Breathes, drifts, nods off and coughs now and then.
    Nods,
}

/// Safe state of the valves when duties stop.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Safe {
    /// Inlets shut, outlets open to the room.
    Vent,
    /// All shut.
    Hold,
}

/// Where the bladders touch the head.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Touch {
    /// Always at the same places of head and bladder.
    Fixed,
    /// Where head and bladder meet: contacts roll over both, stick, and slide.
    Rolling,
}

/// The fault.
#[derive(Clone, Copy, Debug, Choice)]
pub enum Break {
    /// Valve `which` keeps its opening: inlet and outlet of the first bladder are 0 and 1, and so on.
    StuckValve,
    /// Bladder `which` has a hole of `diameter`.
    Leak,
    /// The supply falls to the part `left` of its pressure.
    WeakSupply,
    /// The camera's images are empty.
    BlindCamera,
    /// The camera sends no images.
    SilentCamera,
    /// The camera sends the same image again and again.
    FrozenCamera,
    /// Of the duties only the part `left` arrives.
    LostDuties,
}

/// A fault and its time.
#[derive(Clone, Copy, Debug, Params)]
pub struct FaultParams {
    /// The fault.
    pub kind: Break,
    /// When, after the rig's start.
    #[param(unit = "ns")]
    pub at: u64,
    /// How long it stays broken.
    #[param(unit = "ns", default = "10000 h", min = "1 ms")]
    pub lasts: u64,
    /// Which valve sticks or which bladder leaks, from 0.
    #[param(default = 0, max = 15)]
    pub which: u32,
    /// Diameter of a leak.
    #[param(unit = "m", default = "0.5 mm", above = "0 mm", max = "10 mm")]
    pub diameter: f64,
    /// The fraction that is left of a weak supply's pressure above the room's, or of lost duties.
    #[param(default = 0, min = 0, max = 1)]
    pub left: f64,
}

/// A push at the head.
#[derive(Clone, Copy, Debug, Params)]
pub struct PushParams {
    /// When, after the rig's start.
    #[param(unit = "ns")]
    pub at: u64,
    /// How long.
    #[param(unit = "ns", default = "10000 h", min = "1 ms")]
    pub lasts: u64,
    /// How far along x, y and z it would move the head while the valves stay shut.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-30 mm", max = "30 mm")]
    pub shift: [f64; 3],
    /// How far it would turn it: pitch, roll, yaw.
    #[param(unit = "rad", default = "[0 deg, 0 deg, 0 deg]", min = "-15 deg", max = "15 deg")]
    pub turn: [f64; 3],
}

/// The camera of a rig.
#[derive(Clone, Copy, Debug, Params)]
pub struct RigCameraParams {
    /// Time from one image to the next: a multiple of the rig's `every`.
    #[param(unit = "ns", default = "100 ms", min = "1 ms", max = "10 s", live)]
    pub every: u64,
    /// Fraction of the images that is lost.
    #[param(default = 0, min = 0, max = 1, live)]
    pub lost: f64,
    /// The camera whose noise is simulated.
    #[param(default = "structured_light")]
    pub noise: Noise,
    /// Pixels in a row.
    #[param(unit = "px", default = "640 px", min = "16 px", max = "2048 px")]
    pub width: u32,
    /// Rows.
    #[param(unit = "px", default = "480 px", min = "16 px", max = "2048 px")]
    pub height: u32,
    /// Focal length.
    #[param(unit = "px", default = "566 px", min = "8 px", max = "10000 px")]
    pub focal_length: f64,
}

/// Parameters of the rigs with bladders.
#[derive(Clone, Debug, Params)]
pub struct BladderParams {
    /// The involuntary motion of the person: how far the head would move without control.
    #[param(default = "nods")]
    pub motion: Motion,
    /// Seed of drift, coughs and irregular motion. The camera's noise comes from the pipeline's seed.
    #[param(default = 7)]
    pub seed: u64,
    /// Factor of the motion.
    #[param(default = 1, min = 0, max = 10)]
    pub strength: f64,
    /// How far breath and nods differ from person to person and wander; 0 are sines of 0.25 and 0.1 Hz.
    #[param(default = 0, min = 0, max = 1)]
    pub irregularity: f64,
    /// Mass of the head.
    #[param(unit = "kg", default = "5 kg", min = "2 kg", max = "8 kg")]
    pub head_mass: f64,
    /// The object that the head rests on in the image.
    #[param(default = "pads")]
    pub setting: Setting,
    /// Size of the head in the image; 1 is an adult's head.
    #[param(default = 1, min = 0.5, max = 1.5)]
    pub head_scale: f64,
    /// The neck. `skin` bends between the head and a torso whose chest breathes.
    #[param(default = "rigid")]
    pub neck: Neck,
    /// Expressions of the face and their times.
    pub expressions: Option<Vec<ExpressionParams>>,
    /// The camera.
    pub camera: RigCameraParams,
    /// Time for which duties are valid.
    #[param(unit = "ns", default = "60 ms", min = "1 ms", max = "10 s")]
    pub time_to_live: u64,
    /// Safe state of the valves when duties stop.
    #[param(default = "vent")]
    pub safe: Safe,
    /// Duty up to which a valve stays shut; above it the opening grows in proportion, to full opening at full duty. Tell
    /// `actuate.valves` of it.
    #[param(default = 0.07, min = 0, max = 0.5)]
    pub dead_band: f64,
    /// Time after which a valve begins to follow its duty, in the mean of the valves. Its lag of 20 ms comes on top.
    #[param(unit = "ns", default = "0 ms", min = "0 ms", max = "50 ms")]
    pub valve_delay: u64,
    /// Greatest deviation of a valve's delay from the mean, as a part of it. Which valve has which delay follows from
    /// `seed`.
    #[param(default = 0.5, min = 0, max = 1)]
    pub valve_spread: f64,
    /// Creep of the rubber: the part by which the pressure of a bladder falls in each tenfold of time after a stretch.
    #[param(default = 0.03, min = 0, max = 0.2)]
    pub creep: f64,
    /// Where the bladders touch the head. The contact of the rig with one bladder is the same either way.
    #[param(default = "fixed")]
    pub contacts: Touch,
    /// Coefficient of friction between bladders and head. 0 is no friction. For fixed contacts that stand for rolling
    /// ones it is small.
    #[param(default = 0, min = 0, max = 2)]
    pub friction: f64,
    /// Longest step of the plant.
    #[param(unit = "ns", default = "1 ms", min = "10 us", max = "1 ms")]
    pub plant_step: u64,
    /// Pushes by the hand of another person.
    pub pushes: Option<Vec<PushParams>>,
    /// Moves of a phantom in place of the head, in the order of their times. With it, no bladder moves what the camera
    /// sees, and `truth` is the pose of the phantom.
    pub phantom: Option<Vec<PhantomParams>>,
    /// Faults and their times.
    pub faults: Option<Vec<FaultParams>>,
}

impl RigCameraParams {
    /// The image that it makes.
    pub fn image(&self) -> ImageParams {
        let Self { noise, width, height, focal_length, .. } = *self;
        ImageParams { noise, width, height, focal_length }
    }
}

impl BladderParams {
    /// Whether images fall on ticks of the rig's timer, `every` ns apart.
    ///
    /// # Errors
    /// The two periods.
    pub fn check_period(&self, every: u64) -> Result<(), SetupError> {
        if every > 0 && self.camera.every.is_multiple_of(every) {
            return Ok(());
        }
        Err(refusal(format!(
            "camera.every is {} ms, and the rig's own `every` is {} ms: make the first a multiple of the second",
            self.camera.every as f64 * 1e-6,
            every as f64 * 1e-6
        )))
    }

    /// Refuses faults of valves and bladders that a rig of so many bladders does not have.
    pub fn check_faults(&self, bladders: usize) -> Result<(), FaultError> {
        let mut all = self.faults.iter().flatten().map(FaultParams::scheduled);
        all.try_for_each(|s| FaultText::Break(s.fault, None).check(bladders))
    }

    /// What the rig is built of.
    ///
    /// # Errors
    /// A camera whose images do not fall on ticks of the rig's timer, `every` ns apart.
    pub fn setup(&self, every: u64) -> Result<rigs::Setup, SetupError> {
        self.check_period(every)?;
        let habit = match self.motion {
            Motion::Still => Habit::Still,
            Motion::Breathes => Habit::Breathes,
            Motion::Nods => Habit::Nods,
        };
        let safe = match self.safe {
            Safe::Vent => safety::Safe::Vent,
            Safe::Hold => safety::Safe::Hold,
        };
        let contacts = match self.contacts {
            Touch::Fixed => rigs::Contacts::Fixed,
            Touch::Rolling => rigs::Contacts::Rolling,
        };
        let involuntary =
            Involuntary { habit, seed: self.seed, strength: self.strength, irregularity: self.irregularity };
        let faults = self.faults.iter().flatten().map(FaultParams::scheduled).collect();
        let pushes = self.pushes.iter().flatten().map(PushParams::push).collect();
        Ok(rigs::Setup {
            head_mass: self.head_mass,
            time_to_live: self.time_to_live,
            safe,
            contacts,
            surroundings: Surroundings {
                involuntary,
                pushes,
                faults,
                imperfections: Imperfections {
                    dead_band: self.dead_band,
                    delay: self.valve_delay,
                    spread: self.valve_spread,
                    creep: self.creep,
                    friction: self.friction,
                    seed: self.seed,
                },
                step: self.plant_step,
            },
        })
    }
}

impl FaultParams {
    fn scheduled(&self) -> Scheduled {
        let fault = match self.kind {
            Break::StuckValve => Fault::StuckValve { valve: self.which as usize },
            Break::Leak => Fault::Leak { bladder: self.which as usize, diameter: self.diameter },
            Break::WeakSupply => Fault::WeakSupply { left: self.left },
            Break::BlindCamera => Fault::BlindCamera,
            Break::SilentCamera => Fault::SilentCamera,
            Break::FrozenCamera => Fault::FrozenCamera,
            Break::LostDuties => Fault::LostDuties { left: self.left },
        };
        Scheduled { fault, begin: self.at, end: self.at.saturating_add(self.lasts) }
    }
}

impl PushParams {
    fn push(&self) -> Push {
        let ([x, y, z], [pitch, roll, yaw]) = (self.shift, self.turn);
        let end = self.at.saturating_add(self.lasts);
        Push { offset: [x, y, z, pitch, roll, yaw], begin: self.at, end }
    }
}
