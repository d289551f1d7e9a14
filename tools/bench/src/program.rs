//! A pipeline as a separate program, which a measurement observes and disturbs from outside.

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

use super::COMMAND;
use super::figures::Ages;
use super::processes::{children, waited};
use super::stages::Load;
use stillpoint::Failure;
use stillpoint::deliver;
use stillpoint::{Attached, Tap, Which};
use stillpoint::{EMBEDDED, EMBEDDED_FILES};

/// Addresses in the pipeline's file: of the valves, of the beam, and of the acknowledgements.
const PORTS: [&str; 3] = ["127.0.0.1:5005", "127.0.0.1:5006", "127.0.0.1:5008"];
/// IP address in all of them.
const HERE: &str = "127.0.0.1";
/// Name of the pipeline's file.
const FILE: &str = "loop.yaml";
/// Name of the file with the standard error of the run.
const OUTPUT: &str = "said.txt";
/// Name of the supervisor's process.
pub const SUPERVISOR: &str = "supervisor";
/// Maximum time until the far end has the state that is waited for.
const PATIENCE: Duration = Duration::from_secs(60);
/// Maximum time until a run has ended. Its recorder waits for the disk, which other programs may keep busy.
const END_PATIENCE: Duration = Duration::from_secs(180);
/// Time without the beam after which the commands to arm are sent again.
const NUDGE: Duration = Duration::from_secs(4);

/// Writes the changed pipeline and its files into a folder, with an IP address that no other run has. Gives the address
/// of the valves.
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

/// A loopback address that no other run has. A free port of a shared address would not do: another program may bind it
/// before the run does.
fn own_address() -> Ipv4Addr {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let [.., high, low] = std::process::id().to_be_bytes();
    let run = RUNS.fetch_add(1, Ordering::Relaxed) % 250;
    Ipv4Addr::new(127, high, low, 1 + run as u8)
}

/// The ages that a sink sends from now on, for this time.
pub fn ages(sink: &Tap, length: Duration) -> Result<Ages, Failure> {
    while sink.next()?.is_some() {}
    let (begun, mut found) = (Instant::now(), Ages::default());
    while begun.elapsed() < length {
        std::thread::sleep(Duration::from_millis(10));
        while let Some(sample) = sink.next()? {
            if let Ok(view) = sample.pieces().view::<Load>() {
                found.take(view.elements.iter().map(|w| w.word));
            }
        }
    }
    Ok(found)
}

/// A run of a pipeline. Its supervisor is a separate process, too, because a fault may kill or stop it.
pub struct Program {
    child: Child,
    folder: PathBuf,
    /// Names and numbers of the processes of the run.
    processes: Vec<(String, Pid)>,
}

impl Program {
    /// Starts a pipeline of this text in the folder, with these additional arguments.
    pub fn of(text: &str, folder: &Path, arguments: &[&str]) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(folder.join(FILE), text))
            .map_err(|e| Failure::failed(format!("{}: {e}", folder.display())))?;
        Self::start(folder, arguments)
    }

    /// Starts the pipeline in the folder, with these additional arguments.
    pub fn start(folder: &Path, arguments: &[&str]) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let child = Command::new(program)
            .args([COMMAND, "run", FILE, "--json"])
            .args(arguments)
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(folder.join(OUTPUT)).map_err(Failure::failed)?)
            .spawn()
            .map_err(Failure::failed)?;
        Ok(Self { child, folder: folder.to_owned(), processes: Vec::new() })
    }

    /// Selection of this run among the runs of the machine.
    pub fn which(&self) -> Which {
        Which { run: Some(self.child.id().to_string()) }
    }

    /// Waits until a topic of the run can be read, and reads it from then on. Fails if the run ends.
    pub fn tap(&mut self, registry: &Registry, topic: &str) -> Result<(Attached, Tap), Failure> {
        let begun = Instant::now();
        loop {
            let tapped = self.attach(registry).and_then(|attached| {
                let (tap, _) = Tap::of_topic(&attached, topic)?;
                Ok((attached, tap))
            });
            if let Ok((attached, tap)) = tapped {
                return Ok((attached, tap));
            }
            if let Some(status) = self.child.try_wait().map_err(Failure::failed)? {
                let message = std::fs::read_to_string(self.folder.join(OUTPUT)).unwrap_or_default();
                return Err(Failure::failed(format!("a run ended before it began: {status}: {message}")));
            }
            if begun.elapsed() > PATIENCE {
                return tapped;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The processes of the run with its supervisor.
    pub fn processes(&mut self) -> Vec<(String, Pid)> {
        self.processes = children(self.child.id());
        let supervisor = self.pid(SUPERVISOR).ok().map(|pid| (SUPERVISOR.to_owned(), pid));
        self.processes.iter().cloned().chain(supervisor).collect()
    }

    /// Attaches to the run.
    pub fn attach(&self, registry: &Registry) -> Result<Attached, Failure> {
        self.which().attach(registry)
    }

    /// Waits until the far end follows orders with the beam on. On a busy machine the script may arm too early. Then
    /// this function sends the commands to confirm, to resume and to arm.
    pub fn treat(&mut self, registry: &Registry) -> Result<(), Failure> {
        let treats = |state: &FarEndElement| state.doing() == FarEndDoing::Following && state.beam == 1;
        self.wait_with(registry, treats, &mut |which| {
            for verb in [Verb::Confirm, Verb::Resume, Verb::Arm] {
                // The run may not have started yet. The next attempt sends the command again.
                let _ = deliver(registry, which, "console", verb, &[]);
            }
        })
    }

    /// Waits until the state of the far end satisfies `is_so`. The error gives the last state if that takes too long,
    /// and the standard error if the run ends.
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
                let message = std::fs::read_to_string(self.folder.join(OUTPUT)).unwrap_or_default();
                return Err(Failure::failed(format!(
                    "a run ended before it followed orders: {status}: {message}"
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

    /// State of the far end; `None` if no sample arrives within 200 ms.
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

    /// Sends a signal to a process of the run.
    pub fn signal(&self, process: &str, signal: Signal) -> Result<(), Failure> {
        kill_process(self.pid(process)?, signal).map_err(Failure::failed)
    }

    /// Total time for which a process of the run has waited for a core, ns.
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

    /// Ends the run, and waits until all its processes have exited.
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
