//! One live run with a fault, and the evidence of its session.

use std::net::UdpSocket;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use stillpoint_operator::Registry;
use stillpoint_pipeline::clock::realtime;
use stillpoint_samples::{FarEndDoing, RigFault, Verb};

use super::evidence::Evidence;
use super::program::{self, Program, SUPERVISOR};
use stillpoint::Failure;
use stillpoint::deliver;

/// Replacements in the pipeline's text: a quarter of the pixels, and a target that does not move, so that the beam
/// stays on.
const CHANGES: &[(&str, &str)] = &[
    (
        "camera: { every: 100 ms }",
        "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
    ),
    ("at: 2.5 s, z:", "at: 1 h, z:"),
];
/// Time for which a run is observed after its fault.
const WATCHED: Duration = Duration::from_millis(700);
/// Processes that simulate hardware with its own processors: the far end and the rig.
const BEDSIDE: [&str; 2] = ["bedside", "rig"];
/// Number of datagrams of a burst.
const BURST: usize = 500;
/// Number of datagrams in each millisecond of a flood.
const FLOOD: usize = 200;

/// A fault that a trial causes in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// SIGKILL to this process.
    Kill(&'static str),
    /// SIGSTOP to this process.
    Stop(&'static str),
    /// The camera sends no images.
    Silence,
    /// The pose is not finite.
    NanInjection,
    /// A burst of datagrams with random bytes.
    Garbage,
    /// Such datagrams without pause, so that every queue on the way is full.
    Flood,
}

/// The required reaction to a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Due {
    /// Orders end. The valves are safe 100 ms after the last order that arrived.
    OrdersEnd,
    /// Orders to follow end. The valves are safe 100 ms after the last of them was followed.
    FollowingEnds,
    /// The pose becomes stale, or its reference is lost. The valves are safe 100 ms after three frame periods.
    PoseStale,
    /// The valves continue to follow.
    GoesOn,
    /// The valves continue to follow, or they are safe 100 ms after the last order that arrived.
    GoesOnOrEnds,
}

