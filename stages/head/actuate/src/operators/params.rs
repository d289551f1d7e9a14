//! Parameters that the operators of this family share, and what is made of them.

use stillpoint_operator::SetupError;
use stillpoint_operator::{Params, Setup};

use crate::key::Key;
use crate::message::LONGEST_LIFE;
use crate::pose_watch::PoseWatch;
use stillpoint_pose::extrinsic::{Extrinsic, ExtrinsicParams};

/// Frame periods after which a pose is stale.
const PERIODS: u64 = 3;

/// When a pose is fresh.
#[derive(Clone, Debug, Params)]
pub struct FreshnessParams {
    /// Period of the camera's frames. A pose whose newest measurement is older than three of them is stale.
    #[param(unit = "ns", default = "100 ms", min = "1 ms", max = "1 s")]
    pub frame_period: u64,
    /// Number of identical measurements in a row after which the camera counts as frozen.
    #[param(default = 3, min = 1, max = 1000000)]
    pub frozen_after: u64,
}

impl FreshnessParams {
    /// Age at which a pose is stale, ns.
    pub fn stale(&self) -> u64 {
        stale(self.frame_period)
    }

    /// A watch for poses.
    pub fn watch(&self) -> PoseWatch {
        PoseWatch::new(self.frozen_after)
    }
}

/// Age at which a pose is stale, ns, where frames come with this period.
pub fn stale(frame_period: u64) -> u64 {
    PERIODS * frame_period
}

/// Age at which a pose is too old for the beam, ns, where frames come with this period: with a tick of the gate, the link
/// and a tick of the far end the beam is off 1.5 periods and 20 ms after the newest frame was acquired.
pub fn too_old_for_beam(frame_period: u64) -> u64 {
    frame_period * 3 / 2 + 5_000_000
}

/// The key in a file that a parameter names. One that others may read is refused, unless it is the published example.
pub fn key(name: &str, setup: &Setup<'_>) -> Result<Key, SetupError> {
    let text = setup.file(name)?;
    if !Key::is_example(&text)
        && let Some(mode) = setup.files.shared_mode(name)
    {
        return Err(SetupError(format!(
            "{name}: others may read this key file (mode {mode:04o}), so others may command the rig: draw another key \
             and run `chmod 600 {name}`"
        )));
    }
    Key::parse(&text).map_err(|e| SetupError(format!("{name}: {e}")))
}

/// The extrinsics of the frames behind the pose on an input. Extrinsics that cannot be valid on any day are refused
/// here, before the first command.
pub fn extrinsic(params: &ExtrinsicParams, port: usize, setup: &Setup<'_>) -> Result<Extrinsic, SetupError> {
    let frame = setup.input_frames.get(port).and_then(Option::as_deref);
    let extrinsic = Extrinsic::of(params, setup.frames, frame).map_err(|e| SetupError(e.to_string()))?;
    match extrinsic.fault() {
        None => Ok(extrinsic),
        Some(fault) => Err(SetupError(format!(
            "without a valid extrinsic nothing moves, and {fault}: say in `frames` when and how well it was measured, \
             or say `extrinsic: {{ need: waived }}`"
        ))),
    }
}

/// Refuses a life of datagrams that one late tick would end, or that no datagram can have.
pub fn check_life(name: &str, life: u64, setup: &Setup<'_>) -> Result<(), SetupError> {
    let ms = |ns: u64| ns as f64 * 1e-6;
    if !life.is_multiple_of(1_000) || life > LONGEST_LIFE {
        return Err(SetupError(format!("`{name}` is {life} ns: give whole microseconds, up to 1 s")));
    }
    match setup.every {
        Some(every) if every.saturating_mul(2) <= life => Ok(()),
        Some(every) => Err(SetupError(format!(
            "`{name}` is {} ms and the timer ticks every {} ms: one late tick would end it; tick at least twice as often",
            ms(life),
            ms(every)
        ))),
        None => Err(SetupError("it sends by a timer: add `every: 10 ms`".into())),
    }
}
