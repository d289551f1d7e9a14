//! A bench: a folder of its own, in which the kit's command is run as people run it.

use std::fs::File;
use std::net::UdpSocket;
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use serde_json::Value;

/// However loaded the machine is, nothing takes longer.
const PATIENCE: Duration = Duration::from_secs(100);

/// A folder with its own runs: parallel tests do not see each other.
pub struct Bench {
    folder: tempfile::TempDir,
}

/// How a command ended.
pub struct Done {
    pub status: ExitStatus,
    pub out: String,
    pub err: String,
}

impl Done {
    pub fn code(&self) -> i32 {
        self.status.code().unwrap_or(-1)
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {}\n{}", self.out, self.err))
    }

    /// The JSON of a command that went well.
    pub fn good(&self) -> Value {
        assert_eq!(self.code(), 0, "{}\n{}", self.out, self.err);
        self.json()
    }
}

impl Done {
    /// The JSON of a run that went well except that its session is not complete.
    pub fn incomplete(&self) -> Value {
        assert_eq!(self.code(), 1, "{}\n{}", self.out, self.err);
        let report = self.json();
        assert_eq!((&report["complete"], &report["balanced"]), (&false.into(), &true.into()), "{report}");
        report
    }
}

/// A command that is under way.
pub struct Running {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

/// Waits on a thing until it is there.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < PATIENCE, "waited too long for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

impl Bench {
    pub fn new() -> Self {
        // Short: the paths of sockets below it may have 108 bytes.
        let folder = tempfile::Builder::new().prefix("sp").tempdir().unwrap();
        std::fs::DirBuilder::new().mode(0o700).create(folder.path().join("r")).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Where the runs of this bench are.
    pub fn runs(&self) -> PathBuf {
        self.path("r")
    }

    /// Identifiers of the runs that have a folder.
    pub fn run_ids(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.runs()).unwrap().flatten();
        let names = entries.map(|e| e.file_name().to_string_lossy().into_owned());
        names.filter(|name| !name.starts_with('.')).collect()
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let program = std::env::var_os("STILLPOINT_MEASURED").unwrap_or_else(|| crate::PROGRAM.into());
        let mut command = Command::new(program);
        command.args(arguments).env("STILLPOINT_RUNS", self.runs()).current_dir(self.folder.path());
        command
    }

    /// Begins a command, in a process group of its own.
    pub fn begin(&self, command: Command) -> Running {
        self.begin_saying(command, |err| File::create(err).unwrap().into())
    }

    /// Starts a command that says what is wrong to a pipe that nobody reads.
    pub fn start_unheard(&self, arguments: &[&str]) -> Running {
        self.begin_saying(self.command(arguments), |err| {
            File::create(err).unwrap();
            std::io::pipe().unwrap().1.into()
        })
    }

    fn begin_saying(&self, mut command: Command, err_of: impl Fn(&Path) -> Stdio) -> Running {
        static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let (out, err) = (self.path(&format!("{number}.out")), self.path(&format!("{number}.err")));
        let child = command
            .stdin(Stdio::null())
            .stdout(File::create(&out).unwrap())
            .stderr(err_of(&err))
            .process_group(0)
            .spawn()
            .unwrap();
        Running { child, out, err }
    }

    pub fn start(&self, arguments: &[&str]) -> Running {
        self.begin(self.command(arguments))
    }

    pub fn call(&self, arguments: &[&str]) -> Done {
        self.start(arguments).finish()
    }

    /// Starts a recorded run without an end.
    pub fn run(&self, pipeline: &Path) -> Running {
        self.start(&["run", text(pipeline), "--json", "--record", "s"])
    }

    /// Waits until so many samples, or journal entries, were sent on a topic.
    pub fn wait_for_samples(&self, topic: &str, count: u32) -> String {
        wait_for(topic, || {
            let done = self.call(&["echo", "--json", topic, "--count", &count.to_string()]);
            (done.code() == 0 && done.out.lines().count() == count as usize).then_some(done.out)
        })
    }
}

impl Drop for Bench {
    /// Takes away what runs left whose supervisor was killed.
    fn drop(&mut self) {
        for id in self.run_ids() {
            stillpoint_shm::sweep(&self.runs().join(&id).join("d"), &format!("sp_{id}_"));
        }
    }
}

/// A file system that is taken away again, also by a test that fails.
pub struct Mounted(PathBuf);

impl Drop for Mounted {
    fn drop(&mut self) {
        // Programs that still write there do not hold it up.
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).output();
    }
}

/// A file system of this size, as `disk` in the folder of the bench; none where this user may not mount one.
pub fn small_disk(bench: &Bench, size: &str) -> Option<Mounted> {
    let at = bench.path("disk");
    std::fs::create_dir(&at).unwrap();
    let size = format!("size={size}");
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "none", text(&at)]).output();
    if mounted.is_ok_and(|o| o.status.success()) {
        return Some(Mounted(at));
    }
    eprintln!("skipped: a small file system cannot be mounted here");
    None
}

impl Running {
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Whether these words stand on its standard error.
    pub fn has_answered(&self, words: &str) -> bool {
        std::fs::read_to_string(&self.err).is_ok_and(|output_text| output_text.contains(words))
    }

    pub fn signal(&self, signal: Signal) {
        crate::bench::signal(self.pid(), signal);
    }

    /// As Ctrl-C does: the whole group gets it.
    pub fn signal_group(&self, signal: Signal) {
        let _ = kill_process_group(pid(self.pid()), signal);
    }