impl Fault {
    /// All faults: of every process except the far end and the rig, of the camera, of the pose, and of the network.
    pub const ALL: &'static [Self] = &[
        Self::Kill("control"),
        Self::Stop("control"),
        Self::Kill("perception"),
        Self::Stop("perception"),
        Self::Kill(SUPERVISOR),
        Self::Stop(SUPERVISOR),
        Self::Kill("recorder"),
        Self::Stop("recorder"),
        Self::Kill("console"),
        Self::Stop("console"),
        Self::Silence,
        Self::NanInjection,
        Self::Garbage,
        Self::Flood,
    ];

    /// Name in the printed table, which the option `--fault` takes.
    pub fn name(self) -> String {
        match self {
            Self::Kill(process) => format!("kill-{process}"),
            Self::Stop(process) => format!("stop-{process}"),
            Self::Silence => "silent-camera".to_owned(),
            Self::NanInjection => "non-finite-pose".to_owned(),
            Self::Garbage => "garbage".to_owned(),
            Self::Flood => "full-queue".to_owned(),
        }
    }

    pub fn due(self) -> Due {
        match self {
            Self::Kill("control" | SUPERVISOR) | Self::Stop("control") => Due::OrdersEnd,
            Self::NanInjection => Due::FollowingEnds,
            Self::Kill("perception") | Self::Stop("perception") | Self::Silence => Due::PoseStale,
            Self::Flood => Due::GoesOnOrEnds,
            _ => Due::GoesOn,
        }
    }

    /// Whether the fault is a load on the far end itself.
    pub fn is_flood(self) -> bool {
        matches!(self, Self::Garbage | Self::Flood)
    }

    /// Whether the valves must follow again after the fault ends, without a command of a person.
    fn comes_back(self) -> bool {
        matches!(self, Self::Stop("control" | "perception") | Self::Silence)
    }

    /// The pipeline's text with the changes of all trials and those that this fault needs.
    fn prepare(self, mut text: String) -> String {
        for (from, to) in CHANGES {
            text = text.replace(from, to);
        }
        if self == Self::NanInjection {
            let nan_injection =
                "  poison: { use: bench.poison, inputs: { state: filter.state, said: console.fault } }\n";
            text = text
                .replace("state: filter.state", "state: poison.state")
                .replace("operators:\n", &format!("operators:\n{nan_injection}"))
                .replace("far_acknowledgement, target,", "far_acknowledgement, poison, target,");
        }
        text.replace("rig.truth,", "rig.truth, far.duties,")
    }

    /// Causes the fault and gives its time, ns since the epoch. A fault by command happens when the run has received
    /// the command.
    fn strike(self, run: &Program, valves: &str, registry: &Registry) -> Result<u64, Failure> {
        let struck = realtime();
        let say = |value: f64| {
            deliver(registry, &run.which(), "console", Verb::Fault, &[value]).map(|_| realtime())
        };
        match self {
            Self::Kill(process) => run.signal(process, Signal::KILL)?,
            Self::Stop(process) => run.signal(process, Signal::STOP)?,
            Self::Silence => return say(f64::from(RigFault::SilentCamera as u32)),
            // `bench.poison` acts on any command. This one ends the faults of the rig, which has none.
            Self::NanInjection => return say(0.0),
            Self::Garbage => {
                let mut noise = Noise::to(valves)?;
                (0..BURST).try_for_each(|length| noise.send(length % 200))?;
            }
            Self::Flood => {
                let (begun, mut noise) = (Instant::now(), Noise::to(valves)?);
                while begun.elapsed() < WATCHED {
                    (0..FLOOD).try_for_each(|_| noise.send(84))?;
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        }
        Ok(struck)
    }

    /// Ends the fault, if it can be ended from outside the run.
    fn mend(self, run: &Program, registry: &Registry) -> Result<(), Failure> {
        match self {
            Self::Stop(process) => run.signal(process, Signal::CONT),
            Self::Silence => deliver(registry, &run.which(), "console", Verb::Fault, &[0.0]).map(|_| ()),
            _ => Ok(()),
        }
    }
}

/// One run with a fault. Times are in ms.
#[derive(Debug)]
pub struct Trial {
    /// Evidence from the session.
    pub evidence: Evidence,
    /// Time for which the far end or the rig waited for a core after the fault: the longer of the two.
    pub bedside_waited_ms: f64,
    /// Whether the valves followed again after the end of the fault; `None` if the fault does not require it.
    pub came_back: Option<bool>,
}

impl Trial {
    /// Runs one trial and reads its session.
    pub fn of(fault: Fault, number: u64, folder: &Path, registry: &Registry) -> Result<Self, Failure> {
        let place = folder.join(number.to_string());
        let valves = program::write(&place, |text| fault.prepare(text))?;
        let mut run = Program::start(&place, &["--for", "60 s", "--record", "s"])?;
        run.treat(registry)?;
        // The fault of each trial comes at another phase of the frames and the timers.
        std::thread::sleep(Duration::from_millis(500 + (number * 37) % 100));
        // `strike` gives realtime. The stamps of a live session are realtime at its start plus monotonic time since.
        let waited = || BEDSIDE.map(|process| run.waited(process));
        let before = waited();
        let struck = fault.strike(&run, &valves, registry)?;
        std::thread::sleep(WATCHED.saturating_sub(Duration::from_nanos(realtime().saturating_sub(struck))));
        let mut bedside_waited = 0;
        for (before, after) in before.into_iter().zip(waited()) {
            bedside_waited = bedside_waited.max(after?.saturating_sub(before?));
        }
        fault.mend(&run, registry)?;
        let came_back = fault
            .comes_back()
            .then(|| run.wait(registry, |state| state.doing() == FarEndDoing::Following).is_ok());
        if came_back == Some(true) {
            // The session must contain the ramp of the duties after the return.
            std::thread::sleep(Duration::from_millis(200));
        }
        run.end()?;
        let evidence = Evidence::read(&place, struck, WATCHED);
        std::fs::remove_dir_all(&place).map_err(Failure::failed)?;
        Ok(Self { evidence: evidence?, bedside_waited_ms: bedside_waited as f64 * 1e-6, came_back })
    }

    /// Whether the session states the cause: a process that died, a reason of actuation, or refused datagrams.
    pub fn says_why(&self, fault: Fault) -> bool {
        use stillpoint_samples::ActuationReason as Reason;
        let e = &self.evidence;
        match fault {
            Fault::Kill(SUPERVISOR) => e.gaps.iter().any(|gap| gap.contains("supervisor died")),
            // If the run ends before the recorder is back, the session states the gap.
            Fault::Kill("recorder") => e.parts > 1 || e.gaps.iter().any(|gap| gap.contains("recorder died")),
            Fault::Kill(process) => e.died.iter().any(|p| p == process),
            Fault::Stop("control") => e.reasons & Reason::GAP != 0,
            Fault::Stop("perception") | Fault::Silence => {
                e.reasons & (Reason::POSE_STALE | Reason::NO_POSE) != 0
            }
            Fault::NanInjection => e.reasons & (Reason::POSE_NOT_FINITE | Reason::COMMAND_NOT_FINITE) != 0,
            Fault::Garbage | Fault::Flood => e.refused > 0,
            // The other stops have no effect on the valves, so the session need not state a cause.
            Fault::Stop(_) => true,
        }
    }
}

/// Sends datagrams of pseudo-random bytes.
struct Noise {
    socket: UdpSocket,
    to: String,
    state: u32,
}

impl Noise {
    fn to(address: &str) -> Result<Self, Failure> {
        let socket = UdpSocket::bind("127.0.0.1:0").map_err(Failure::failed)?;
        Ok(Self { socket, to: address.to_owned(), state: 0x9e37_79b9 })
    }

    fn send(&mut self, length: usize) -> Result<(), Failure> {
        let mut bytes = [0; 256];
        for byte in &mut bytes[..length.min(256)] {
            self.state = self.state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *byte = (self.state >> 24) as u8;
        }
        self.socket.send_to(&bytes[..length.min(256)], &self.to).map(|_| ()).map_err(Failure::failed)
    }
}
