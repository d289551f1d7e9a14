//! One live run in which something dies, stops or is flooded, and what its session says about it.

use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use stillpoint_pipeline::clock::realtime;
use stillpoint_pipeline::live::contracts;
use stillpoint_pipeline::operator::Registry;
use stillpoint_recorder::Session;
use stillpoint_samples::{FarEnd, FarEndDoing, Pieces, RigState, Sample, Track};

use super::failsafe::Due;
use super::processes::children;
use crate::attach::Which;
use crate::exit::Failure;

/// The default pipeline, its key, and the ports that it has in the file.
const PIPELINE: &str = include_str!("../../../pipeline.yaml");
const KEY: &str = include_str!("../../../examples/data/rig.key");
const PORTS: [&str; 2] = ["127.0.0.1:5005", "127.0.0.1:5006"];
/// A quarter of the pixels: a bench of deadlines needs no more.
const CAMERA: [&str; 2] = [
    "camera: { every: 100 ms }",
    "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
];
/// How long a run may take to follow orders, and to end.
const PATIENCE: Duration = Duration::from_secs(30);
/// How long the effect of a fault is watched.
const WATCHED: Duration = Duration::from_millis(700);

/// What happens to a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// SIGKILL to this process.
    Kill(&'static str),
    /// SIGSTOP to it.
    Stop(&'static str),
    /// Datagrams that nobody of this run has sent.
    Garbage,
}

/// Name of the process that started the others.
const SUPERVISOR: &str = "supervisor";

impl Fault {
    /// All that are tried: every process but those at the bedside.
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
        Self::Garbage,
    ];

    /// What it is called.
    pub fn name(&self) -> String {
        match self {
            Self::Kill(process) => format!("kill-{process}"),
            Self::Stop(process) => format!("stop-{process}"),
            Self::Garbage => "garbage".to_owned(),
        }
    }

    /// What is due after it.
    pub fn due(&self) -> Due {
        match self {
            Self::Kill("control" | SUPERVISOR) | Self::Stop("control") => Due::OrdersEnd,
            Self::Kill("perception") | Self::Stop("perception") => Due::PoseStale,
            _ => Due::GoesOn,
        }
    }
}

/// Times of a run, ms from its fault.
#[derive(Debug)]
pub struct Trial {
    /// When the last order arrived before the far end vented, or at all.
    pub last_order_ms: f64,
    /// When the frame of the last pose before that was taken.
    pub last_pose_ms: f64,
    /// When the far end first vented; none where it did not.
    pub vents_ms: Option<f64>,
    /// When the valves were first safe after that: inlets shut, outlets at least half open.
    pub valves_ms: Option<f64>,
    /// When the beam was first off; none where it stayed on or never was.
    pub beam_ms: Option<f64>,
}

impl Trial {
    /// Makes one.
    pub fn of(fault: Fault, number: u64, folder: &Path, registry: &Registry) -> Result<Self, Failure> {
        let io = |e: std::io::Error| Failure::failed(format!("{}: {e}", folder.display()));
        let place = folder.join(number.to_string());
        std::fs::create_dir_all(place.join("examples/data")).map_err(io)?;
        std::fs::write(place.join("examples/data/rig.key"), KEY).map_err(io)?;
        // The head stays where it is, so that the beam stays on.
        let mut text = PIPELINE.replace(CAMERA[0], CAMERA[1]).replace("at: 2.5 s, z:", "at: 1 h, z:");
        let mut valves = String::new();
        for port in PORTS {
            let free = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).map_err(io)?.to_string();
            text = text.replace(port, &free);
            valves = if valves.is_empty() { free } else { valves };
        }
        std::fs::write(place.join("pipeline.yaml"), text).map_err(io)?;
        let mut run = Casualty::start(&place)?;
        run.follow(registry)?;
        // Another moment of the frame's and the timers' periods each time.
        std::thread::sleep(Duration::from_millis(500 + (number * 37) % 100));
        // Stamps of a live session are of this clock, as it was when the run began.
        let struck = realtime();
        run.strike(fault, &valves)?;
        std::thread::sleep(WATCHED);
        run.end(fault)?;
        let trial = Self::read(&place.join("s/head-3dof-0001"), struck);
        std::fs::remove_dir_all(&place).map_err(io)?;
        trial
    }

    fn read(session: &Path, struck: u64) -> Result<Self, Failure> {
        let session = Session::open_any(session).map_err(Failure::failed)?;
        let until = struck + WATCHED.as_nanos() as u64;
        let after = |stamp: u64| (stamp as f64 - struck as f64) * 1e-6;
        let mut trial = Self {
            last_order_ms: f64::NAN,
            last_pose_ms: f64::NAN,
            vents_ms: None,
            valves_ms: None,
            beam_ms: None,
        };
        let mut rig = Vec::new();
        let mut poses = Vec::new();
        for topic in ["far.state", "rig.state", "filter.state"] {
            for recorded in session.samples_where(|t| t.name == topic) {
                let recorded = recorded.map_err(Failure::failed)?;
                let bytes = &recorded.sample;
                match topic {
                    "far.state" => {
                        let view = view::<FarEnd>(bytes)?;
                        let (Some(state), stamp) = (view.first(), view.head.stamp) else { continue };
                        if stamp > until || trial.vents_ms.is_some() {
                            continue;
                        }
                        trial.last_order_ms = after(state.arrived);
                        if stamp > struck && state.doing() == FarEndDoing::Venting {
                            trial.vents_ms = Some(after(stamp));
                        }
                        if stamp > struck && state.beam == 0 && trial.beam_ms.is_none() {
                            trial.beam_ms = Some(after(stamp));
                        }
                    }
                    "rig.state" => {
                        let view = view::<RigState>(bytes)?;
                        let Some(state) = view.first() else { continue };
                        let valves = &state.opening[..2 * (state.bladders as usize).min(8)];
                        let safe = valves.chunks_exact(2).all(|pair| pair[0] <= 0.05 && pair[1] >= 0.5);
                        rig.push((view.head.stamp, safe));
                    }
                    _ => {
                        let view = view::<Track>(bytes)?;
                        poses.push((view.head.stamp, view.head.origin));
                    }
                }
            }
        }
        let vents = trial.vents_ms.unwrap_or(f64::INFINITY);
        trial.valves_ms = rig
            .iter()
            .map(|(stamp, safe)| (after(*stamp), *safe))
            .find(|(at, safe)| *at >= vents && *safe)
            .map(|(at, _)| at);
        let watched = vents.min(WATCHED.as_secs_f64() * 1e3);
        let before =
            poses.iter().filter(|(stamp, _)| after(*stamp) < watched).map(|(_, origin)| after(*origin));
        trial.last_pose_ms = before.fold(f64::NAN, f64::max);
        Ok(trial)
    }
}

