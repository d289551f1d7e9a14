//! Whatever the input is: no panic, no hang, nothing larger than the input justifies.

use cap::Cap;
use proptest::prelude::*;
use stillpoint_operator::config::faults::{Findings, MOST_FAULTS};
use stillpoint_operator::config::yaml::{MOST_BYTES, parse};
use stillpoint_pipeline::config::{Code, Machine, check, compose_for, text};

use crate::disk::Disk;
use crate::good::FILES;
use crate::includes::{OWN, TRACKING, files as included_files};
use crate::kinds::registry;

/// A request for memory beyond it ends the program. The texts have at most 256 KiB, and the tests run side by side.
#[global_allocator]
static LIMIT: Cap<std::alloc::System> = Cap::new(std::alloc::System, 64 << 20);

/// Checks a text and what must hold for any.
fn holds(text: &str) {
    let tree = parse(text, 0, 0, &Findings::default());
    let nodes = tree.map_or(0, |t| t.count());
    assert!(nodes <= text.len() + 2, "{nodes} nodes from {} bytes", text.len());
    let sets = [text.chars().take(60).collect::<String>()];
    for sets in [&sets[..], &[]] {
        if let Err(faults) = check(text, "any.yaml", sets, &registry(), &Disk) {
            assert!(!faults.list().is_empty() && faults.list().len() <= MOST_FAULTS);
            for fault in faults.list() {
                assert!(fault.message.len() + fault.help.len() < 2000, "{}", fault.message);
                assert!(!fault.message.is_empty() && !fault.help.is_empty());
            }
            let shown = faults.to_string();
            assert!(shown.len() < MOST_FAULTS * 4000);
            assert_eq!(faults.to_json().as_array().map(Vec::len), Some(faults.list().len()));
        }
    }
}

/// Good arguments of `--set`.
const SETS: &[&str] = &[
    "face.leaf=5 mm",
    "target.step.by=[1 mm, 2 mm, 3 mm]",
    "mrac.every=20 ms",
    "seed=99",
    "face.use=segment.face",
    "filter.inputs.measurement={ from: head.pose, queue: 1 }",
];

/// What is put into a good file.
fn piece() -> impl Strategy<Value = String> {
    prop_oneof![
        prop::sample::select(vec![
            "{",
            "}",
            "[",
            "]",
            ": ",
            "- ",
            ",",
            "\n",
            "\t",
            "  ",
            "'",
            "\"",
            "#",
            "&a ",
            "*a",
            "<<: ",
            "!!str ",
            "|\n",
            ">\n",
            "---\n",
            "...\n",
            "? ",
            "%TAG",
            "null",
            "~",
            "4 mm",
            "1e999 m",
            "nan",
            "-",
            "\u{feff}",
            "é",
            "\0",
            "\r",
            "params: {",
            "inputs: ",
            "use: ",
            "rig.depth",
            "sync: {with: [a], within: 1 ms}",
        ])
        .prop_map(str::to_owned),
        any::<char>().prop_map(String::from),
        "[a-z_.:{}\\[\\] ,0-9\n-]{1,12}",
    ]
}

