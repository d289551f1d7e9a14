//! `pool`: lists workers.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

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
    loop {
        let rest = until.saturating_duration_since(Instant::now());
        if rest.is_zero() {
            break;
        }
        let arrival: Option<(String, Vec<u8>)> = mailbox.receive(rest);
        let Some((from, bytes)) = arrival else { continue };
        let Ok(Message::Hello(hello)) = Message::from_bytes(&bytes) else { continue };
        let now = Instant::now();
        let first = Received { first: (now, hello.answered), last: (now, hello.clone()) };
        workers.entry(from).or_insert(first).last = (now, hello);
    }
    if workers.is_empty() {
        let (seconds, endpoint) = (arguments.seconds, arguments.connect.clone());
        return Err(BridgeError::NoWorker { seconds, endpoint });
    }
    for (name, Received { first, last: (at, hello) }) in &workers {
        let seconds = at.duration_since(first.0).as_secs_f64();
        let new = hello.answered.saturating_sub(first.1) as f64;
        println!(
            "{name}: {} of {} slots in use, {} waiting, {} answered ({} from the cache), {:.1} calls/s, cache {} of {} MB",
            hello.running,
            hello.slots,
            hello.waiting,
            hello.answered,
            hello.known,
            if seconds > 0.0 { new / seconds } else { 0.0 },
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
