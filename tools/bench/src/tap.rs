//! `stillpoint bench tap`: the cost of an attached `echo`, `top` or `view` for the latency of a hop.

use std::fmt::Write;
use std::time::Duration;

use clap::{Args, ValueEnum};
use serde::Serialize;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_operator::Registry;

use super::attached::Tool;
use super::cores::{self, Layout};
use super::figures::{Ages, Quantiles, bytes, median};
use super::folder::Folder;
use super::program::{Program, ages};
use super::stages::Word;

/// Sizes of the payloads, bytes, with the time between two payloads, us.
const PAYLOADS: [(usize, u64); 2] = [(64, 1000), (1_200_000, 5000)];
/// Number of batches of ages that the sink sends per second.
const BATCHES_PER_SECOND: u64 = 20;
/// The largest ratio that the design permits.
const HELD_TO: f64 = 1.05;
/// Time for a command to come to rest after its first output, and for the hop after the command's end.
const SETTLE: Duration = Duration::from_millis(300);

/// Measure what an attached `echo`, `top` or `view` costs a hop: windows with and without the command alternate in one
/// run.
///
/// A source and a sink are processes on one core. The command is a separate program on any core; `top` draws in a
/// terminal of 160 columns, `view` serves a client that reads all events. The row `none` compares windows that both have
/// no command: it shows what this machine can resolve. Times in the JSON are in us.
#[derive(Args)]
pub struct TapCost {
    /// Number of pairs of windows for each command.
    #[arg(long, default_value_t = 20, value_parser = super::at_least::<usize>(1))]
    windows: usize,
    /// Length of a window, ms.
    #[arg(long, default_value_t = 1000, value_parser = super::at_least::<u64>(200))]
    length: u64,
    /// Measure only this command.
    #[arg(long, value_enum, value_name = "COMMAND")]
    tool: Vec<Tool>,
    /// Measure only payloads of this number of bytes: 64 or 1200000.
    #[arg(long, value_name = "BYTES", value_parser = payload)]
    payload: Vec<usize>,
    /// A short measurement: two pairs of 300 ms.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// One line of the result.
#[derive(Serialize)]
struct Line {
    bytes: usize,
    tool: Tool,
    /// Latencies in the windows without the command, us.
    without: Quantiles,
    /// Latencies in the windows with the command, us.
    with: Quantiles,
    /// Median over the pairs of the ratio of their medians.
    ratio: f64,
    /// The quarter of the pairs with the smallest ratios is below the first, that with the largest above the second.
    quartiles: [f64; 2],
    held_to: f64,
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

impl TapCost {
    /// Runs the windows and prints the ratios.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(None)?;
        let mut lines = Vec::new();
        for (size, period) in PAYLOADS {
            if self.payload.is_empty() || self.payload.contains(&size) {
                lines.extend(self.measure(size, period, &folder, registry)?);
            }
        }
        if self.json {
            print_json(&lines)?;
        } else {
            out!("{}", table(&lines));
        }
        Ok(Exit::Done)
    }

