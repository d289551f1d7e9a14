//! Chains of processes on bare iceoryx2 ports, with which the hops of stillpoint are compared.
//!
//! Each process has the code that a user would write by hand. It waits on the listener of the topic and receives. In
//! the middle of a chain it also copies the payload into a loan and sends it on. It has no journal and no supervisor.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use stillpoint_pipeline::live::run_folder::RunFolder;
use stillpoint_samples::{HEADER_SIZE, Header, Sample};
use stillpoint_shm::{Contract, Domain, Listener, Notifier, Publisher, Subscriber, Topic};
use zerocopy::{FromBytes, IntoBytes};

use super::cores;
use super::figures::Ages;
use super::stages::{Load, Word, machine_clock, payload, write_load};
use stillpoint::Failure;

/// First argument of this program when it runs as a process of a bare chain.
pub const CHILD: &str = "__bench_bare";
/// Longest wait of a receiver, ns, so that it notices the end of the window.
const LOOK_UP: u64 = 20_000_000;

/// Argument of a process of a chain, as JSON.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Part {
    root: PathBuf,
    prefix: String,
    words: usize,
    /// Place in the chain, counted from 0.
    place: usize,
    /// Number of processes of the chain.
    places: usize,
    core: usize,
    period_ns: u64,
    length_ns: u64,
}

/// A chain of processes.
pub struct Chain<'a> {
    /// Words of 8 bytes in each payload.
    pub words: usize,
    pub hops: usize,
    /// Core of each process.
    pub cores: &'a [usize],
    /// Time from one payload to the next.
    pub period: Duration,
    /// Length of the window.
    pub length: Duration,
}

impl Chain<'_> {
    /// Runs the chain and gives the ages that its last process measured.
    pub fn run(&self) -> Result<Ages, Failure> {
        let folder = RunFolder::create().map_err(Failure::failed)?;
        let domain = Domain::create(&folder.root(), folder.prefix(), "bench").map_err(Failure::failed)?;
        let _topics = (0..self.hops)
            .map(|hop| Topic::create(&domain, &contract(hop, self.words)))
            .collect::<Result<Vec<_>, _>>()
            .map_err(Failure::failed)?;
        let mut processes = Vec::new();
        for place in 0..=self.hops {
            let part = Part {
                root: folder.root(),
                prefix: folder.prefix().to_string(),
                words: self.words,
                place,
                places: self.hops + 1,
                core: self.cores.get(place).copied().unwrap_or(0),
                period_ns: self.period.as_nanos() as u64,
                length_ns: self.length.as_nanos() as u64,
            };
            processes.push(Process::start(&part)?);
        }
        // The start barrier: all processes make their ports, then all connect them, then all begin.
        for step in ["made", "connected"] {
            for process in &mut processes {
                process.expect_line(step)?;
            }
            for process in &mut processes {
                process.go_on()?;
            }
        }
        let mut ages = Ages::default();
        for process in processes {
            ages.add(&process.finish()?);
        }
        Ok(ages)
    }
}

struct Process {
    child: Child,
    lines: BufReader<std::process::ChildStdout>,
}

impl Process {
    fn start(part: &Part) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let mut child = Command::new(program)
            .arg(CHILD)
            .arg(serde_json::to_string(part).map_err(Failure::failed)?)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(Failure::failed)?;
        let lines = BufReader::new(child.stdout.take().ok_or_else(|| Failure::failed("no output"))?);
        Ok(Self { child, lines })
    }

    fn expect_line(&mut self, due: &str) -> Result<(), Failure> {
        let mut line = String::new();
        self.lines.read_line(&mut line).map_err(Failure::failed)?;
        if line.trim() == due {
            Ok(())
        } else {
            Err(Failure::failed(format!("a bare process printed `{}`, not `{due}`", line.trim())))
        }
    }

    fn go_on(&mut self) -> Result<(), Failure> {
        let stdin = self.child.stdin.as_mut().ok_or_else(|| Failure::failed("no input"))?;
        stdin.write_all(b"\n").map_err(Failure::failed)
    }

    fn finish(mut self) -> Result<Ages, Failure> {
        let mut line = String::new();
        self.lines.read_line(&mut line).map_err(Failure::failed)?;
        self.child.wait().map_err(Failure::failed)?;
        let reported: Vec<u64> = serde_json::from_str(&line).map_err(Failure::failed)?;
        let mut ages = Ages::default();
        ages.take(reported);
        Ok(ages)
    }
}

/// Contract of a hop. Its limits are those that a live run gives an edge with a queue of 4.
fn contract(hop: usize, words: usize) -> Contract {
    Contract {
        buffer: 4,
        borrowed: 3,
        pool: 9,
        ..Contract::new(&format!("hop{hop}.load"), Load::KIND, None, words)
    }
}

/// Main function of a process of a chain.
pub fn child_main(argument: Option<String>) -> ExitCode {
    match serve(&argument.unwrap_or_default()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            errln!("stillpoint: {}", failure.text);
            ExitCode::FAILURE
        }
    }
}

