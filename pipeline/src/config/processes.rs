//! The section `processes`: which operators share a process, and how it runs.

use super::faults::{Code, Findings};
use super::fields::{check_name, count, missing, no_choice, period};
use super::near::shown;
use super::quantity;
use super::source::Marked;
use super::tree::{Entry, Keys, Node, Value};
use crate::graph::{Priority, Restart};
use crate::hosts::MAIN;

/// Keys of a process.
pub const KEYS: &[&str] = &["operators", "restart", "core", "priority", "outlives", "host"];
/// What happens to a process that ends without being asked, where the config does not say.
pub const RESTART: Restart = Restart::OnFault { limit: 5, backoff: 100_000_000 };
/// Most cores that a machine is thought to have.
pub const MOST_CORES: u32 = 4096;

/// Longest time for which a process may go on without its supervisor, ns.
const LONGEST_OUTLIVING: u64 = 10_000_000_000;

/// A process as it was written.
pub struct ParsedProcess {
    /// Its name.
    pub name: Marked<String>,
    /// Its operators.
    pub operators: Vec<Marked<String>>,
    /// Restart policy.
    pub restart: Restart,
    /// Core that it is bound to.
    pub core: Option<Marked<usize>>,
    /// Scheduling class.
    pub priority: Priority,
    /// How long it goes on after its supervisor died, ns.
    pub outlives: u64,
    /// The host that it runs on.
    pub host: Marked<String>,
}

/// Reads the section.
pub fn read(node: &Node, findings: &Findings) -> Vec<ParsedProcess> {
    let expected = "a mapping from names to lists of operators";
    let entries = node.map("`processes`", expected, findings).unwrap_or_default();
    entries.iter().map(|e| process(e, findings)).collect()
}

fn process(entry: &Entry, findings: &Findings) -> ParsedProcess {
    let name = entry.key.clone();
    check_name(&name, "a process", findings);
    let mut parsed = ParsedProcess {
        host: Marked::new(MAIN.to_owned(), name.span),
        name,
        operators: Vec::new(),
        restart: RESTART,
        core: None,
        priority: Priority::Normal,
        outlives: 0,
    };
    let what = shown(&parsed.name.value);
    let Value::Map(entries) = &entry.value.value else {
        parsed.operators = members(&entry.value, &what, findings);
        return parsed;
    };
    let keys = Keys::of(entries, KEYS, "a process", findings);
    match keys.get("operators") {
        Some(e) => parsed.operators = members(&e.value, "`operators`", findings),
        None => missing("a process", "operators", "[operator]", parsed.name.span, findings),
    }
    parsed.restart = keys.get("restart").and_then(|e| restart(&e.value, findings)).unwrap_or(RESTART);
    parsed.core = keys
        .get("core")
        .and_then(|e| Some(Marked::new(count(e, 0, MOST_CORES - 1, findings)? as usize, e.value.span)));
    parsed.priority =
        keys.get("priority").and_then(|e| priority(&e.value, findings)).unwrap_or(Priority::Normal);
    parsed.outlives = keys.get("outlives").and_then(|e| outlives(e, findings)).unwrap_or(0);
    if let Some(e) = keys.get("host")
        && let Some(text) = e.value.scalar("`host`", "the name of a host", findings)
    {
        parsed.host = Marked::new(text.to_owned(), e.value.span);
        check_name(&parsed.host, "a host", findings);
    }
    parsed
}

fn outlives(entry: &Entry, findings: &Findings) -> Option<u64> {
    let time = period(entry, findings)?;
    if time.value <= LONGEST_OUTLIVING {
        return Some(time.value);
    }
    findings.say(
        time.span,
        Code::OutOfRange,
        "`outlives` must be at most 10 s: a process without its supervisor is there to end safely",
        "the nearest allowed value is `10 s`",
    );
    None
}

fn members(node: &Node, what: &str, findings: &Findings) -> Vec<Marked<String>> {
    let expected = "a list of operators";
    let items = node.list(what, expected, findings).unwrap_or_default();
    if items.is_empty() && matches!(node.value, Value::List(_)) {
        findings.say(
            node.span,
            Code::WrongShape,
            "a process without operators does nothing",
            "name its operators, or remove it",
        );
    }
    items
        .iter()
        .filter_map(|i| {
            Some(Marked::new(i.scalar("a member", "the name of an operator", findings)?.to_owned(), i.span))
        })
        .collect()
}

fn restart(node: &Node, findings: &Findings) -> Option<Restart> {
    let words = &["never", "on-fault"];
    let entries = match &node.value {
        Value::Text(text) => {
            return match text.as_str() {
                "never" => Some(Restart::Never),
                "on-fault" => Some(RESTART),
                other => {
                    no_choice(node, other, "a restart policy", words, findings);
                    None
                }
            };
        }
        _ => node.map("`restart`", "`never`, `on-fault` or { limit: 5, backoff: 100 ms }", findings)?,
    };
    let keys = Keys::of(entries, &["limit", "backoff"], "`restart`", findings);
    let (mut limit, mut backoff) = (5, 100_000_000);
    if let Some(e) = keys.get("limit") {
        limit = count(e, 1, 1000, findings)?;
    }
    if let Some(e) = keys.get("backoff") {
        backoff = period(e, findings)?.value;
    }
    Some(Restart::OnFault { limit, backoff })
}

/// What ends the priority of a process that also runs where the machine refuses it.
const IF_ALLOWED: &str = " if allowed";

fn priority(node: &Node, findings: &Findings) -> Option<Priority> {
    let text = node.scalar("`priority`", "`normal`, `fifo N` or `fifo N if allowed`", findings)?;
    if text == "normal" {
        return Some(Priority::Normal);
    }
    let (real_time, is_must) = match text.strip_suffix(IF_ALLOWED) {
        Some(rest) => (rest, false),
        None => (text, true),
    };
    let Some(number) = real_time.strip_prefix("fifo").map(str::trim) else {
        let word = text.split_whitespace().next().unwrap_or(text);
        let help = match super::near::nearest(word, ["fifo", "normal"]) {
            Some("fifo") => format!("did you mean `{}`?", text.replacen(word, "fifo", 1)),
            Some(near) => format!("did you mean `{near}`?"),
            None => "write `normal`, or `fifo N` or `fifo N if allowed` with N from 1 to 99".into(),
        };
        findings.say(node.span, Code::UnknownChoice, format!("{} is not a priority", shown(text)), help);
        return None;
    };
    let level = quantity::whole(number).ok();
    let valid = level.and_then(|n| u8::try_from(n).ok()).filter(|n| (1..=99).contains(n));
    if valid.is_none() {
        let help = match level {
            Some(n) if n > 99 => "the nearest allowed value is `fifo 99`",
            Some(_) => "the nearest allowed value is `fifo 1`",
            None => "write for example `fifo 50`",
        };
        findings.say(
            node.span,
            Code::OutOfRange,
            format!("{}: a real-time priority is a whole number from 1 to 99", shown(text)),
            help,
        );
    }
    valid.map(if is_must { Priority::Fifo } else { Priority::FifoIfAllowed })
}