    fn measure(
        &self,
        size: usize,
        period_us: u64,
        folder: &Folder,
        registry: &Registry,
    ) -> Result<Vec<Line>, Failure> {
        let all = cores::cores()?;
        let core = Layout::One.core(&all, 0);
        // The pipeline binds its processes itself. The reader of the ages stays off their core.
        let rest: Vec<usize> = all.iter().copied().filter(|c| *c != core).collect();
        let rest = if rest.is_empty() { all.clone() } else { rest };
        let (pairs, length) = if self.quick { (2, 300) } else { (self.windows, self.length) };
        let length = Duration::from_millis(length);
        let tools: Vec<Tool> =
            if self.tool.is_empty() { Tool::value_variants().to_vec() } else { self.tool.clone() };
        let at = folder.free("tap")?;
        cores::bind(&all)?;
        let mut program = Program::of(&pipeline(size, period_us, core), &at, &["--no-record"])?;
        cores::bind(&rest)?;
        let (attached, sink) = program.tap(registry, "sink.ages")?;
        let window = || -> Result<Ages, Failure> {
            std::thread::sleep(SETTLE);
            let found = ages(&sink, length)?;
            match found.whole.is_empty() {
                true => Err(Failure::failed("no payload arrived in a window: choose a greater --length")),
                false => Ok(found),
            }
        };
        let mut found: Vec<(Vec<Ages>, Vec<Ages>)> = vec![Default::default(); tools.len()];
        for _ in 0..pairs {
            for (tool, (without, with)) in tools.iter().zip(&mut found) {
                without.push(window()?);
                cores::bind(&all)?;
                let command = tool.attach(attached.pid, "source.load")?;
                cores::bind(&rest)?;
                with.push(window()?);
                drop(command);
            }
        }
        cores::bind(&all)?;
        // Ports are closed before the run ends.
        drop((sink, attached));
        program.processes();
        program.end()?;
        Ok(tools.iter().zip(&found).map(|(tool, (without, with))| line(size, *tool, without, with)).collect())
    }
}

fn pipeline(size: usize, period_us: u64, core: usize) -> String {
    let words = size / size_of::<Word>();
    let batch = (1_000_000 / (period_us * BATCHES_PER_SECOND)).max(1);
    format!(
        "stillpoint: 1
name: bench-tap
operators:
  source: {{ use: bench.source, every: {period_us} us, params: {{ words: {words} }} }}
  sink: {{ use: bench.sink, inputs: {{ load: source.load }}, params: {{ batch: {batch} }} }}
processes:
  source: {{ operators: [source], core: {core} }}
  sink: {{ operators: [sink], core: {core} }}
"
    )
}

fn line(size: usize, tool: Tool, without: &[Ages], with: &[Ages]) -> Line {
    let whole = |windows: &[Ages]| {
        let all: Vec<u64> = windows.iter().flat_map(|w| w.whole.iter().copied()).collect();
        Quantiles::of(&all)
    };
    let p50 = |window: &Ages| Quantiles::of(&window.whole).p50;
    let mut ratios: Vec<f64> = with.iter().zip(without).map(|(a, b)| p50(a) / p50(b)).collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share).round() as usize];
    Line {
        bytes: size,
        tool,
        without: whole(without),
        with: whole(with),
        ratio: median(&ratios),
        quartiles: [at(0.25), at(0.75)],
        held_to: HELD_TO,
    }
}

fn table(lines: &[Line]) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:<8} {:<8} {:>11} {:>9} {:>9} {:>9} {:>7}  {:<14} held to; us",
        "payload", "command", "without p50", "p99", "with p50", "p99", "ratio", "quartiles"
    );
    for l in lines {
        let quartiles = format!("{:.2} to {:.2}", l.quartiles[0], l.quartiles[1]);
        let _ = writeln!(
            text,
            "{:<8} {:<8} {:>11.1} {:>9.1} {:>9.1} {:>9.1} {:>7.3}  {:<14} {}",
            bytes(l.bytes),
            l.tool.name(),
            l.without.p50,
            l.without.p99,
            l.with.p50,
            l.with.p99,
            l.ratio,
            quartiles,
            l.held_to
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(p50: u64) -> Ages {
        Ages { whole: vec![p50 - 1, p50, p50 + 9], handed: Vec::new() }
    }

    #[test]
    fn a_ratio_is_of_pairs_and_not_of_all_windows() {
        // The machine became four times slower after the first pair; the command costs 10 %.
        let (without, with) = ([window(1000), window(4000)], [window(1100), window(4400)]);
        let line = line(64, Tool::Top, &without, &with);
        assert!((line.ratio - 1.1).abs() < 1e-9, "{}", line.ratio);
        assert_eq!((line.without.count, line.with.p50), (6, 4.399));
    }
}
