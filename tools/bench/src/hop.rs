//! `stillpoint bench hop`: the latency of a payload from operator to operator, against bare iceoryx2.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use clap::{Args, ValueEnum};
use serde::Serialize;
use stillpoint_operator::Registry;

use super::bare::Chain;
use super::cores::{self, Layout};
use super::figures::{Ages, Quantiles, bytes, ratio};
use super::stages::Word;
use super::window::Window;
use stillpoint::{Ended, Exit, Failure, print_json};

/// Sizes of the payloads, bytes, with the time between two payloads, us.
const PAYLOADS: [(usize, u64); 4] = [(64, 1000), (4096, 1000), (1_200_000, 5000), (3_700_000, 16_000)];
/// Number of batches of ages that the sink of a window sends per second.
const BATCHES_PER_SECOND: u64 = 20;

/// Measure the latency from operator to operator, against bare iceoryx2 ports with listeners, in interleaved windows.
///
/// A latency begins just before the sender writes its payload into the loan. It ends at the first line of the
/// receiver's step in stillpoint, and at the line after `receive` on bare ports. `handed` begins just after the payload
/// is written. One group leaves the payload in the loan unchanged except for its two times; it measures the hop without
/// the effect of a large payload on the caches. Both sides read the monotonic clock of the machine. Every window starts
/// new processes. Journals are on; nothing is recorded. Times in the JSON are in us.
#[derive(Args)]
pub struct Hop {
    /// Number of cores: one, two, or both in turn.
    #[arg(long, value_enum, default_value_t = Which::Both)]
    cores: Which,
    /// Number of windows of each kind.
    #[arg(long, default_value_t = 20, value_parser = super::at_least::<usize>(1))]
    windows: usize,
    /// Length of a window, ms.
    #[arg(long, default_value_t = 500, value_parser = super::at_least::<u64>(50))]
    length: u64,
    /// Measure only this kind of window. A ratio needs both of its kinds.
    #[arg(long, value_enum, value_name = "KIND")]
    kind: Vec<Kind>,
    /// Measure only payloads of this number of bytes: 64, 4096, 1200000 or 3700000.
    #[arg(long, value_name = "BYTES", value_parser = payload)]
    payload: Vec<usize>,
    /// A short measurement of everything: two windows of 200 ms.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    One,
    Two,
    Both,
}

/// The kind of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
enum Kind {
    BareOne,
    One,
    Tapped,
    BareThree,
    Three,
    Grouped,
    Busy,
    Untouched,
    UntouchedBusy,
}

const KINDS: [Kind; 9] = [
    Kind::BareOne,
    Kind::One,
    Kind::Tapped,
    Kind::BareThree,
    Kind::Three,
    Kind::Grouped,
    Kind::Busy,
    Kind::Untouched,
    Kind::UntouchedBusy,
];

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::BareOne => "iceoryx2, one hop",
            Self::One => "one hop",
            Self::Tapped => "one hop, tapped",
            Self::BareThree => "iceoryx2, three hops",
            Self::Three => "three hops",
            Self::Grouped => "one hop in a group",
            Self::Busy => "the same, busy",
            Self::Untouched => "payload untouched",
            Self::UntouchedBusy => "the same, busy",
        }
    }

    fn grouped(self) -> bool {
        matches!(self, Self::Grouped | Self::Busy | Self::Untouched | Self::UntouchedBusy)
    }

    /// Whether there is no pause between two payloads. Without a pause, caches and clock rate do not change.
    fn busy(self) -> bool {
        matches!(self, Self::Busy | Self::UntouchedBusy)
    }

    fn hops(self) -> usize {
        if matches!(self, Self::BareThree | Self::Three) { 3 } else { 1 }
    }

    /// The kind to which its latencies are compared.
    fn against(self) -> Option<Self> {
        match self {
            Self::One => Some(Self::BareOne),
            Self::Three => Some(Self::BareThree),
            Self::Tapped => Some(Self::One),
            _ => None,
        }
    }
}