fn view<S: Sample>(bytes: &[u8]) -> Result<stillpoint_samples::View<'_, S>, Failure> {
    Pieces::split(S::KIND, bytes).and_then(|p| p.view::<S>()).map_err(Failure::failed)
}

/// A run in a process of its own: its supervisor is to die.
struct Casualty {
    child: Child,
    /// Its processes by name.
    processes: Vec<(String, Pid)>,
}

impl Casualty {
    fn start(place: &Path) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let child = Command::new(program)
            .args(["run", "--for", "60 s", "--json", "--record", "s"])
            .current_dir(place)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .map_err(Failure::failed)?;
        Ok(Self { child, processes: Vec::new() })
    }

    /// Waits until the valves follow and the beam is on.
    fn follow(&mut self, registry: &Registry) -> Result<(), Failure> {
        let begun = Instant::now();
        loop {
            let looked = self.look(registry);
            if let Ok(Some(true)) = looked {
                self.processes = children(self.child.id());
                return Ok(());
            }
            if begun.elapsed() > PATIENCE || self.child.try_wait().map_err(Failure::failed)?.is_some() {
                let why = match looked {
                    Err(e) => e.text,
                    Ok(None) => "its far end says nothing".to_owned(),
                    Ok(Some(_)) => "the beam stays off".to_owned(),
                };
                return Err(Failure::failed(format!("a run does not come to follow orders: {why}")));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Whether the far end follows orders with the beam on; `None` where it says nothing.
    fn look(&self, registry: &Registry) -> Result<Option<bool>, Failure> {
        let attached = Which { run: Some(self.child.id().to_string()) }.attach(registry)?;
        let Some((operator, port)) = attached.graph.topic("far.state") else { return Ok(None) };
        let contract = contracts::output(&attached.graph, operator, port);
        let topic = stillpoint_shm::Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
        let subscriber = topic.subscriber(contracts::TAP_DEPTH).map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(200) {
            if let Some(sample) = subscriber.receive().map_err(Failure::failed)?
                && let Ok(view) = sample.pieces().view::<FarEnd>()
                && let Some(state) = view.first()
            {
                return Ok(Some(state.doing() == FarEndDoing::Following && state.beam == 1));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(None)
    }

    fn pid(&self, process: &str) -> Result<Pid, Failure> {
        if process == SUPERVISOR {
            return i32::try_from(self.child.id())
                .ok()
                .and_then(Pid::from_raw)
                .ok_or_else(|| Failure::failed("no process"));
        }
        let found = self.processes.iter().find(|(name, _)| name == process);
        found.map(|(_, pid)| *pid).ok_or_else(|| Failure::failed(format!("the run has no process {process}")))
    }

    fn strike(&self, fault: Fault, valves: &str) -> Result<(), Failure> {
        match fault {
            Fault::Kill(process) => kill_process(self.pid(process)?, Signal::KILL).map_err(Failure::failed),
            Fault::Stop(process) => kill_process(self.pid(process)?, Signal::STOP).map_err(Failure::failed),
            Fault::Garbage => {
                let socket = UdpSocket::bind("127.0.0.1:0").map_err(Failure::failed)?;
                let mut noise = 0x9e37_79b9_u32;
                for length in 0..500 {
                    let bytes: Vec<u8> = (0..length % 200)
                        .map(|_| {
                            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                            (noise >> 24) as u8
                        })
                        .collect();
                    socket.send_to(&bytes, valves).map_err(Failure::failed)?;
                }
                Ok(())
            }
        }
    }

    /// Ends the run, and waits until all of it is over.
    fn end(&mut self, fault: Fault) -> Result<(), Failure> {
        if let Fault::Stop(process) = fault {
            kill_process(self.pid(process)?, Signal::CONT).map_err(Failure::failed)?;
        }
        let _ = kill_process(self.pid(SUPERVISOR)?, Signal::INT);
        let begun = Instant::now();
        let lives = |pid: &Pid| Path::new(&format!("/proc/{}", pid.as_raw_nonzero())).exists();
        while self.child.try_wait().map_err(Failure::failed)?.is_none()
            || self.processes.iter().any(|(_, pid)| lives(pid))
        {
            if begun.elapsed() > PATIENCE {
                return Err(Failure::failed("the run does not end"));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

impl Drop for Casualty {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
