//! A program of operators that lies: it starts another one, and breaks one of the messages that this one sends. The seed in
//! the environment (`GARBLE_SEED`) decides which message and how; `GARBLE_PROGRAM` is the path of the other one.

use std::io::{self, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::process::{Command, ExitCode, Stdio};

use serde_json::{Value, json};
use stillpoint_operator::program::SERVE;
use stillpoint_operator::program::wire::{Message, receive, send};

fn main() -> ExitCode {
    let setting = |name: &str| std::env::var(name).unwrap_or_default();
    match relay(&setting("GARBLE_PROGRAM"), setting("GARBLE_SEED").parse().unwrap_or(0)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}

/// Passes messages on both ways until one side is gone.
fn relay(program: &str, seed: u64) -> io::Result<()> {
    let mut run = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let (mut ours, theirs) = UnixStream::pair()?;
    let mut child = Command::new(program).arg(SERVE).stdin(Stdio::from(OwnedFd::from(theirs))).spawn()?;
    let (mut questions, mut asked) = (run.try_clone()?, ours.try_clone()?);
    std::thread::spawn(move || {
        let _ = io::copy(&mut questions, &mut asked);
        // The run is gone, and so is the program that does the work.
        let _ = asked.shutdown(std::net::Shutdown::Both);
    });
    let mut draws = Draws(seed);
    let broken = draws.below(6);
    let mut number = 0;
    while let Some(mut message) = receive(&mut ours)? {
        if number == broken && draws.below(4) == 0 {
            break_bytes(&message, &mut draws, &mut run)?;
            break;
        }
        if number == broken {
            for _ in 0..=draws.below(2) {
                break_message(&mut message, &mut draws);
            }
        }
        number += 1;
        pass(&message, &mut run)?;
    }
    let _ = child.kill();
    child.wait().map(drop)
}

fn pass(message: &Message, run: &mut impl Write) -> io::Result<()> {
    let strings: Vec<&[u8]> = message.strings.iter().map(|bytes| bytes.get()).collect();
    send(run, &message.head, &strings)
}

/// Sends the message with some of its bytes changed, and not all of them. Then the other side is gone.
fn break_bytes(message: &Message, draws: &mut Draws, run: &mut impl Write) -> io::Result<()> {
    let mut bytes = Vec::new();
    pass(message, &mut bytes)?;
    for _ in 0..draws.below(4) {
        // The lengths come first.
        let until = if draws.below(2) == 0 { bytes.len() } else { 24.min(bytes.len()) };
        let at = draws.below(until);
        bytes[at] = draws.next() as u8;
    }
    bytes.truncate(draws.below(bytes.len() + 1));
    run.write_all(&bytes)
}

/// Changes a value of the message, or one of its byte strings.
fn break_message(message: &mut Message, draws: &mut Draws) {
    if !message.strings.is_empty() && draws.below(2) == 0 {
        let at = draws.below(message.strings.len());
        match draws.below(3) {
            0 => drop(message.strings.remove(at)),
            1 => {
                let length = message.strings[at].get().len();
                message.strings[at].shorten(draws.below(length + 1));
            }
            _ => {
                let bytes = message.strings[at].get_mut();
                if !bytes.is_empty() {
                    let at = draws.below(bytes.len());
                    bytes[at] = draws.next() as u8;
                }
            }
        }
        return;
    }
    let mut places = Vec::new();
    list(&message.head, String::new(), &mut places);
    let place = &places[draws.below(places.len())];
    if let Some(value) = message.head.pointer_mut(place) {
        *value = word(draws);
    }
}

/// The places of all values in a value.
fn list(value: &Value, place: String, places: &mut Vec<String>) {
    match value {
        Value::Array(all) => {
            all.iter().enumerate().for_each(|(at, value)| list(value, format!("{place}/{at}"), places));
        }
        Value::Object(all) => all.iter().for_each(|(key, value)| {
            let key = key.replace('~', "~0").replace('/', "~1");
            list(value, format!("{place}/{key}"), places);
        }),
        _ => {}
    }
    places.push(place);
}

/// Another value.
fn word(draws: &mut Draws) -> Value {
    let nested = (0..100).fold(json!(1), |inner, _| json!([inner]));
    let words = [
        Value::Null,
        json!(true),
        json!(0),
        json!(-1),
        json!(3),
        json!(1e308),
        json!(u64::MAX),
        json!(u64::MAX / 16),
        json!(1_u64 << 33),
        json!(""),
        json!("x"),
        json!("\u{1b}[2Jé\n"),
        json!("1e999 m"),
        json!("mm"),
        json!("required"),
        json!("x".repeat(5000)),
        json!([]),
        json!({}),
        json!([[1, 2, 3]]),
        json!([0, 7, 2, 1, 1]),
        nested,
    ];
    words[draws.below(words.len())].clone()
}

/// Numbers from a seed (SplitMix64).
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ x >> 31
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }
}
