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

/// What is changed in the pipeline's text: a quarter of the pixels, and a head that stays where it is, so that the beam
/// stays on.
const CHANGES: &[(&str, &str)] = &[
    (
        "camera: { every: 100 ms }",
        "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
    ),
    ("at: 2.5 s, z:", "at: 1 h, z:"),
];
/// How long the effect of a fault is watched.
const WATCHED: Duration = Duration::from_millis(700);
/// The processes that stand for hardware with its own processors.
const BEDSIDE: [&str; 2] = ["bedside", "rig"];
/// Datagrams of a burst, and of each millisecond of a flood.
const BURST: usize = 500;
const FLOOD: usize = 200;

/// A fault of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// SIGKILL to this process.
    Kill(&'static str),
    /// SIGSTOP to it.
    Stop(&'static str),
    /// The camera falls silent.
    Silence,
    /// The pose is not finite any more.
    Poison,
    /// Datagrams that nobody of this run has sent, at once.
    Garbage,
    /// The same without end: every queue on the way is full.
    Flood,
}

/// The required reaction to a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Due {
    /// Orders end: safe 100 ms after the last one that arrived.
    OrdersEnd,
    /// Orders to follow end: safe 100 ms after the last of them was obeyed.
    FollowingEnds,
    /// The pose grows stale, or its reference is lost: safe 100 ms after three frame periods.
    PoseStale,
    /// The valves go on following.
    GoesOn,
    /// They go on, or are safe 100 ms after the last order that got through.
    GoesOnOrEnds,
}

impl Fault {
    /// All that are tried: every process but those at the bedside, and what comes over the wires.
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
        Self::Poison,
        Self::Garbage,
        Self::Flood,
    ];

    /// Its name.
    pub fn name(self) -> String {
        match self {
            Self::Kill(process) => format!("kill-{process}"),
            Self::Stop(process) => format!("stop-{process}"),
            Self::Silence => "silent-camera".to_owned(),
            Self::Poison => "non-finite-pose".to_owned(),
            Self::Garbage => "garbage".to_owned(),
            Self::Flood => "full-queue".to_owned(),
        }
    }

    /// The required reaction.
    pub fn due(self) -> Due {
        match self {
            Self::Kill("control" | SUPERVISOR) | Self::Stop("control") => Due::OrdersEnd,
            Self::Poison => Due::FollowingEnds,
            Self::Kill("perception") | Self::Stop("perception") | Self::Silence => Due::PoseStale,
            Self::Flood => Due::GoesOnOrEnds,
            _ => Due::GoesOn,
        }
    }

    /// Whether it is the bedside itself that is kept busy.
    pub fn is_flood(self) -> bool {
        matches!(self, Self::Garbage | Self::Flood)
    }

    /// Whether what failed is followed again when it comes back, without a person.
    fn comes_back(self) -> bool {
        matches!(self, Self::Stop("control" | "perception") | Self::Silence)
    }

    /// The pipeline with what it needs to fail so.
    fn prepare(self, mut text: String) -> String {
        for (from, to) in CHANGES {
            text = text.replace(from, to);
        }
        if self == Self::Poison {
            let poison =
                "  poison: { use: bench.poison, inputs: { state: filter.state, said: console.fault } }\n";
            text = text
                .replace("state: filter.state", "state: poison.state")
                .replace("operators:\n", &format!("operators:\n{poison}"))
                .replace("control: [target,", "control: [poison, target,");
        }
        text.replace("rig.truth,", "rig.truth, far.duties,")
    }

    /// Does it. Gives when: of what a person says, when the run has heard it.
    fn strike(self, run: &Program, valves: &str, registry: &Registry) -> Result<u64, Failure> {
        let struck = realtime();
        let say = |value: f64| {
            deliver(registry, &run.which(), "console", Verb::Fault, &[value]).map(|_| realtime())
        };
        match self {
            Self::Kill(process) => run.signal(process, Signal::KILL)?,
            Self::Stop(process) => run.signal(process, Signal::STOP)?,
            Self::Silence => return say(f64::from(RigFault::SilentCamera as u32)),
            // Any command: the rig has nothing to mend.
            Self::Poison => return say(0.0),
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

    /// Takes it back, as far as that can be done from outside.
    fn mend(self, run: &Program, registry: &Registry) -> Result<(), Failure> {
        match self {
            Self::Stop(process) => run.signal(process, Signal::CONT),
            Self::Silence => deliver(registry, &run.which(), "console", Verb::Fault, &[0.0]).map(|_| ()),
            _ => Ok(()),
        }
    }
}

/// Times of a run, ms from its fault, and what its session says.
#[derive(Debug)]
pub struct Trial {
    /// What the session holds.
    pub evidence: Evidence,
    /// The longest that a process at the bedside waited for a core meanwhile.
    pub bedside_waited_ms: f64,
    /// What failed came back, and was followed again.
    pub came_back: Option<bool>,
}

impl Trial {
    /// Makes one.
    pub fn of(fault: Fault, number: u64, folder: &Path, registry: &Registry) -> Result<Self, Failure> {
        let place = folder.join(number.to_string());
        let valves = program::write(&place, |text| fault.prepare(text))?;
        let mut run = Program::start(&place, &["--for", "60 s", "--record", "s"])?;
        run.treat(registry)?;
        // Another moment of the frame's and the timers' periods each time.
        std::thread::sleep(Duration::from_millis(500 + (number * 37) % 100));
        // Stamps of a live session are of this clock, as it was when the run began.
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
            // The ramp of what came back.
            std::thread::sleep(Duration::from_millis(200));
        }
        run.end()?;
        let evidence = Evidence::read(&place, struck, WATCHED);
        std::fs::remove_dir_all(&place).map_err(Failure::failed)?;
        Ok(Self { evidence: evidence?, bedside_waited_ms: bedside_waited as f64 * 1e-6, came_back })
    }

    /// Whether the session says why: a death, a reason of actuation, or what was refused.
    pub fn says_why(&self, fault: Fault) -> bool {
        use stillpoint_samples::ActuationReason as Reason;
        let e = &self.evidence;
        match fault {
            Fault::Kill(SUPERVISOR) => e.gaps.iter().any(|gap| gap.contains("supervisor died")),
            // A run that ends before the recorder is back says what it lacks.
            Fault::Kill("recorder") => e.parts > 1 || e.gaps.iter().any(|gap| gap.contains("recorder died")),
            Fault::Kill(process) => e.died.iter().any(|p| p == process),
            Fault::Stop("control") => e.reasons & Reason::GAP != 0,
            Fault::Stop("perception") | Fault::Silence => {
                e.reasons & (Reason::POSE_STALE | Reason::NO_POSE) != 0
            }
            Fault::Poison => e.reasons & (Reason::POSE_NOT_FINITE | Reason::COMMAND_NOT_FINITE) != 0,
            Fault::Garbage | Fault::Flood => e.refused > 0,
            // Nothing happened to the valves: there is nothing to say.
            Fault::Stop(_) => true,
        }
    }
}

/// Datagrams of noise.
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
