//! The far end in C, `examples/far-end`, beside the one in Rust: both are given the same scripts.
//!
//! With `BLESS=1` the vectors are written. Without a C compiler the tests of the C far end say that they skip.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write as _};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use hmac::{Hmac, Mac};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, TestRng, TestRunner};
use sha2::Sha256;
use stillpoint_actuate::acknowledgement::{self, Acknowledgement};
use stillpoint_actuate::{
    Act, Clock, DatagramRefusal, Doing, FarEnd, Key, Message, Order, Receives, Receiving, Safe, Session,
    decode,
};

use super::sent::{bytes, key, order, resealed, session};

const MS: u64 = 1_000_000;
const KEY: &str = "00112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef";
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../examples/far-end");

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn unhex(text: &str) -> Vec<u8> {
    text.as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

fn bits(numbers: &[f32]) -> String {
    numbers.iter().fold(String::new(), |mut text, number| {
        let _ = write!(text, " {:08x}", number.to_bits());
        text
    })
}

/// What the far end in Rust says to a script; `script.c` has the commands.
fn by_rust(script: &str) -> Vec<String> {
    let mut key: Option<Key> = None;
    let mut far: Option<(FarEnd, usize)> = None;
    let mut doing = Doing { valves: Act::Hold, beam: false };
    let mut said = Vec::new();
    for line in script.lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some(command) = words.first() else { continue };
        let word = |place: usize| words.get(place).copied().unwrap_or_default();
        let number = |place: usize| word(place).parse::<u64>().unwrap();
        said.push(match *command {
            "hmac" => {
                let code = Hmac::<Sha256>::new_from_slice(&unhex(word(1))).unwrap();
                hex(&code.chain_update(unhex(word(2))).finalize().into_bytes())
            }
            "key" => {
                key = Key::parse(word(1).as_bytes()).ok();
                if key.is_some() { "a key" } else { "not a key" }.to_owned()
            }
            "decode" => match decode(&unhex(word(1)), key.as_ref().unwrap()) {
                Ok(m) => format!(
                    "{} {} safe {} session {} {} sequence {} stamp {} life {} reasons {} duties{}",
                    if m.receiving == Receiving::Beam { "beam" } else { "valves" },
                    ["hold", "vent", "follow"][m.order as usize],
                    ["hold", "vent"][m.safe as usize],
                    m.session.started,
                    m.session.nonce,
                    m.sequence,
                    m.stamp,
                    m.life,
                    m.reasons,
                    bits(m.duties())
                ),
                Err(why) => format!("refused {}", why.name()),
            },
            "begin" => {
                let valves = number(1) as usize;
                let receives = Receives {
                    idle: if word(2) == "vent" { Safe::Vent } else { Safe::Hold },
                    clock: Clock::Shared { within: number(3) },
                    ramp: number(4),
                    ..Receives::valves(valves)
                };
                far = Some((FarEnd::new(key.as_ref().unwrap(), receives), valves));
                "begun".to_owned()
            }
            "receive" => match far.as_mut().unwrap().0.receive(&unhex(word(2)), number(1)) {
                Ok(_) => "accepted".to_owned(),
                Err(why) => why.name().to_owned(),
            },
            "step" => {
                let (far, valves) = far.as_mut().unwrap();
                doing = far.step(number(1));
                let (order, duty) = match doing.valves {
                    Act::Hold => ("hold", [0.0; 16]),
                    Act::Vent => ("vent", [0.0; 16]),
                    Act::Follow(duty) => ("follow", duty),
                };
                format!(
                    "{order} beam {} duties{}",
                    if doing.beam { "on" } else { "off" },
                    bits(&duty[..*valves])
                )
            }
            "acknowledge" => {
                let session = Session { started: number(2), nonce: number(3) };
                let mut sent = far.as_ref().unwrap().0.acknowledgement(&doing, session, number(4), number(1));
                for text in words.iter().skip(5) {
                    sent.pressure[sent.bladders] = f32::from_bits(u32::from_str_radix(text, 16).unwrap());
                    sent.bladders += 1;
                }
                let mut room = [0; acknowledgement::LONGEST];
                let length = sent.encode(key.as_ref().unwrap(), &mut room);
                hex(&room[..length])
            }
            "counts" => {
                let far = &far.as_ref().unwrap().0;
                let (valves, beam) = (far.valves(), far.beam());
                let refused = DatagramRefusal::ALL.map(|why| valves.refused(why) + beam.refused(why));
                refused.iter().fold(
                    format!("{} {} {}", valves.accepted, valves.missing, valves.sessions),
                    |text, count| format!("{text} {count}"),
                )
            }
            other => panic!("unknown command {other}"),
        });
    }
    said
}