/// One line of the result.
#[derive(Serialize)]
struct HopFigures {
    cores: Layout,
    bytes: usize,
    kind: Kind,
    /// Ages since just before the payload was written, us.
    whole: Quantiles,
    /// Ages since just after the payload was written, us.
    handed: Quantiles,
    /// Kind of window to which the ratios relate.
    against: Option<Kind>,
    /// Median over the windows of the ratio of the medians of `whole`.
    whole_ratio: Option<f64>,
    /// The same of `handed`.
    handed_ratio: Option<f64>,
}

/// A size that none of the payloads has.
#[derive(Debug, thiserror::Error)]
#[error("it is none of {:?}", PAYLOADS.map(|(size, _)| size))]
struct NoPayload;

/// Parses the size of one of the payloads, bytes.
fn payload(text: &str) -> Result<usize, NoPayload> {
    let asked = text.parse().ok().filter(|size| PAYLOADS.iter().any(|(of, _)| of == size));
    asked.ok_or(NoPayload)
}

impl Hop {
    /// Runs the windows and prints their latencies.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let cores = cores::cores()?;
        let layouts = match self.cores {
            Which::One => vec![Layout::One],
            Which::Two => vec![Layout::Two],
            Which::Both => vec![Layout::One, Layout::Two],
        };
        if layouts.contains(&Layout::Two) && cores.len() < 2 {
            return Err(Failure::wrong("this process may use one core only: measure with --cores one"));
        }
        let mut lines = Vec::new();
        for layout in layouts {
            // If the chain runs on one core, the supervisor and the taps run on the other cores.
            let rest: Vec<usize> = cores.iter().copied().filter(|c| *c != layout.core(&cores, 1)).collect();
            cores::bind(if layout == Layout::One && !rest.is_empty() { &rest } else { &cores })?;
            for (size, period) in PAYLOADS {
                if self.payload.is_empty() || self.payload.contains(&size) {
                    let found = self.measure(layout, &cores, size, period, registry)?;
                    if !self.json {
                        out!("{}", table(&found));
                    }
                    lines.extend(found);
                }
            }
        }
        if self.json {
            print_json(&lines)?;
        }
        Ok(Exit::Done)
    }

    fn measure(
        &self,
        layout: Layout,
        cores: &[usize],
        size: usize,
        period_us: u64,
        registry: &Registry,
    ) -> Result<Vec<HopFigures>, Failure> {
        let windows = if self.quick { 2 } else { self.windows };
        let length = Duration::from_millis(if self.quick { 200 } else { self.length });
        let chain: Vec<usize> = (0..4).map(|place| layout.core(cores, place)).collect();
        let mut ages: BTreeMap<Kind, Vec<Ages>> = BTreeMap::new();
        for _ in 0..windows {
            for kind in KINDS {
                // A group runs on one core.
                if kind.grouped() && layout == Layout::Two
                    || !self.kind.is_empty() && !self.kind.contains(&kind)
                {
                    continue;
                }
                let period = Duration::from_micros(if kind.busy() { 1 } else { period_us });
                let words = size / size_of::<Word>();
                let window = match kind {
                    Kind::BareOne | Kind::BareThree => {
                        Chain { words, hops: kind.hops(), cores: &chain, period, length }.run()?
                    }
                    _ => live(kind, words, &chain, period, length, registry)?,
                };
                ages.entry(kind).or_default().push(window);
            }
        }
        Ok(KINDS.iter().filter_map(|kind| line(layout, size, *kind, &ages)).collect())
    }
}

fn live(
    kind: Kind,
    words: usize,
    cores: &[usize],
    period: Duration,
    length: Duration,
    registry: &Registry,
) -> Result<Ages, Failure> {
    let pipeline = pipeline(kind, words, cores, period);
    let taps: &[&str] = if kind == Kind::Tapped { &["sink.ages", "source.load"] } else { &["sink.ages"] };
    let window = Window { pipeline: &pipeline, registry, length, session: None, taps };
    Ok(window.run()?.ages_of("sink.ages"))
}

