//! `worker`: computes calls of the planning pool.

use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use stillpoint_arguments::Worker;
use stillpoint_pool::{Build, CallError, Hash, Job, Spent, Store, To, Worker as State, WorkerSettings};
use stillpoint_remote::Mailbox;

use super::exchange::{Ending, ended, open};
use super::router::Hub;
use super::tls::{Use, allow, load};
use crate::error::BridgeError;
use crate::metrics::{Exchanged, Served, of_worker};

/// How the names of workers begin: access lists know workers by it.
const NAMES: &str = "worker-";
/// The variable with the endpoint, where no argument states one.
const POOL: &str = "STILLPOINT_POOL";
/// Longest time between two looks at the clock.
const TICK: Duration = Duration::from_millis(50);

/// Executes the subcommand.
pub fn execute(arguments: &Worker) -> ExitCode {
    ended(try_execute(arguments))
}

fn try_execute(arguments: &Worker) -> Result<(), BridgeError> {
    if !(0.0..=86_400.0).contains(&arguments.grace) {
        return Err(BridgeError::Grace(arguments.grace));
    }
    let ending = Ending::watch()?;
    let born = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos() as u64;
    let name = arguments.name.clone().unwrap_or_else(|| format!("{}-{born:x}", std::process::id()));
    let name = if name.starts_with(NAMES) { name } else { format!("{NAMES}{name}") };
    let build = Build::here()?;
    let store = Store::open(&arguments.cache, arguments.cache_mb.saturating_mul(1_000_000))?;
    let slots = match arguments.slots {
        Some(slots) => slots.get(),
        None => std::thread::available_parallelism().map_or(1, NonZeroUsize::get),
    };
    let tls = load(&arguments.tls)?;
    allow(tls.as_deref(), &Use::Compute)?;
    let hub = match &arguments.listen {
        Some(endpoint) => Some(Hub::open(vec![endpoint.clone()], tls.clone(), None)?),
        None => None,
    };
    let of_environment = || std::env::var(POOL).ok().filter(|_| arguments.listen.is_none());
    let endpoint = match (&arguments.connect.clone().or_else(of_environment), &arguments.listen) {
        (Some(endpoint), _) => endpoint.clone(),
        // The router of this process, by loopback where it listens at all addresses.
        (None, Some(endpoint)) => endpoint.replace("0.0.0.0", "127.0.0.1").replace("[::]", "[::1]"),
        (None, None) => return Err(BridgeError::NoEndpoint),
    };
    // The router of this process goes on until the calls are finished.
    let end_of_hub = Ending::unsignalled();
    let hub = hub.map(|hub| {
        let ending = end_of_hub.clone();
        std::thread::spawn(move || hub.run(&ending, || ()))
    });
    let served = arguments.metrics.map(Served::at).transpose()?;
    let Some(mailbox) = open(&name, &endpoint, tls, || ending.is_time())? else { return Ok(()) };
    println!("worker `{name}` with {slots} slots at {endpoint}: {}", build.text());
    let most_open = arguments.memory_mb.saturating_mul(1_000_000);
    let settings = WorkerSettings { build, incarnation: born, slots, most_open };
    let update = |state: &State, now: u64, mailbox: &Mailbox, exchanged: &mut Exchanged| {
        if let Some(served) = &served {
            exchanged.lost = mailbox.lost();
            served.update(|| of_worker(&name, (state, now), exchanged));
        }
    };
    let serving =
        Serving { slots, grace: Duration::from_secs_f64(arguments.grace), wrong_from: arguments.wrong_from };
    serve(State::new(settings, store), Arc::new(mailbox), &serving, &ending, update);
    end_of_hub.now();
    if let Some(hub) = hub {
        let _ = hub.join();
    }
    Ok(())
}

enum Happened {
    Message(String, Vec<u8>),
    Result(Hash, Result<Vec<u8>, CallError>, Spent),
}

/// How a worker serves.
struct Serving {
    slots: usize,
    /// For how long calls are finished after the signal to end.
    grace: Duration,
    wrong_from: Option<u64>,
}