    /// As a terminal that is closed does, and worse: hangs up at once again, until the run ends or some of what a second
    /// signal must not follow within is over.
    pub fn hang_up_repeatedly(&self) {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(300) && lives(self.pid()) {
            self.signal_group(Signal::HUP);
        }
    }

    pub fn output_text(&self) -> String {
        std::fs::read_to_string(&self.out).unwrap()
    }

    pub fn errors(&self) -> String {
        std::fs::read_to_string(&self.err).unwrap()
    }

    /// Waits for its end.
    pub fn finish(self) -> Done {
        self.finish_within(PATIENCE)
    }

    /// The same for what takes longer.
    pub fn finish_within(mut self, patience: Duration) -> Done {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(begun.elapsed() < patience, "it does not end: {}", self.errors());
            std::thread::sleep(Duration::from_millis(2));
        };
        let out = std::fs::read_to_string(&self.out).unwrap();
        let err = std::fs::read_to_string(&self.err).unwrap();
        Done { status, out, err }
    }

    /// Ends a run in order.
    pub fn stop(self) -> Done {
        self.signal_group(Signal::INT);
        self.finish()
    }

    /// Process numbers of the children by name.
    pub fn children(&self) -> Vec<(String, u32)> {
        let entries = std::fs::read_dir("/proc").unwrap().flatten();
        entries
            .filter_map(|e| {
                let number: u32 = e.file_name().to_str()?.parse().ok()?;
                let stat = std::fs::read_to_string(e.path().join("stat")).ok()?;
                let mut rest = stat.rsplit_once(')')?.1.split_whitespace();
                let (state, parent) = (rest.next()?, rest.next()?);
                if parent != self.pid().to_string() || state == "Z" {
                    return None;
                }
                let line = std::fs::read(e.path().join("cmdline")).ok()?;
                let name = line.split(|b| *b == 0).nth(2)?;
                Some((String::from_utf8_lossy(name).into_owned(), number))
            })
            .collect()
    }

    /// Process number of the child of this name, other than `before`.
    pub fn child(&self, name: &str, before: u32) -> u32 {
        wait_for(name, || self.children().into_iter().find(|(n, p)| n == name && *p != before)).1
    }

    /// Kills a child of the run, and gives its number.
    pub fn kill(&self, name: &str, before: u32) -> u32 {
        let number = self.child(name, before);
        signal(number, Signal::KILL);
        number
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A test that failed leaves nothing behind. Of a child that was waited for this does nothing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Sends a signal to a process, where it is still there.
pub fn signal(number: u32, signal: Signal) {
    let _ = kill_process(pid(number), signal);
}

/// Whether a process is there and no zombie.
pub fn lives(number: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
}

/// Objects in `/dev/shm` of a run.
pub fn shared_objects(run: &str) -> usize {
    let Ok(entries) = std::fs::read_dir("/dev/shm") else { return 0 };
    let prefix = format!("sp_{run}_");
    entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(&prefix)).count()
}

/// The file of a pipeline.
pub fn pipeline(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pipelines").join(name)
}

/// A pipeline's text with ports of this machine that nobody has in the place of its own.
pub fn on_free_ports(yaml: &str) -> String {
    const HERE: &str = "127.0.0.1:";
    let digits = |from: &str| from.chars().take_while(char::is_ascii_digit).collect::<String>();
    let ports: std::collections::BTreeSet<String> = yaml.split(HERE).skip(1).map(digits).collect();
    // Held until all are chosen, so that no two are the same.
    let held: Vec<_> = ports.iter().map(|own| (own, UdpSocket::bind("127.0.0.1:0").unwrap())).collect();
    let mut yaml = yaml.to_owned();
    // By way of names: a free port may be another's own.
    for (number, (own, _)) in held.iter().enumerate() {
        yaml = yaml.replace(&format!("{HERE}{own}"), &format!("{HERE}<{number}>"));
    }
    for (number, (_, socket)) in held.iter().enumerate() {
        let port = socket.local_addr().unwrap().port();
        yaml = yaml.replace(&format!("<{number}>"), &port.to_string());
    }
    yaml
}

/// A loop from camera to valve at ports that nobody has, with its key, with a camera of fewer pixels, and with a head
/// that is held where it is.
pub fn small_loop(bench: &Bench, yaml: &str, key: &str) -> PathBuf {
    let camera = "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }";
    let yaml = yaml.replace("camera: { every: 100 ms }", camera).replace("at: 2.5 s, z:", "at: 1 h, z:");
    let key = bench.path(key);
    std::fs::create_dir_all(key.parent().unwrap()).unwrap();
    std::fs::write(key, include_str!("../../examples/data/rig.key")).unwrap();
    std::fs::write(bench.path("loop.yaml"), on_free_ports(&yaml)).unwrap();
    bench.path("loop.yaml")
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The line of the report about an operator.
pub fn figures<'v>(report: &'v Value, operator: &str) -> &'v Value {
    let all = report["operators"].as_array().unwrap();
    all.iter().find(|o| o["operator"] == operator).unwrap()
}

/// The line of the ledger about a consumer's input.
pub fn line<'v>(report: &'v Value, consumer: &str) -> &'v Value {
    let all = report["ledger"].as_array().unwrap();
    all.iter().find(|l| l["consumer"] == consumer).unwrap()
}

fn pid(number: u32) -> Pid {
    Pid::from_raw(number as i32).unwrap()
}
