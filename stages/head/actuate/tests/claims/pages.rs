//! The pages of valves, gate and datagrams name every reason with its bit, and every refusal.

use stillpoint_actuate::{DatagramRefusal, Key};
use stillpoint_samples::{ActuationReason, GateReason};

const VALVES: &str = include_str!("../../../../../docs/guide/actuation.md");
const GATE: &str = include_str!("../../../../../docs/guide/gate.md");
const DATAGRAMS: &str = include_str!("../../../../../docs/reference/datagrams.md");

/// The rows of the table of bits that follows a heading.
fn rows(page: &'static str, heading: &str) -> Vec<(u32, &'static str)> {
    let (_, section) = page.split_once(heading).unwrap();
    let section = section.split("\n#").next().unwrap();
    let row = |line: &'static str| {
        let mut cells = line.trim_matches('|').split('|').map(str::trim);
        Some((cells.next()?.parse().ok()?, cells.next()?))
    };
    section.lines().filter_map(row).collect()
}

#[test]
fn the_page_lists_every_reason_with_its_bit() {
    let bits = |all: &'static [(&'static str, u32)]| -> Vec<(u32, &'static str)> {
        all.iter().map(|(word, bit)| (bit.trailing_zeros(), *word)).collect()
    };
    assert_eq!(rows(VALVES, "### Reasons"), bits(ActuationReason::ALL));
    assert_eq!(rows(GATE, "## The gate"), bits(GateReason::ALL));
}

#[test]
fn the_page_lists_every_refusal() {
    for refusal in DatagramRefusal::ALL {
        assert!(DATAGRAMS.contains(&format!("`{}`", refusal.name())), "{refusal:?}");
    }
}

#[test]
fn the_key_of_the_simulated_rig_is_a_key() {
    assert!(Key::parse(include_bytes!("../../../../../examples/data/rig.key")).is_ok());
}