/// The text of a pipeline with a chain of operators.
fn pipeline(kind: Kind, words: usize, cores: &[usize], period: Duration) -> String {
    let mut names = vec!["source".to_string()];
    names.extend((1..kind.hops()).map(|i| format!("relay{i}")));
    names.push("sink".to_string());
    let per_batch = 1_000_000 / (period.as_micros() as u64 * BATCHES_PER_SECOND);
    // The rate of a group without pauses depends on its payload, not on its period.
    let batch = if kind.busy() { 64 } else { per_batch.max(1) };
    // Only the two times of an untouched payload are written, so that it does not displace other data from the caches.
    let untouched = matches!(kind, Kind::Untouched | Kind::UntouchedBusy);
    let written = if untouched { ", written: 2" } else { "" };
    let mut text = String::from("stillpoint: 1\nname: bench-hop\noperators:\n");
    for (place, name) in names.iter().enumerate() {
        let from = place.checked_sub(1).map(|before| format!("inputs: {{ load: {}.load }}", names[before]));
        let rest = match (from, place + 1 == names.len()) {
            (None, _) => {
                let every = period.as_micros();
                format!("use: bench.source, every: {every} us, params: {{ words: {words}{written} }}")
            }
            (Some(from), false) => format!("use: bench.relay, {from}, params: {{ words: {words} }}"),
            (Some(from), true) => format!("use: bench.sink, {from}, params: {{ batch: {batch} }}"),
        };
        let _ = writeln!(text, "  {name}: {{ {rest} }}");
    }
    text += "processes:\n";
    if kind.grouped() {
        let _ = writeln!(text, "  all: {{ operators: [{}], core: {} }}", names.join(", "), cores[0]);
    } else {
        for (name, core) in names.iter().zip(cores) {
            let _ = writeln!(text, "  {name}: {{ operators: [{name}], core: {core} }}");
        }
    }
    text
}

fn line(layout: Layout, size: usize, kind: Kind, ages: &BTreeMap<Kind, Vec<Ages>>) -> Option<HopFigures> {
    let windows = ages.get(&kind)?;
    let mut all = Ages::default();
    windows.iter().for_each(|w| all.add(w));
    let of = |kind: Kind, pick: fn(&Ages) -> &Vec<u64>| -> Vec<Vec<u64>> {
        ages.get(&kind).into_iter().flatten().map(|w| pick(w).clone()).collect()
    };
    let against = kind.against().filter(|other| ages.contains_key(other));
    let to = |pick| against.map(|other| ratio(&of(kind, pick), &of(other, pick)));
    Some(HopFigures {
        cores: layout,
        bytes: size,
        kind,
        whole: Quantiles::of(&all.whole),
        handed: Quantiles::of(&all.handed),
        against,
        whole_ratio: to(|a| &a.whole),
        handed_ratio: to(|a| &a.handed),
    })
}

fn table(lines: &[HopFigures]) -> String {
    let mut text = String::new();
    if let Some(first) = lines.first() {
        let on = if first.cores == Layout::One { "one core" } else { "two cores" };
        let _ = writeln!(
            text,
            "{:<22} {:>9} {:>9} {:>9} {:>7} {:>9} {:>9} {:>7}   us",
            format!("{}, {on}", bytes(first.bytes)),
            "p50",
            "p90",
            "p99",
            "ratio",
            "handed",
            "p99",
            "ratio"
        );
    }
    for line in lines {
        let ratio = |r: Option<f64>| r.map_or_else(String::new, |r| format!("{r:.2}"));
        let _ = writeln!(
            text,
            "{:<22} {:>9.1} {:>9.1} {:>9.1} {:>7} {:>9.2} {:>9.2} {:>7}",
            line.kind.name(),
            line.whole.p50,
            line.whole.p90,
            line.whole.p99,
            ratio(line.whole_ratio),
            line.handed.p50,
            line.handed.p99,
            ratio(line.handed_ratio)
        );
    }
    text
}