fn cut(text: &str, share: f64) -> usize {
    let mut at = (text.len() as f64 * share) as usize;
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// A good file with some places cut out or written over.
fn mutated() -> impl Strategy<Value = String> {
    edited(FILES.iter().map(|(_, text)| *text).collect())
}

/// One of these texts, likewise.
fn edited(texts: Vec<&'static str>) -> impl Strategy<Value = String> {
    let edit = (0.0..1.0f64, 0..30usize, piece());
    (0..texts.len(), prop::collection::vec(edit, 1..5)).prop_map(move |(file, edits)| {
        let mut text = texts[file].to_owned();
        for (place, length, piece) in edits {
            let from = cut(&text, place);
            let mut to = (from + length).min(text.len());
            while !text.is_char_boundary(to) {
                to += 1;
            }
            text.replace_range(from..to, &piece);
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn ten_thousand_broken_files_neither_panic_nor_grow(
        text in prop_oneof![
            6 => mutated(),
            2 => prop::collection::vec(piece(), 0..60).prop_map(|p| p.concat()),
            1 => any::<String>(),
        ]
    ) {
        holds(&text);
    }

    #[test]
    fn broken_files_of_several_neither_panic_nor_grow(
        own in edited(vec![OWN]),
        tracking in edited(vec![TRACKING]),
        is_own in any::<bool>(),
    ) {
        let (own, tracking) = if is_own { (&*own, TRACKING) } else { (OWN, &*tracking) };
        let machine = Machine::default().with_variables([("PARTS", "parts")]);
        let files = included_files(&[("parts/tracking.yaml", tracking)]);
        match compose_for(&machine, own, "conf/own.yaml", &[], &registry(), &files) {
            // What a session keeps is a pipeline again.
            Ok(composed) => prop_assert!(check(&composed.text, "any.yaml", &[], &registry(), &files).is_ok()),
            Err(faults) => {
                prop_assert!(!faults.list().is_empty() && faults.list().len() <= MOST_FAULTS);
                prop_assert!(faults.list().iter().all(|f| f.message.len() + f.help.len() < 2000));
                prop_assert!(faults.to_string().len() < MOST_FAULTS * 4000);
            }
        }
    }

    #[test]
    fn broken_sets_are_refused_at_the_argument_or_checked(
        sets in prop::collection::vec(edited(SETS.to_vec()), 1..4),
    ) {
        let (_, file) = FILES[0];
        if let Err(faults) = check(file, "any.yaml", &sets, &registry(), &Disk) {
            prop_assert!(!faults.list().is_empty() && faults.list().len() <= MOST_FAULTS);
            prop_assert!(faults.list().iter().all(|f| f.message.len() + f.help.len() < 2000));
            let place = format!("{faults}");
            prop_assert!(place.contains("--set") || place.contains("any.yaml:"), "{place}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_are_refused_with_their_place(
        mut bytes in mutated().prop_map(String::into_bytes),
        at in any::<prop::sample::Index>(),
        raw in prop::collection::vec(any::<u8>(), 1..20),
    ) {
        let at = at.index(bytes.len() + 1);
        bytes.splice(at..at, raw);
        match text(bytes, "any.yaml") {
            Ok(text) => holds(&text),
            Err(faults) => prop_assert!(faults.list().len() == 1 && faults.to_string().len() < 4000, "{faults}"),
        }
    }
}

#[test]
fn a_text_that_is_cut_in_a_character_is_too_long_and_not_no_text() {
    let mut bytes = "é".repeat(MOST_BYTES / 2 + 1).into_bytes();
    bytes.truncate(MOST_BYTES + 1);
    let text = text(bytes, "long.yaml").unwrap();
    let faults = check(&text, "long.yaml", &[], &registry(), &Disk).err().unwrap();
    assert!(faults.list().iter().any(|f| f.code == Code::TooLarge), "{faults}");
}

#[test]
fn an_alias_bomb_stays_small() {
    let mut text = String::from("a: &a [x, x, x, x, x, x, x, x, x]\n");
    for (new, old) in "bcdefghi".chars().zip("abcdefgh".chars()) {
        text.push_str(&format!(
            "{new}: &{new} [*{old}, *{old}, *{old}, *{old}, *{old}, *{old}, *{old}, *{old}, *{old}]\n"
        ));
    }
    holds(&text);
    let faults = check(&text, "bomb.yaml", &[], &registry(), &Disk).err().unwrap();
    assert!(faults.list().iter().any(|f| f.code == Code::NotSupported));
}

#[test]
fn deep_nesting_and_long_files_are_refused() {
    for text in ["[".repeat(100_000), "{a: ".repeat(20_000), "- ".repeat(20_000), "a".repeat(MOST_BYTES + 1)]
    {
        let faults = check(&text, "deep.yaml", &[], &registry(), &Disk).err().unwrap();
        assert!(faults.list().iter().any(|f| f.code == Code::TooLarge), "{faults}");
    }
}

#[test]
fn a_large_file_of_faults_is_answered_soon() {
    let mut text = String::from("stillpoint: 1\nname: large\noperators:\n");
    let mut i = 0;
    while text.len() < MOST_BYTES / 4 {
        text.push_str(&format!(
            "  op_{i}: {{ use: estimate.fuse, inputs: {{ a: op_{}.pose, b: xp_{i}.pose }} }}\n",
            i + 1
        ));
        i += 1;
    }
    let start = std::time::Instant::now();
    let faults = check(&text, "large.yaml", &[], &registry(), &Disk).err().unwrap();
    println!("{} faults of {i} operators in {:.0} ms", faults.count(), start.elapsed().as_secs_f64() * 1e3);
    assert!(faults.count() > MOST_FAULTS);
}
