//! `stillpoint send`

use std::time::{Duration, Instant};

use clap::{Args, Parser};
use stillpoint_mechanics::plant::rigs::RigSpec;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::near::nearest;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Command, ConsoleCommand, HEADER_SIZE, Header, RigFault, Sample, SampleKind, Verb};
use stillpoint_shm::{Contract, Topic};
use zerocopy::IntoBytes;

use crate::amount::{self, Amount};
use crate::answer::{self, Answer};
use crate::attach::{Attached, Which};
use crate::exit::{Ended, Exit, Failure};
use crate::proposal;

/// Time within which the console has to send a command on.
const PATIENCE: Duration = Duration::from_secs(5);

/// Send a command to a running pipeline. The command becomes a sample that is recorded and replayed. For a target, the
/// command prints whether the target was taken or refused, and why; a refusal exits with 1. For a capture it prints the
/// numbers of the proposed reference and writes its picture next to the session, or says why nothing was captured.
#[derive(Args)]
pub struct Send {
    /// Console and verb, such as `console.arm`.
    command: String,
    /// Up to six values, each with its unit as in a pipeline file, such as `14mm` or `-1.35deg`; a number without a unit is
    /// in the SI unit. For a fault: its name (or `mend`), the number of the valve or bladder counted from 0, the diameter
    /// of a leak or the fraction of supply or duties that is left, and the duration.
    #[arg(allow_hyphen_values = true)]
    values: Vec<String>,
    #[command(flatten)]
    which: Which,
}

/// Options behind values. Since a value may begin with a hyphen, they arrive as values.
#[derive(Parser)]
struct Behind {
    #[command(flatten)]
    which: Which,
}

impl Send {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        self.with_options()?.send(registry)
    }

    /// The same with the options behind the values taken from them.
    fn with_options(&self) -> Result<Self, Failure> {
        let is_option = |value: &&String| value.starts_with("--") && value.len() > 2;
        let at = self.values.iter().position(|value| is_option(&value)).unwrap_or(self.values.len());
        let (values, options) = self.values.split_at(at);
        let program = "send".to_owned();
        let behind = Behind::try_parse_from(std::iter::once(&program).chain(options)).map_err(|fault| {
            let text = fault.to_string();
            let line = text.lines().next().unwrap_or_default();
            Failure::wrong(format!("{}: see `stillpoint send --help`", line.trim_start_matches("error: ")))
        })?;
        Ok(Self {
            command: self.command.clone(),
            values: values.iter().filter(|value| *value != "--").cloned().collect(),
            which: Which { run: behind.which.run.or_else(|| self.which.run.clone()) },
        })
    }

    fn send(&self, registry: &Registry) -> Ended {
        let named = self.command.split_once('.').filter(|(console, _)| !console.is_empty());
        let (console, word) = named.ok_or_else(|| {
            Failure::wrong(format!("`{}`: write the console and a verb, such as console.arm", self.command))
        })?;
        let verb = Verb::from_word(word).ok_or_else(|| {
            let words = Verb::ALL.iter().map(|(w, _)| *w);
            let near =
                nearest(word, words.clone()).map_or_else(String::new, |n| format!(", did you mean {n}?"));
            Failure::wrong(format!(
                "there is no verb `{word}`{near}; there are {}",
                words.collect::<Vec<_>>().join(", ")
            ))
        })?;
        let amounts = self.amounts(verb)?;
        let values: Vec<f64> = amounts.iter().map(|amount| amount.value).collect();
        self.counted(verb, &values)?;
        if verb == Verb::Target {
            amount::fit_channels(&amounts, &self.which.attach(registry)?.graph, console)?;
        }
        let listeners = match verb {
            Verb::Target => answer::listen(registry, &self.which, console)?,
            _ => Vec::new(),
        };
        let mut trackers = match verb {
            Verb::Capture | Verb::Confirm => proposal::watch(registry, &self.which, console, verb)?,
            _ => Vec::new(),
        };
        outln!("{}", deliver(registry, &self.which, console, verb, &values)?);
        let mut exit = Exit::Done;
        let outcomes = proposal::outcomes(&mut trackers, &self.which, verb)?;
        for (tracker, outcome) in trackers.iter().zip(outcomes) {
            outln!("{}: {}", tracker.topic(), outcome.text);
            if !outcome.is_done {
                exit = Exit::Failed;
            }
        }
        for listener in &listeners {
            let answer = listener.answer()?;
            outln!("{}", answer.line(listener.topic()));
            if matches!(answer, Answer::Refused(_)) {
                exit = Exit::Failed;
            }
        }
        Ok(exit)
    }
}