/// A program of the folder, compiled once by whichever test needs it first; `None` without a C compiler.
fn compiled(name: &'static str) -> Option<PathBuf> {
    static PROGRAMS: Mutex<BTreeMap<&str, Option<PathBuf>>> = Mutex::new(BTreeMap::new());
    let mut programs = PROGRAMS.lock().unwrap_or_else(PoisonError::into_inner);
    programs.entry(name).or_insert_with(|| compile(name)).clone()
}

/// Compiles a program of the folder. The sanitizers are used where the compiler has them.
fn compile(name: &str) -> Option<PathBuf> {
    let cc = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    if Command::new(&cc).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        eprintln!("skipped: there is no C compiler ({cc})");
        return None;
    }
    let program =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("c-far-end-{name}-{}", std::process::id()));
    let warnings = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"];
    let sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover"];
    let compile = |options: &[&str]| {
        let sources = [name, "far_end", "sha256"].map(|source| format!("{FOLDER}/{source}.c"));
        Command::new(&cc).args(warnings).args(options).args(sources).arg("-o").arg(&program).output().unwrap()
    };
    if !compile(&sanitizers).status.success() {
        eprintln!("without sanitizers: {cc} has none");
        let plain = compile(&[]);
        assert!(plain.status.success(), "{}", String::from_utf8_lossy(&plain.stderr));
    }
    Some(program)
}

