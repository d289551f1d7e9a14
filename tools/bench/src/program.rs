//! The default pipeline as a separate program, which a measurement observes from outside and disturbs.

use std::fs::File;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{FarEnd, FarEndDoing, FarEndElement, Verb};

use super::RUN;
use super::processes::{children, waited};
use stillpoint::Failure;
use stillpoint::deliver;
use stillpoint::{Attached, Which};
use stillpoint::{EMBEDDED, EMBEDDED_FILES};

/// The ports in the pipeline's file: that of the valves, and that of the beam.
const PORTS: [&str; 2] = ["127.0.0.1:5005", "127.0.0.1:5006"];
/// Their address.
const HERE: &str = "127.0.0.1";
/// Name of the pipeline's file.
const FILE: &str = "loop.yaml";
/// What the run says on standard error.
const SAID: &str = "said.txt";
/// Name of the process that started the others.
pub const SUPERVISOR: &str = "supervisor";
/// How long a run may take to follow orders.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long it may take to end: its recorder waits for the disk, which others may keep busy.
const END_PATIENCE: Duration = Duration::from_secs(180);
/// How long it is waited for the beam before a person arms once more.
const NUDGE: Duration = Duration::from_secs(4);

/// Writes the pipeline into a folder, changed, at an address that no other run has. Gives where datagrams for the valves
/// go.
pub fn write(folder: &Path, change: impl Fn(String) -> String) -> Result<String, Failure> {
    let io = |e: std::io::Error| Failure::failed(format!("{}: {e}", folder.display()));
    for (name, bytes) in EMBEDDED_FILES {
        let file = folder.join(name);
        std::fs::create_dir_all(file.parent().unwrap_or(folder)).map_err(io)?;
        std::fs::write(file, bytes).map_err(io)?;
    }
    let address = own_address().to_string();
    let mut text = change(EMBEDDED.to_owned());
    for port in PORTS {
        text = text.replace(port, &port.replace(HERE, &address));
    }
    std::fs::write(folder.join(FILE), text).map_err(io)?;
    Ok(PORTS[0].replace(HERE, &address))
}

/// An address of this machine's loopback network that no other run has: a port that was free a moment ago may be
/// somebody else's by the time it is bound.
fn own_address() -> Ipv4Addr {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let [.., high, low] = std::process::id().to_be_bytes();
    let run = RUNS.fetch_add(1, Ordering::Relaxed) % 250;
    Ipv4Addr::new(127, high, low, 1 + run as u8)
}

/// A run of it. Its supervisor is a process of its own, too: it may be struck.
pub struct Program {
    child: Child,
    folder: PathBuf,
    /// Its processes by name.
    processes: Vec<(String, Pid)>,
}

impl Program {
    /// Starts what stands in the folder, with these arguments besides.
    pub fn start(folder: &Path, arguments: &[&str]) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let child = Command::new(program)
            .args([RUN, FILE, "--json"])
            .args(arguments)
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(folder.join(SAID)).map_err(Failure::failed)?)
            .spawn()
            .map_err(Failure::failed)?;
        Ok(Self { child, folder: folder.to_owned(), processes: Vec::new() })
    }

    /// Which run it is.
    pub fn which(&self) -> Which {
        Which { run: Some(self.child.id().to_string()) }
    }

    /// Joins it.
    pub fn attach(&self, registry: &Registry) -> Result<Attached, Failure> {
        self.which().attach(registry)
    }

    /// Waits until orders are followed with the beam on. Where the script's arm came too early for a busy machine, a
    /// person arms.
    pub fn treat(&mut self, registry: &Registry) -> Result<(), Failure> {
        let treats = |state: &FarEndElement| state.doing() == FarEndDoing::Following && state.beam == 1;
        self.wait_with(registry, treats, &mut |which| {
            for verb in [Verb::Confirm, Verb::Resume, Verb::Arm] {
                // It may not be there yet: it is said again.
                let _ = deliver(registry, which, "console", verb, &[]);
            }
        })
    }

    /// Waits until the far end is as it is to be; says why it is not, if that takes too long or the run ends.
    pub fn wait(
        &mut self,
        registry: &Registry,
        is_so: impl Fn(&FarEndElement) -> bool,
    ) -> Result<(), Failure> {
        self.wait_with(registry, is_so, &mut |_| {})
    }

    fn wait_with(
        &mut self,
        registry: &Registry,
        is_so: impl Fn(&FarEndElement) -> bool,
        nudge: &mut dyn FnMut(&Which),
    ) -> Result<(), Failure> {
        let begun = Instant::now();
        let mut nudged = begun;
        loop {
            let looked = self.look(registry);
            if let Ok(Some(state)) = &looked
                && is_so(state)
            {
                self.processes = children(self.child.id());
                return Ok(());
            }
            if let Some(status) = self.child.try_wait().map_err(Failure::failed)? {
                let said = std::fs::read_to_string(self.folder.join(SAID)).unwrap_or_default();
                return Err(Failure::failed(format!(
                    "a run ended before it followed orders: {status}: {said}"
                )));
            }
            if begun.elapsed() > PATIENCE {
                let why = match looked {
                    Err(e) => e.text,
                    Ok(None) => "its far end says nothing".to_owned(),
                    Ok(Some(state)) => format!("its far end says {state:?}"),
                };
                return Err(Failure::failed(format!("a run does not come to follow orders: {why}")));
            }
            if nudged.elapsed() > NUDGE {
                nudge(&self.which());
                nudged = Instant::now();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// What the far end says; `None` where it says nothing.
    fn look(&self, registry: &Registry) -> Result<Option<FarEndElement>, Failure> {
        let attached = self.attach(registry)?;
        let Some((operator, port)) = attached.graph.topic("far.state") else { return Ok(None) };
        let contract = contracts::output(&attached.graph, operator, port);
        let topic = stillpoint_shm::Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
        let subscriber = topic.subscriber(contracts::TAP_DEPTH).map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(200) {
            if let Some(sample) = subscriber.receive().map_err(Failure::failed)?
                && let Ok(view) = sample.pieces().view::<FarEnd>()
            {
                return Ok(view.first().copied());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(None)
    }

    /// Sends a signal to one of its processes.
    pub fn signal(&self, process: &str, signal: Signal) -> Result<(), Failure> {
        kill_process(self.pid(process)?, signal).map_err(Failure::failed)
    }

    /// How long one of its processes has waited for a core so far, ns.
    pub fn waited(&self, process: &str) -> Result<u64, Failure> {
        self.pid(process).map(waited)
    }

    fn pid(&self, process: &str) -> Result<Pid, Failure> {
        if process == SUPERVISOR {
            let number = i32::try_from(self.child.id()).ok();
            return number.and_then(Pid::from_raw).ok_or_else(|| Failure::failed("no process"));
        }
        let found = self.processes.iter().find(|(name, _)| name == process);
        found.map(|(_, pid)| *pid).ok_or_else(|| Failure::failed(format!("the run has no process {process}")))
    }

    /// Ends the run, and waits until all of it is over.
    pub fn end(&mut self) -> Result<(), Failure> {
        let _ = self.signal(SUPERVISOR, Signal::INT);
        let begun = Instant::now();
        let lives = |pid: &Pid| Path::new(&format!("/proc/{}", pid.as_raw_nonzero())).exists();
        while self.child.try_wait().map_err(Failure::failed)?.is_none()
            || self.processes.iter().any(|(_, pid)| lives(pid))
        {
            if begun.elapsed() > END_PATIENCE {
                return Err(Failure::failed("the run does not end"));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
