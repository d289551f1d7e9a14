//! A parsed pipeline: the sections of the file as typed values with their places. Nothing is looked up yet.

use std::collections::BTreeMap;

use super::faults::{Code, Findings};
use super::fields::missing;
use super::near::{LONGEST_NAME, as_name, is_name, shown};
use super::operators::{self, ParsedOperator};
use super::processes::{self, ParsedProcess};
use super::source::Span;
use super::tree::{Keys, Node};
use super::{contracts, frames, host_section, links, quantity, record, ros2_section};
use crate::frames::Frames;

/// The version of the format.
pub const VERSION: i128 = 1;
/// Keys of the file.
pub const KEYS: &[&str] = &[
    "stillpoint",
    "name",
    "seed",
    "include",
    "parameters",
    "frames",
    "operators",
    "links",
    "hosts",
    "ros2",
    "processes",
    "record",
    "contracts",
];

/// A parsed pipeline. What had a fault is left out.
pub struct Document<'t> {
    /// Name of the pipeline.
    pub name: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The frames.
    pub frames: Frames,
    /// The operators, in the order of the file.
    pub operators: Vec<ParsedOperator<'t>>,
    /// Where the links stand.
    pub links: Option<Span>,
    /// The hosts that exchange samples over the network, in the order of the file.
    pub hosts: Vec<host_section::ParsedHost>,
    /// How the pipeline takes part in ROS 2.
    pub ros2: Option<ros2_section::ParsedRos2>,
    /// The processes, in the order of the file.
    pub processes: Vec<ParsedProcess>,
    /// What is recorded.
    pub record: record::Parsed,
    /// Bounds of the time of paths.
    pub contracts: Vec<contracts::ParsedContract>,
}

impl Document<'_> {
    /// Numbers of operators by name.
    pub fn numbers(&self) -> BTreeMap<&str, usize> {
        self.operators.iter().enumerate().map(|(i, o)| (o.name.value.as_str(), i)).collect()
    }
}

/// Reads the sections of a file. `None` where the file is no mapping.
pub fn read<'t>(root: &'t Node, findings: &Findings) -> Option<Document<'t>> {
    let entries = root.map("the file", "a mapping with the keys of a pipeline", findings)?;
    let keys = Keys::of(entries, KEYS, "a pipeline", findings);
    let top = root.span.first(1);
    version(keys.get("stillpoint").map(|e| &e.value), "a pipeline", top, findings);
    let name = name(&keys, top, findings);
    let seed = keys.get("seed").and_then(|e| seed(&e.value, findings)).unwrap_or(1);
    let frames = keys.get("frames").map(|e| frames::read(&e.value, findings)).unwrap_or_default();
    let mut operators = match keys.get("operators") {
        Some(entry) => operators::read(entry, findings),
        None => {
            missing("a pipeline", "operators", "{ rig: { use: ... } }", top, findings);
            Vec::new()
        }
    };
    let links = keys.get("links").map(|entry| {
        links::read(&entry.value, &mut operators, findings);
        entry.value.span
    });
    let mut processes =
        keys.get("processes").map(|e| processes::read(&e.value, findings)).unwrap_or_default();
    let hosts = keys.get("hosts").map(|e| host_section::read(&e.value, findings)).unwrap_or_default();
    host_section::connect(&hosts, &mut operators, &mut processes, findings);
    let ros2 = keys.get("ros2").map(|e| ros2_section::read(e, findings));
    let record = keys.get("record").and_then(|e| record::read(&e.value, findings)).unwrap_or_default();
    let contracts = keys.get("contracts").map(|e| contracts::read(&e.value, findings)).unwrap_or_default();
    Some(Document { name, seed, frames, operators, links, hosts, ros2, processes, record, contracts })
}

/// Checks the version of the format.
pub fn version(node: Option<&Node>, place: &str, top: Span, findings: &Findings) {
    let Some(node) = node else {
        return missing(place, "stillpoint", "1", top, findings);
    };
    let Some(text) = node.scalar("`stillpoint`", "the version of the format", findings) else {
        return;
    };
    if quantity::whole(text).ok() != Some(VERSION) {
        findings.say(
            node.span,
            Code::WrongVersion,
            format!("{} is not a version that this build reads", shown(text)),
            format!("write `stillpoint: {VERSION}`"),
        );
    }
}

fn name(keys: &Keys<'_>, top: Span, findings: &Findings) -> String {
    let Some(entry) = keys.get("name") else {
        missing("a pipeline", "name", "head-3dof", top, findings);
        return String::new();
    };
    let Some(text) = entry.value.scalar("`name`", "the pipeline's name", findings) else {
        return String::new();
    };
    if !is_name(&text.replace('-', "_")) {
        let help = as_name(text).map(|n| format!("write `{}`", n.replace('_', "-")));
        findings.say(
            entry.value.span,
            Code::BadName,
            format!(
                "{} cannot name a pipeline: a name is lower-case letters, digits, `-` and `_`",
                shown(text)
            ),
            help.unwrap_or_else(|| format!("write a name of at most {LONGEST_NAME} characters")),
        );
    }
    text.to_owned()
}

/// Reads the seed.
pub fn seed(node: &Node, findings: &Findings) -> Option<u64> {
    let text = node.scalar("`seed`", "a whole number", findings)?;
    let seed = quantity::whole(text).ok().and_then(|s| u64::try_from(s).ok());
    if seed.is_none() {
        findings.say(
            node.span,
            Code::NotANumber,
            format!("the seed {} is not a whole number from 0 to {}", shown(text), u64::MAX),
            "write a whole number, for example `seed: 7`",
        );
    }
    seed
}
