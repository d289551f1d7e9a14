//! `pool`: lists workers, or says how many would be useful.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use serde_json::json;
use stillpoint_arguments::Pool;
use stillpoint_pool::{Build, Hello, Message};
use stillpoint_remote::Mailbox;

use super::exchange::{PREFIX, ended};
use super::tls::{Use, allow, load};
use crate::error::BridgeError;

struct Received {
    first: (Instant, u64),
    last: (Instant, Hello),
}

impl Received {
    /// Calls answered a second between the first greeting and the last.
    fn rate(&self) -> f64 {
        let seconds = self.last.0.duration_since(self.first.0).as_secs_f64();
        let new = self.last.1.answered.saturating_sub(self.first.1) as f64;
        if seconds > 0.0 { new / seconds } else { 0.0 }
    }
}

/// Executes the subcommand.
pub fn execute(arguments: &Pool) -> ExitCode {
    ended(try_execute(arguments))
}

fn try_execute(arguments: &Pool) -> Result<(), BridgeError> {
    if !(0.5..=3600.0).contains(&arguments.seconds) {
        return Err(BridgeError::Seconds(arguments.seconds));
    }
    let build = Build::here()?;
    let tls = load(&arguments.tls)?;
    allow(tls.as_deref(), &Use::List)?;
    let name = format!("look-{}", std::process::id());
    let mailbox = Mailbox::open(PREFIX, &name, &arguments.connect, tls)?;
    let until = Instant::now() + Duration::from_secs_f64(arguments.seconds);
    let mut workers: BTreeMap<String, Received> = BTreeMap::new();
    let mut demands: BTreeMap<String, u32> = BTreeMap::new();
    loop {
        let rest = until.saturating_duration_since(Instant::now());
        if rest.is_zero() {
            break;
        }
        let arrival: Option<(String, Vec<u8>)> = mailbox.receive(rest);
        let Some((from, bytes)) = arrival else { continue };
        let hello = match Message::from_bytes(&bytes) {
            Ok(Message::Hello(hello)) => hello,
            Ok(Message::Demand { calls }) => {
                demands.insert(from, calls);
                continue;
            }
            _ => continue,
        };
        let now = Instant::now();
        let first = Received { first: (now, hello.answered), last: (now, hello.clone()) };
        workers.entry(from).or_insert(first).last = (now, hello);
    }
    if arguments.counts_useful {
        print_useful(arguments, &workers, &demands);
        return Ok(());
    }
    if workers.is_empty() {
        let (seconds, endpoint) = (arguments.seconds, arguments.connect.clone());
        return Err(BridgeError::NoWorker { seconds, endpoint });
    }
    if arguments.json {
        let of = |(name, worker): (&String, &Received)| {
            let hello = &worker.last.1;
            json!({
                "name": name, "slots": hello.slots, "running": hello.running, "waiting": hello.waiting,
                "answered": hello.answered, "from_cache": hello.known, "calls_per_s": worker.rate(),
                "cache_bytes": hello.cache, "cache_most_bytes": hello.cache_most,
                "build": hello.build, "build_is_as_here": hello.build == build.text(),
            })
        };
        println!("{}", json!({ "workers": workers.iter().map(of).collect::<Vec<_>>() }));
        return Ok(());
    }
    for (name, worker) in &workers {
        let hello = &worker.last.1;
        println!(
            "{name}: {} of {} slots in use, {} waiting, {} answered ({} from the cache), {:.1} calls/s, cache {} of {} MB",
            hello.running,
            hello.slots,
            hello.waiting,
            hello.answered,
            hello.known,
            worker.rate(),
            hello.cache / 1_000_000,
            hello.cache_most / 1_000_000
        );
        match hello.build == build.text() {
            true => println!("  build: as here"),
            false => println!("  build: {}\n  here:  {}", hello.build, build.text()),
        }
    }
    Ok(())
}

/// How many workers would be useful: so many that each call without an answer has a slot.
fn print_useful(arguments: &Pool, workers: &BTreeMap<String, Received>, demands: &BTreeMap<String, u32>) {
    let calls: u64 = demands.values().map(|&calls| u64::from(calls)).sum();
    let there = workers.values().map(|worker| u64::from(worker.last.1.slots));
    let slots = arguments.slots.map_or_else(
        || there.clone().filter(|&slots| slots > 0).min().unwrap_or(1),
        |slots| slots.get() as u64,
    );
    let useful = calls.div_ceil(slots);
    if arguments.json {
        let object = json!({
            "wanted": useful, "slots_of_a_worker": slots, "calls": calls, "clients": demands.len(),
            "workers": workers.len(), "slots": there.sum::<u64>(),
        });
        println!("{object}");
        return;
    }
    println!(
        "{useful} workers of {slots} slots would be useful: {calls} calls of {} clients have no answer; {} workers are there",
        demands.len(),
        workers.len()
    );
}