/// Sends a command and returns a line about its effect.
pub fn deliver(
    registry: &Registry,
    which: &Which,
    console: &str,
    verb: Verb,
    values: &[f64],
) -> Result<String, Failure> {
    let mut command = Command { verb: verb as u32, given: values.len() as u32, ..Command::default() };
    if values.len() > command.values.len() || values.iter().any(|v| !v.is_finite()) {
        return Err(Failure::wrong("a command has at most six values, all of them finite"));
    }
    command.values[..values.len()].copy_from_slice(values);
    let who = sender();
    let n = who.len().min(command.by.len());
    command.by[..n].copy_from_slice(&who.as_bytes()[..n]);
    let attached = which.attach(registry)?;
    let graph = &attached.graph;
    let port = Verb::ALL.iter().position(|(_, v)| *v == verb).unwrap_or_default();
    let operator = find(graph, console, Verb::ALL[port].0)?;
    if verb == Verb::Fault {
        has_part(graph, operator, port, values)?;
    }
    let inbox = contracts::inbox(graph, operator);
    let sent = pass(&attached, (operator, port), &inbox, ConsoleCommand::KIND, command.as_bytes())?;
    let word = format!("{console}.{}", Verb::ALL[port].0);
    let line = format!("sent {word} (sample {} of {word})", sent.sequence);
    Ok(match graph.consumers(operator, port).next() {
        Some(_) => line,
        None => format!("{line}; no operator of this pipeline takes {word}"),
    })
}

