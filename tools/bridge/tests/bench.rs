//! A folder in which the programs are run as people run them.

use std::fs::File;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use serde_json::Value;

/// However loaded the machine is, nothing takes longer.
const PATIENCE: Duration = Duration::from_secs(120);

/// The program `stillpoint` of this source folder.
fn stillpoint() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        if let Some(named) = std::env::var_os("STILLPOINT") {
            return named.into();
        }
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let built = Command::new(cargo)
            .args(["build", "--locked", "--workspace", "--bin", "stillpoint", "--message-format=json"])
            .current_dir(root)
            .env_remove("CARGO_TARGET_DIR")
            .stderr(Stdio::inherit())
            .output()
            .unwrap();
        assert!(built.status.success(), "stillpoint cannot be built");
        let lines = String::from_utf8(built.stdout).unwrap();
        let messages = lines.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let mut programs = messages.filter_map(|m| Some(PathBuf::from(m["executable"].as_str()?)));
        programs.find(|p| p.ends_with("stillpoint")).expect("cargo names the program")
    })
}

/// Waits on a thing until it is there.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < PATIENCE, "waited too long for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Two ports that follow each other and that nobody has, below those that the system gives away.
pub fn two_ports() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 14_000 + (std::process::id() % 400) as u16 * 40;
    loop {
        let port = first + NEXT.fetch_add(2, Ordering::Relaxed);
        let is_free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok();
        if is_free(port) && is_free(port + 1) {
            return port;
        }
    }
}

/// Ports of UDP that nobody has.
pub fn udp_ports<const N: usize>() -> [u16; N] {
    // Held until all are chosen, so that no two are the same.
    let held: [UdpSocket; N] = std::array::from_fn(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
    held.map(|socket| socket.local_addr().unwrap().port())
}

/// A folder with its own runs: parallel tests do not see each other.
pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Self {
        // Short: the paths of sockets below it may have 108 bytes.
        let folder = tempfile::Builder::new().prefix("sb").tempdir().unwrap();
        std::fs::DirBuilder::new().mode(0o700).create(folder.path().join("r")).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file, and gives its path.
    pub fn write(&self, name: &str, text: &str) -> String {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Starts `stillpoint`.
    pub fn start(&self, arguments: &[&str]) -> Running {
        self.start_with_bridge(arguments, env!("CARGO_BIN_EXE_stillpoint-bridge"))
    }

    pub fn start_with_bridge(&self, arguments: &[&str], bridge: &str) -> Running {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let (out, err) = (self.path(&format!("{number}.out")), self.path(&format!("{number}.err")));
        let child = Command::new(stillpoint())
            .args(arguments)
            .env("STILLPOINT_RUNS", self.path("r"))
            .env("STILLPOINT_BRIDGE", bridge)
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .stdout(File::create(&out).unwrap())
            .stderr(File::create(&err).unwrap())
            .process_group(0)
            .spawn()
            .unwrap();
        Running { child, out, err }
    }

    pub fn call(&self, arguments: &[&str]) -> Done {
        self.start(arguments).finish()
    }

    /// Starts the part of a host, recorded.
    pub fn host(&self, file: &str, host: &str) -> Running {
        self.start(&["run", file, "--host", host, "--json", "--record", "s"])
    }

    /// Waits until so many new samples were sent on a topic of the run of this name.
    pub fn wait_for_samples(&self, run: &str, topic: &str, count: u32) {
        wait_for(topic, || {
            let done = self.call(&["echo", "--json", "--run", run, topic, "--count", &count.to_string()]);
            (done.status.success() && done.out.lines().count() == count as usize).then_some(())
        });
    }

    /// The samples of a topic in a session.
    pub fn samples(&self, session: &str, topic: &str) -> Vec<Value> {
        let done = self.call(&["echo", "--json", topic, "--session", session]);
        assert!(done.status.success(), "{}", done.err);
        done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

impl Drop for Bench {
    /// Takes away what runs left whose supervisor was killed.
    fn drop(&mut self) {
        for run in std::fs::read_dir(self.path("r")).unwrap().flatten() {
            let id = run.file_name().to_string_lossy().into_owned();
            stillpoint_shm::sweep(&run.path().join("d"), &format!("sp_{id}_"));
        }
    }
}

/// How a command ended.
pub struct Done {
    pub status: ExitStatus,
    pub out: String,
    pub err: String,
}

impl Done {
    /// The JSON of a command that went well.
    pub fn good(&self) -> Value {
        assert!(self.status.success(), "{}\n{}", self.out, self.err);
        serde_json::from_str(&self.out).unwrap()
    }
}

/// A command that is under way.
pub struct Running {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

impl Running {
    /// Waits until these words stand on its standard error.
    pub fn wait_for_words(&self, words: &str) {
        wait_for(words, || std::fs::read_to_string(&self.err).unwrap().contains(words).then_some(()));
    }

    /// What it has printed so far on its standard output.
    pub fn printed(&self) -> String {
        std::fs::read_to_string(&self.out).unwrap()
    }

    /// Waits until these words stand on its standard error after the first place of other ones.
    pub fn wait_for_words_after(&self, first: &str, words: &str) {
        wait_for(words, || {
            let text = std::fs::read_to_string(&self.err).unwrap();
            text.split_once(first)?.1.contains(words).then_some(())
        });
    }

    /// Whether it has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Waits for its end.
    pub fn finish(mut self) -> Done {
        let status = wait_for("the end of a command", || self.child.try_wait().unwrap());
        let read = |path: &Path| std::fs::read_to_string(path).unwrap();
        Done { status, out: read(&self.out), err: read(&self.err) }
    }

    /// Ends a run in order.
    pub fn stop(self) -> Done {
        send(self.child.id(), Signal::INT);
        self.finish()
    }

    /// Process number of a child by its name, other than `before`.
    fn child_of(&self, name: &str, before: u32) -> u32 {
        let parent = self.child.id().to_string();
        wait_for(name, || {
            std::fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
                let number: u32 = entry.file_name().to_str()?.parse().ok()?;
                let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
                let mut rest = stat.rsplit_once(')')?.1.split_whitespace();
                let (state, of) = (rest.next()?, rest.next()?);
                let line = std::fs::read(entry.path().join("cmdline")).ok()?;
                let is_it = line.split(|b| *b == 0).nth(2)? == name.as_bytes();
                (is_it && of == parent && state != "Z" && number != before).then_some(number)
            })
        })
    }

    /// Kills a child, and waits for the one that follows it.
    pub fn kill_child(&self, name: &str) {
        let number = self.child_of(name, 0);
        send(number, Signal::KILL);
        self.child_of(name, number);
    }

    /// Kills the whole run as a power failure would: the supervisor, whose end is the end of its children.
    pub fn kill(mut self) {
        send(self.child.id(), Signal::KILL);
        self.child.wait().unwrap();
    }

    /// Kills every process of the run at once, those that outlive the supervisor included.
    pub fn kill_group(mut self) {
        let _ = kill_process_group(pid(self.child.id()), Signal::KILL);
        self.child.wait().unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A test that failed leaves nothing behind. Of a child that was waited for this does nothing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn send(number: u32, signal: Signal) {
    let _ = kill_process(pid(number), signal);
}

fn pid(number: u32) -> Pid {
    Pid::from_raw(i32::try_from(number).unwrap()).unwrap()
}