struct Inlet {
    subscriber: Subscriber,
    listener: Listener,
}

struct Outlet {
    publisher: Publisher,
    notifier: Notifier,
    sequence: u64,
}

fn serve(argument: &str) -> Result<(), Failure> {
    let part: Part = serde_json::from_str(argument).map_err(Failure::failed)?;
    cores::bind(&[part.core])?;
    let name = format!("bare{}", part.place);
    let domain = Domain::join(&part.root, &part.prefix, &name).map_err(Failure::failed)?;
    let open = |hop| Topic::open(&domain, &contract(hop, part.words)).map_err(Failure::failed);
    let before = part.place.checked_sub(1).map(open).transpose()?;
    let behind = if part.place + 1 < part.places { Some(open(part.place)?) } else { None };
    let inlet = before.as_ref().map(Inlet::open).transpose()?;
    let mut outlet = behind.as_ref().map(Outlet::open).transpose()?;
    say("made")?;
    wait()?;
    if let Some(outlet) = &outlet {
        outlet.publisher.connect().map_err(Failure::failed)?;
    }
    if let Some(inlet) = &inlet {
        inlet.subscriber.connect().map_err(Failure::failed)?;
    }
    say("connected")?;
    wait()?;
    let ages = match (&inlet, &mut outlet) {
        (None, Some(outlet)) => send(&part, outlet)?,
        (Some(inlet), outlet) => receive(&part, inlet, outlet.as_mut())?,
        (None, None) => Vec::new(),
    };
    say(&serde_json::to_string(&ages).map_err(Failure::failed)?)
}

impl Inlet {
    fn open(topic: &Topic) -> Result<Self, Failure> {
        let subscriber = topic.subscriber(4).map_err(Failure::failed)?;
        Ok(Self { subscriber, listener: topic.listener().map_err(Failure::failed)? })
    }
}

impl Outlet {
    fn open(topic: &Topic) -> Result<Self, Failure> {
        let publisher = topic.publisher().map_err(Failure::failed)?;
        Ok(Self { publisher, notifier: topic.notifier().map_err(Failure::failed)?, sequence: 0 })
    }

    /// Sends a payload of `words` words, which `write` fills in.
    fn send(&mut self, words: usize, write: impl FnOnce(&mut [Word])) -> Result<(), Failure> {
        let loan = self.publisher.loan(words).map_err(Failure::failed)?;
        let mut loan = loan.ok_or_else(|| Failure::failed("a bare publisher's memory is used up"))?;
        let (meta, body) = loan.parts_mut();
        let head = Header { sequence: self.sequence, count: words as u32, ..Header::default() };
        meta[..HEADER_SIZE].copy_from_slice(head.as_bytes());
        let body = <[Word]>::mut_from_bytes(&mut body[..words * size_of::<Word>()])
            .map_err(|_| Failure::failed("a loan is not aligned"))?;
        write(body);
        self.sequence += 1;
        self.publisher.send(loan).map_err(Failure::failed)?;
        self.notifier.notify();
        Ok(())
    }
}

fn send(part: &Part, outlet: &mut Outlet) -> Result<Vec<u64>, Failure> {
    let clock = machine_clock();
    let payload = payload(part.words);
    let begun = clock.now();
    for tick in 1.. {
        let due = begun + tick * part.period_ns;
        if due - begun > part.length_ns {
            break;
        }
        std::thread::sleep(Duration::from_nanos(due.saturating_sub(clock.now())));
        outlet.send(part.words, |body| write_load(body, &payload, &clock))?;
    }
    Ok(Vec::new())
}

fn receive(part: &Part, inlet: &Inlet, mut outlet: Option<&mut Outlet>) -> Result<Vec<u64>, Failure> {
    let clock = machine_clock();
    let mut ages = Vec::with_capacity(1 << 16);
    // The last payload has arrived by this time.
    let until = clock.now() + part.length_ns + 2 * LOOK_UP;
    while clock.now() < until {
        inlet.listener.wait(LOOK_UP).map_err(Failure::failed)?;
        while let Some(sample) = inlet.subscriber.receive().map_err(Failure::failed)? {
            let now = clock.now();
            let view = sample.pieces().view::<Load>().map_err(|e| Failure::failed(e.to_string()))?;
            match (&mut outlet, view.elements) {
                (Some(outlet), words) => outlet.send(words.len(), |body| body.copy_from_slice(words))?,
                (None, [before, after, ..]) => {
                    ages.extend([now.saturating_sub(before.word), now.saturating_sub(after.word)]);
                }
                _ => {}
            }
        }
    }
    Ok(ages)
}

fn say(line: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(Failure::failed)
}

/// Waits until the parent writes a byte.
fn wait() -> Result<(), Failure> {
    let mut byte = [0u8];
    rustix::io::read(std::io::stdin(), &mut byte).map_err(Failure::failed)?;
    Ok(())
}