/// Puts a message into an inbox of a console, and waits until the console has sent it on: only what it sends is recorded.
/// Gives the header of that sample. `output`: the console, and its output for such messages.
pub fn pass(
    attached: &Attached,
    output: (usize, usize),
    inbox: &Contract,
    kind: &SampleKind,
    bytes: &[u8],
) -> Result<Header, Failure> {
    let Attached { graph, domain, .. } = attached;
    let console = &graph.operators[output.0].name;
    let contract = contracts::output(graph, output.0, output.1);
    let answer = Topic::open(domain, &contract).map_err(Failure::failed)?;
    let answer = answer.subscriber(contract.buffer).map_err(Failure::failed)?;
    answer.connect().map_err(Failure::failed)?;
    let topic = Topic::open(domain, inbox).map_err(Failure::failed)?;
    let publisher = topic.publisher().map_err(Failure::failed)?;
    publisher.connect().map_err(Failure::failed)?;
    let loan = publisher.loan(1).map_err(Failure::failed)?;
    let mut loan = loan.ok_or_else(|| Failure::failed("the console's inbox is full: try again"))?;
    let (meta, payload) = loan.parts_mut();
    meta[..HEADER_SIZE].copy_from_slice(Header { count: 1, ..Header::default() }.as_bytes());
    payload.copy_from_slice(bytes);
    let reached = publisher.send(loan).map_err(Failure::failed)?;
    if reached == 0 {
        return Err(Failure::failed(format!("{console} does not receive commands: is its process running?")));
    }
    // The sample lives in this process until the console has it.
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        while let Some(sample) = answer.receive().map_err(Failure::failed)? {
            if sample.pieces().check(kind).is_ok_and(|p| p.payload == bytes) {
                return Ok(sample.header());
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Err(Failure::failed(format!(
        "{console} has not sent {} within {} s, but may still do so: is its process running?",
        contract.topic,
        PATIENCE.as_secs()
    )))
}

/// The name of the person who sends, as samples carry it.
pub fn sender() -> String {
    std::env::var("USER").unwrap_or_default()
}

/// Refuses the fault of a valve or bladder that a rig of this pipeline does not have.
fn has_part(graph: &Graph, console: usize, port: usize, values: &[f64]) -> Result<(), Failure> {
    let named = |fault: RigFault| values.first() == Some(&f64::from(fault as u32));
    let Some(part) = values.get(1) else { return Ok(()) };
    for (operator, _) in graph.consumers(console, port) {
        let node = &graph.operators[operator];
        let Some(rig) = RigSpec::of_kind(node.stage.kind.name) else { continue };
        let (what, count) = match () {
            () if named(RigFault::StuckValve) => ("valve", 2 * rig.bladders()),
            () if named(RigFault::Leak) => ("bladder", rig.bladders()),
            () => continue,
        };
        if !(0..count).any(|known| known as f64 == *part) {
            return Err(Failure::wrong(format!(
                "invalid number of the {what} of {}: {part} (allowed: 0 to {})",
                node.name,
                count.saturating_sub(1)
            )));
        }
    }
    Ok(())
}

/// The console of this name.
fn find(graph: &Graph, name: &str, word: &str) -> Result<usize, Failure> {
    let is_console =
        |o: &usize| graph.operators[*o].stage.kind.name == stillpoint_pipeline::console::KIND_NAME;
    if let Some(operator) = graph.operator(name).filter(is_console) {
        return Ok(operator);
    }
    let all = (0..graph.operators.len()).filter(is_console);
    let words: Vec<String> = all.map(|o| format!("`{}.{word}`", graph.operators[o].name)).collect();
    Err(Failure::wrong(if words.is_empty() {
        format!("the pipeline {} has no console: add `console: {{ use: console, every: 20 ms }}`", graph.name)
    } else {
        format!("`{name}` is not a console of this pipeline: write {}", words.join(" or "))
    }))
}

/// The name that removes all faults.
const MEND: &str = "mend";

impl Send {
    /// The values; the first of a fault is its name.
    fn amounts(&self, verb: Verb) -> Result<Vec<Amount>, Failure> {
        let (name, rest) = match self.values.split_first() {
            Some((name, rest)) if verb == Verb::Fault => (name, rest),
            None if verb == Verb::Fault => return Err(Failure::wrong(format!("which fault? {}", faults()))),
            _ => return self.values.iter().map(|text| Amount::read(text, &["m", "rad"])).collect(),
        };
        let fault = RigFault::ALL.iter().find(|(word, _)| word == name).map(|(_, fault)| *fault);
        if fault.is_none() && name != MEND {
            let near = nearest(name, RigFault::ALL.iter().map(|(word, _)| *word).chain([MEND]));
            let near = near.map_or_else(String::new, |n| format!(", did you mean {n}?"));
            return Err(Failure::wrong(format!("there is no fault `{name}`{near}; {}", faults())));
        }
        // Number of the part, what is left or the diameter of a leak, and the duration.
        let size: &[&str] = if fault == Some(RigFault::Leak) { &["m"] } else { &[] };
        let units = [&[], size, &["s"][..]].into_iter().chain(std::iter::repeat(&[][..]));
        let code = Amount::plain(fault.map_or(0.0, |fault| f64::from(fault as u32)));
        let rest = rest.iter().zip(units).map(|(text, units)| Amount::read(text, units));
        std::iter::once(Ok(code)).chain(rest).collect()
    }

    /// Whether the number of values fits the verb.
    fn counted(&self, verb: Verb, values: &[f64]) -> Result<(), Failure> {
        let of_one_part = [RigFault::StuckValve, RigFault::Leak].map(|fault| f64::from(fault as u32));
        let (least, most, takes) = match (verb, values.first()) {
            (Verb::Target, _) => (1, usize::MAX, "a value in m or rad for each channel, such as 0.01"),
            (Verb::Accept, _) => (1, 1, "the number of the request whose plan is accepted"),
            (Verb::Fault, Some(0.0)) => (1, 1, "no values"),
            (Verb::Fault, Some(fault)) if of_one_part.contains(fault) => (
                2,
                4,
                "the number of the valve or bladder from 0, then the diameter of a leak, and the duration in seconds",
            ),
            (Verb::Fault, _) => {
                (1, 4, "at most a number, the fraction that is left, and the duration in seconds")
            }
            _ => (0, 0, "no values"),
        };
        if (least..=most).contains(&values.len()) {
            return Ok(());
        }
        let fault = self.values.first().filter(|_| verb == Verb::Fault);
        let message = fault.map_or_else(|| self.command.clone(), |fault| format!("{} {fault}", self.command));
        Err(Failure::wrong(format!("`{message}` takes {takes}")))
    }
}

fn faults() -> String {
    let words: Vec<&str> = RigFault::ALL.iter().map(|(word, _)| *word).collect();
    format!("there are {}, and `{MEND}` to remove all of them", words.join(", "))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        send: Send,
    }

    #[test]
    fn options_may_follow_values_that_begin_with_a_hyphen() {
        let of = |words: &[&str]| {
            let line = Line::try_parse_from([&["send", "console.target"], words].concat()).unwrap();
            line.send.with_options().map(|send| (send.values, send.which.run))
        };
        let values = ["-14mm", "0.5", "-1e-3"].map(str::to_owned).to_vec();
        for words in [
            &["-14mm", "0.5", "-1e-3", "--run", "mine"][..],
            &["-14mm", "0.5", "-1e-3", "--run=mine"],
            &["--run", "mine", "-14mm", "0.5", "-1e-3"],
            &["--run", "mine", "--", "-14mm", "0.5", "-1e-3"],
        ] {
            assert_eq!(of(words).ok().unwrap(), (values.clone(), Some("mine".to_owned())), "{words:?}");
        }
        assert_eq!(of(&[]).ok().unwrap(), (Vec::new(), None));
        let refused = of(&["0.5", "--rum", "mine"]).err().unwrap();
        assert!(refused.text.contains("unexpected argument '--rum'"), "{}", refused.text);
    }
}