fn serve(
    mut state: State,
    mailbox: Arc<Mailbox>,
    serving: &Serving,
    ending: &Ending,
    update: impl Fn(&State, u64, &Mailbox, &mut Exchanged),
) {
    let &Serving { slots, grace, wrong_from } = serving;
    let mut exchanged = Exchanged::default();
    let (happens, happened) = channel();
    let (jobs, queue) = channel();
    let queue = Arc::new(Mutex::new(queue));
    for _ in 0..slots {
        let (queue, happens) = (queue.clone(), happens.clone());
        std::thread::spawn(move || compute(&queue, &happens));
    }
    let reader = mailbox.clone();
    std::thread::spawn(move || {
        loop {
            if let Some((from, bytes)) = reader.receive(Duration::from_secs(1))
                && happens.send(Happened::Message(from, bytes)).is_err()
            {
                return;
            }
        }
    });
    let begun = Instant::now();
    let mut given = 0;
    let mut drains_since = None;
    let mut received = Duration::ZERO;
    loop {
        let now = begun.elapsed();
        match drains_since {
            Some(_) if ending.take() => return,
            Some(since) if now.saturating_sub(since) >= grace => {
                eprintln!(
                    "stillpoint-bridge: {:.1} s of grace are over: calls that are not finished are lost",
                    grace.as_secs_f64()
                );
                return;
            }
            Some(_) if state.is_drained(now.as_nanos() as u64) => return,
            None if ending.take() => {
                drains_since = Some(now);
                state.drain();
                let running = state.hello().running;
                println!(
                    "ending: {running} calls are finished first, others go back; a second signal ends at once"
                );
            }
            _ => {}
        }
        let first = happened.recv_timeout(TICK).ok();
        for one in first.into_iter().chain(happened.try_iter()) {
            match one {
                Happened::Message(from, bytes) => {
                    exchanged.receive(&from, bytes.len());
                    let arrived = begun.elapsed();
                    state.handle(arrived.as_nanos() as u64, &from, &bytes);
                    received += begun.elapsed().saturating_sub(arrived);
                }
                Happened::Result(key, result, spent) => {
                    given += 1;
                    let is_wrong = wrong_from.is_some_and(|first| given >= first);
                    let received = std::mem::take(&mut received).as_nanos() as u64;
                    let result = if is_wrong { result.map(falsified) } else { result };
                    state.finish(key, result, Spent { received, ..spent });
                }
            }
        }
        state.tick(begun.elapsed().as_nanos() as u64);
        while let Some(job) = state.next_job() {
            if jobs.send(job).is_err() {
                return;
            }
        }
        for (to, message) in state.take_messages() {
            let to = match &to {
                To::All => None,
                To::One(name) => Some(name.as_str()),
            };
            let bytes = message.to_bytes();
            exchanged.send(bytes.len());
            mailbox.send(to, bytes);
        }
        update(&state, begun.elapsed().as_nanos() as u64, &mailbox, &mut exchanged);
    }
}

/// Computes one job after the other until there is nobody to hand the result to.
fn compute(queue: &Mutex<Receiver<Job>>, happens: &Sender<Happened>) {
    loop {
        let job = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(job) = job else { return };
        let (key, begun) = (job.key, Instant::now());
        let mut opened = Duration::ZERO;
        let computed = || {
            let ready = job.open()?;
            opened = begun.elapsed();
            ready.compute()
        };
        // A panic is a fault of this program, but no reason to leave the other calls without an answer.
        let result = catch_unwind(AssertUnwindSafe(computed)).unwrap_or_else(|_| Err(CallError::Panic));
        let computed = begun.elapsed().saturating_sub(opened).as_nanos() as u64;
        let spent = Spent { opened: opened.as_nanos() as u64, computed, ..Spent::default() };
        if happens.send(Happened::Result(key, result, spent)).is_err() {
            return;
        }
    }
}

/// An answer of the right form with a wrong last number.
fn falsified(mut bytes: Vec<u8>) -> Vec<u8> {
    let last = bytes.len().saturating_sub(8);
    bytes.get_mut(last).into_iter().for_each(|byte| *byte ^= 1);
    bytes
}