/// What the far end in C says to a script.
fn by_c(program: &Path, script: &str) -> Vec<String> {
    let mut child = Command::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let (mut input, text) = (child.stdin.take().unwrap(), script.to_owned());
    let writing = std::thread::spawn(move || input.write_all(text.as_bytes()));
    let output = child.wait_with_output().unwrap();
    writing.join().unwrap().unwrap();
    assert!(output.status.success(), "{}", output.status);
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// The line of a script that gives a message to the far end at a time, ms.
fn receive(message: &Message, ms: u64) -> String {
    format!("receive {} {}", ms * MS, hex(&bytes(message)))
}

fn lease(session: Session, sequence: u64, ms: u64, order: Order) -> Message {
    Message { sequence, order, stamp: ms * MS, life: 100 * MS, ..Message::resting(Receiving::Beam, session) }
}

fn begin() -> String {
    format!("key {KEY}\nbegin 6 vent 5000000 100000000")
}

/// Orders of each kind, and one of each fault of form.
fn orders() -> String {
    let now = 1_800_000_000_000;
    let mut script = vec![format!("key {KEY}")];
    let of = |order_of: Order| order(session(now), 7, now + 250, order_of);
    let mut all = Message { valves: 16, ..of(Order::Follow) };
    all.duty = std::array::from_fn(|i| i as f32 / 15.0);
    let own = Message { safe: Safe::Hold, reasons: 0x0120_0004, valves: 0, ..of(Order::Hold) };
    for message in [
        of(Order::Hold),
        of(Order::Vent),
        of(Order::Follow),
        all,
        own,
        lease(session(now), 0, now, Order::Hold),
        lease(session(now), u64::MAX, now, Order::Follow),
    ] {
        script.push(format!("decode {}", hex(&bytes(&message))));
    }
    let valid = bytes(&of(Order::Follow));
    let mut put = |bytes: &[u8]| script.push(format!("decode {}", hex(bytes)));
    put(&valid[..83]);
    put(&[&valid[..], &[0; 80][..]].concat());
    for (byte, value) in [(0, b'X'), (4, 2), (48, 5), (48, 17), (30, 1)] {
        let mut changed = valid.clone();
        changed[byte] = value;
        put(&changed);
    }
    let mut code = valid.clone();
    *code.last_mut().unwrap() ^= 0x80;
    put(&code);
    for (at, value) in [(5, 3_u32), (6, 3), (7, 2), (49, 1), (6, 0), (5, 2), (40, 0), (40, 0xffff_ffff)] {
        put(&resealed(valid.clone(), |b| match at {
            40 => b[40..44].copy_from_slice(&value.to_le_bytes()),
            _ => b[at] = value as u8,
        }));
    }
    for duty in [f32::NAN, f32::INFINITY, 1.5, -0.1, -0.0, f32::MIN_POSITIVE] {
        put(&resealed(valid.clone(), |b| b[56..60].copy_from_slice(&duty.to_le_bytes())));
    }
    script.join("\n") + "\n"
}

/// A rig that is begun, followed, left alone, and taken over, with acknowledgements on the way.
fn sessions() -> String {
    let acknowledge = |ms: u64, number: u64, pressures: &[f32]| {
        format!("acknowledge {} 123456789 987654321 {number}{}", ms * MS, bits(pressures))
    };
    let mut script = vec![begin(), "step 0".into(), acknowledge(0, 0, &[])];
    let s = session(1);
    for ms in (10..200).step_by(10) {
        let what = if ms < 40 { Order::Hold } else { Order::Follow };
        script.push(receive(&order(s, ms / 10, ms, what), ms + 2));
        script.push(receive(&lease(s, ms / 10, ms, what), ms + 2));
        script.push(format!("step {}", (ms + 3) * MS));
    }
    script.push(acknowledge(194, 1, &[1e3, 2.5e3, -0.5]));
    script.push(acknowledge(194, 2, &[1e3, f32::NAN, 0.0]));
    script.push(receive(&order(s, 19, 195, Order::Follow), 196));
    script.push(receive(&order(s, 25, 196, Order::Follow), 197));
    script.push(receive(&order(session(100), 0, 198, Order::Hold), 198));
    script.extend([255, 256, 258, 300].map(|ms| format!("step {}", ms * MS)));
    script.push(receive(&order(session(100), 1, 301, Order::Follow), 301));
    script.push(receive(&order(session(100), 2, 302, Order::Vent), 302));
    script.push(receive(&order(session(100), 3, 303, Order::Follow), 304));
    script.extend([304, 354, 364].map(|ms| format!("step {}", ms * MS)));
    script.push(receive(&order(s, 30, 366, Order::Hold), 366));
    script.push(acknowledge(366, 3, &[]));
    script.push("counts".into());
    script.join("\n") + "\n"
}

/// RFC 4231, cases 1 to 4, 6 and 7: keys and messages, with the published codes.
const CODES: [(&str, &str, &str); 6] = [
    (
        "0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b0b",
        "4869205468657265",
        "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7",
    ),
    (
        "4a656665",
        "7768617420646f2079612077616e7420666f72206e6f7468696e673f",
        "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843",
    ),
    ("aa*20", "dd*50", "773ea91e36800e46854db8ebd09181a72959098b3ef8c122d9635514ced565fe"),
    (
        "0102030405060708090a0b0c0d0e0f10111213141516171819",
        "cd*50",
        "82558a389a443c0ea4cc819899f2083a85f0faa3e578f8077a2e3ff46729665b",
    ),
    (
        "aa*131",
        "Test Using Larger Than Block-Size Key - Hash Key First",
        "60e431591ee0b67f0d8a26aacbf5b77f8e0bc6213728c5140546040f0ee37f54",
    ),
    (
        "aa*131",
        "This is a test using a larger than block-size key and a larger than block-size data. The key needs to be hashed before being used by the HMAC algorithm.",
        "9b09ffa71b942fcb27635fbcd5b0e944bfdc63644f0713938a7f51535c3a35e2",
    ),
];

fn codes() -> String {
    let written = |text: &str| match text.split_once('*') {
        Some((byte, times)) => byte.repeat(times.parse().unwrap()),
        None if text.contains(' ') => hex(text.as_bytes()),
        None => text.to_owned(),
    };
    CODES.map(|(key, message, _)| format!("hmac {} {}\n", written(key), written(message))).concat()
}

#[test]
fn the_vectors_are_read_alike_in_rust_and_in_c() {
    let c = compiled("script");
    for (name, script) in [("codes", codes()), ("orders", orders()), ("sessions", sessions())] {
        let by_rust = by_rust(&script);
        let file = |end: &str| Path::new(FOLDER).join(format!("vectors/{name}.{end}"));
        if std::env::var_os("BLESS").is_some() {
            std::fs::write(file("txt"), &script).unwrap();
            std::fs::write(file("expected"), by_rust.join("\n") + "\n").unwrap();
        }
        let read = |end: &str| std::fs::read_to_string(file(end)).unwrap();
        assert_eq!(read("txt"), script, "{name}: `BLESS=1` writes the vectors");
        let expected: Vec<String> = read("expected").lines().map(str::to_owned).collect();
        assert_eq!(by_rust, expected, "{name} in Rust");
        if let Some(program) = &c {
            assert_eq!(by_c(program, &script), expected, "{name} in C");
        }
    }
    assert_eq!(by_rust(&codes()), CODES.map(|(.., code)| code.to_owned()));
}

/// What valves and beam do after a script, in a word each.
fn last(said: &[String]) -> (&str, &str) {
    let words: Vec<&str> = said.last().unwrap().split(' ').collect();
    (words[0], words[2])
}

/// The fail-safe trials, of a far end that says this to a script.
fn trials(name: &str, run: &dyn Fn(&str) -> Vec<String>) {
    let s = session(1);
    // Follows from 10 ms on, with the beam on; the last order was made at 50 ms, the lease lasts to 150 ms.
    let mut following = vec![begin()];
    following.extend([receive(&order(s, 0, 1, Order::Hold), 2), receive(&lease(s, 0, 1, Order::Hold), 2)]);
    for k in 1..=5 {
        following.push(receive(&order(s, k, 10 * k, Order::Follow), 10 * k + 2));
        following.push(receive(&lease(s, k, 10 * k, Order::Follow), 10 * k + 2));
        following.push(format!("step {}", (10 * k + 3) * MS));
    }
    let with = |more: &[String]| run(&[following.as_slice(), more].concat().join("\n"));
    let step = |ms: u64| format!("step {}", ms * MS);
    assert_eq!(last(&with(&[])), ("follow", "on"), "{name}");

    // Orders end: at 60 ms after the last the beam is off and the valves hold, and then they vent.
    assert_eq!(last(&with(&[step(109)])), ("follow", "on"), "{name}");
    assert_eq!(last(&with(&[step(109), step(110)])), ("hold", "off"), "{name}");
    assert_eq!(last(&with(&[step(109), step(110), step(112)])), ("vent", "off"), "{name}");
    assert_eq!(last(&with(&[step(10_000), step(10_002)])), ("vent", "off"), "{name}");
    assert_eq!(last(&run(&format!("{}\nstep 0", begin()))), ("vent", "off"), "{name}: before the first");

    // Forged, repeated, old, late, early, cut, of an old session, of a second sender: nothing moves.
    let newer = order(s, 6, 60, Order::Vent);
    let mut forged = bytes(&newer);
    forged[52] ^= 1;
    let other_key = Key::parse(KEY.replace("00", "01").as_bytes()).unwrap();
    let mut foreign = bytes(&newer);
    let end = foreign.len() - 32;
    let code = other_key.code(&foreign[..end]);
    foreign[end..].copy_from_slice(&code);
    let sent = |bytes: &[u8], ms: u64| format!("receive {} {}", ms * MS, hex(bytes));
    let usual = with(&[step(62)]);
    for (line, why) in [
        (sent(&forged, 61), "forged"),
        (sent(&foreign, 61), "forged"),
        (sent(&bytes(&newer)[..60], 61), "too_short"),
        (sent(b"", 61), "too_short"),
        (receive(&order(s, 5, 60, Order::Vent), 61), "repeated"),
        (receive(&order(s, 2, 60, Order::Vent), 61), "old"),
        (receive(&order(s, 6, 1, Order::Vent), 61), "late"),
        (receive(&order(s, 6, 70, Order::Vent), 61), "early"),
        (receive(&order(session(0), 9, 60, Order::Vent), 61), "old_session"),
        (receive(&order(session(55), 0, 60, Order::Vent), 61), "second_sender"),
        (receive(&Message { valves: 4, duty: [0.0; 16], ..order(s, 6, 60, Order::Follow) }, 61), "valves"),
    ] {
        let said = with(&[line, step(62)]);
        assert_eq!(said[said.len() - 2], why, "{name}");
        assert_eq!(said.last(), usual.last(), "{name}: {why}");
    }

    // The newest order wins, in whatever order they arrive.
    let [vent, hold] = [(7, Order::Vent), (6, Order::Hold)].map(|(n, o)| receive(&order(s, n, 60, o), 61));
    assert_eq!(last(&with(&[vent.clone(), hold.clone(), step(62), step(64)])), ("vent", "off"), "{name}");
    assert_eq!(last(&with(&[hold, vent, step(62), step(64)])), ("vent", "off"), "{name}");

    // After silence a new session begins at rest, and its duties grow from zero.
    let new = session(200);
    let moving = receive(&order(new, 0, 210, Order::Follow), 211);
    assert_eq!(with(&[moving]).last().unwrap(), "in_motion", "{name}");
    let begun =
        [receive(&order(new, 1, 212, Order::Hold), 213), receive(&order(new, 2, 214, Order::Follow), 215)];
    let duty = |ms: u64| {
        let said = with(&[begun.as_slice(), &[step(ms)]].concat());
        f32::from_bits(u32::from_str_radix(said.last().unwrap().split(' ').nth(4).unwrap(), 16).unwrap())
    };
    assert!(duty(215) < 0.02 && duty(233) < duty(263) && duty(263) <= 0.26, "{name}");
}

#[test]
fn the_far_end_in_c_passes_the_trials_of_that_in_rust() {
    trials("Rust", &by_rust);
    if let Some(program) = compiled("script") {
        trials("C", &|script| by_c(&program, script));
    }
}

/// A datagram of one of three senders, as it is made and as it arrives.
fn traffic() -> impl Strategy<Value = (u64, Order, bool, u64, u64, usize, u8)> {
    let what = prop_oneof![4 => Just(Order::Follow), 1 => Just(Order::Hold), 1 => Just(Order::Vent)];
    // The present sender, an old one that still sends, and now and then one that comes too early.
    let sender = prop_oneof![60 => Just(1_u64), 10 => Just(0), 1 => Just(2)];
    let after = prop_oneof![20 => 1..15_u64, 1 => 50..200_u64];
    let delay = prop_oneof![10 => 0..5_u64, 2 => 5..90_u64];
    (sender, what, any::<bool>(), after, delay, 0..3_usize, any::<u8>())
}

#[test]
fn of_thousands_of_datagrams_of_a_bad_network_both_far_ends_say_the_same() {
    let Some(program) = compiled("script") else { return };
    let mut runner = TestRunner::new_with_rng(
        Config::default(),
        TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
    );
    let all = prop::collection::vec(traffic(), 3000).new_tree(&mut runner).unwrap().current();
    let (mut now, mut arriving) = (10, Vec::new());
    for (number, (sender, what, is_beam, after, delay, copies, change)) in all.into_iter().enumerate() {
        now += after;
        let sender = number as u64 / 300 + sender;
        let message = match (is_beam, what) {
            (true, Order::Vent) => lease(session(sender), number as u64, now, Order::Hold),
            (true, what) => lease(session(sender), number as u64, now, what),
            _ => order(session(sender), number as u64, now, what),
        };
        let mut sent = bytes(&message);
        // One of sixteen is damaged on the way, and some of these have the right code again.
        if change < 16 {
            let place = usize::from(change) * sent.len() / 16;
            sent[place] ^= 1 << (change % 8);
            if change % 2 == 0 {
                sent = resealed(sent, |_| {});
            }
        }
        for copy in 0..copies {
            arriving.push((now + delay + 7 * copy as u64, sent.clone()));
        }
    }
    arriving.sort();
    let mut script = begin();
    for (n, (ms, sent)) in arriving.iter().enumerate() {
        let _ = write!(script, "\nreceive {} {}\nstep {}", ms * MS, hex(sent), (ms + 1) * MS);
        if n % 50 == 0 {
            let _ = write!(script, "\nacknowledge {} 1 2 {n} 447a0000\ncounts", (ms + 1) * MS);
        }
    }
    script += "\ncounts\n";
    let (rust, c) = (by_rust(&script), by_c(&program, &script));
    assert_eq!(rust.len(), c.len());
    for (number, (rust, c)) in rust.iter().zip(&c).enumerate() {
        assert_eq!(rust, c, "line {number}");
    }
    // It was not all refused, nor all taken.
    let counts: Vec<u64> = rust.last().unwrap().split(' ').map(|n| n.parse().unwrap()).collect();
    assert!(counts[0] > 200 && counts[3..].iter().sum::<u64>() > 200, "{counts:?}");
}

#[test]
fn ten_thousand_random_datagrams_leave_the_far_end_in_c_in_a_valid_state() {
    let Some(program) = compiled("fuzz") else { return };
    let output = Command::new(program).arg("10000").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
}

/// Two ports of this machine that are free, or were a moment ago.
fn free_ports() -> [u16; 2] {
    let sockets = [(), ()].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    sockets.map(|socket| socket.local_addr().unwrap().port())
}

/// The program for POSIX takes orders over UDP, acknowledges them, and vents by itself when they end.
#[test]
fn the_program_in_c_follows_orders_over_udp_and_vents_when_they_end() {
    let Some(program) = compiled("main") else { return };
    let folder = tempfile_with_key();
    let acknowledgements = UdpSocket::bind("127.0.0.1:0").unwrap();
    // A lost datagram is a failure, not a test that waits for ever.
    acknowledgements.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let answers = acknowledgements.local_addr().unwrap().port();
    let [valves, beam] = free_ports();
    let arguments = [6, valves, beam, answers].map(|number| number.to_string());
    let mut child =
        Command::new(program).arg(&folder).args(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(|line| line.unwrap());
    assert!(lines.next().unwrap().ends_with(" vent beam off"), "before the first order");
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64;
    let s = Session { started: now(), nonce: 1 };
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let life = 1000 * MS;
    let sending = |number: u64| {
        let what = if number == 0 { Order::Hold } else { Order::Follow };
        // A machine that stands still for a while ends no order: each lives for as long as an order may.
        let order = Message { stamp: now(), life, ..order(s, number, 0, what) };
        let lease = Message { stamp: order.stamp, life, ..lease(s, number, 0, what) };
        socket.send_to(&bytes(&order), ("127.0.0.1", valves)).unwrap();
        socket.send_to(&bytes(&lease), ("127.0.0.1", beam)).unwrap();
        order.stamp
    };
    // Each order is sent after the one before was acknowledged.
    let mut room = [0; 2048];
    let mut last_sent = 0;
    for number in 0..10 {
        last_sent = sending(number);
        loop {
            let (count, _) = acknowledgements.recv_from(&mut room).unwrap();
            let said = Acknowledgement::decode(&room[..count], &key()).unwrap();
            assert_eq!((said.session, said.refused), (s, 0));
            if said.sequence == number {
                break;
            }
        }
    }
    let mut said = Vec::new();
    for line in lines.by_ref() {
        let at: u64 = line.split(' ').next().unwrap().parse().unwrap();
        let what = line.split_once(' ').unwrap().1.to_owned();
        let is_over = what.starts_with("vent");
        said.push((at, what));
        if is_over {
            break;
        }
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let words: Vec<&str> = said.iter().map(|(_, what)| what.split(" beam").next().unwrap()).collect();
    assert_eq!(words.first().copied(), Some("hold"), "{said:?}");
    assert!(said.iter().any(|(_, what)| what.starts_with("follow beam on")), "{said:?}");
    let [.., (off, last_hold), (vents, _)] = &said[..] else { panic!("{said:?}") };
    assert_eq!(last_hold, "hold beam off", "{said:?}");
    assert!(*off >= last_sent + life && off < vents, "{said:?} {last_sent}");
}

/// A file with the key of the tests, which only its owner may read.
fn tempfile_with_key() -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("c-far-end-{}.key", std::process::id()));
    std::fs::write(&path, KEY).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
    path
}
