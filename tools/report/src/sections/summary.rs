//! The session at a glance.

use serde::Serialize;
use stillpoint_pipeline::session::RUN;
use stillpoint_recorder::{Ended, session_parts};

use super::errors::compared;
use super::{faults, ledger};
use crate::ReportError;
use crate::hold::{Held, Hold};
use crate::motion::ErrorFigures;
use crate::numbers::{count, fixed, megabytes, started};
use crate::page::{Block, Section, Tile};
use crate::source::Source;
use crate::unanswered::{Answers, figures_of};

#[derive(Serialize)]
struct SummaryFigures {
    pipeline: Option<String>,
    started_utc: Option<String>,
    seconds: f64,
    simulated: bool,
    complete: bool,
    ended_in_order: bool,
    operators: usize,
    samples: u64,
    file_bytes: u64,
    parts: usize,
    failed_activations_and_restarts: usize,
    /// Topics of trackers that never had a reference.
    uncaptured: Vec<String>,
    unreadable_samples: u64,
    ledger_lines: usize,
    ledger_unexplained: u64,
    /// The errors of the estimate that stands last: fused, or filtered, or raw.
    best: Vec<ErrorFigures>,
    thinned: bool,
    /// How the head was held, by the samples of the session.
    held: Option<Held>,
    /// What operators found.
    found: Vec<String>,
    /// Operators that should have answered and never did.
    unanswered: Vec<String>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let session = recording.session;
    let run = session.metadata().get(RUN);
    let fact = |name: &str| run.and_then(|r| r.get(name)).cloned();
    let faults = faults::of(from);
    let accounts = ledger::of(from);
    let parts = session_parts(&recording.path).unwrap_or_default();
    let best = compared(recording)
        .pop()
        .map(|c| (0..6).filter_map(|channel| c.found.figures(&c.signal.topic, channel)).collect::<Vec<_>>());
    let graph = from.pipeline.as_ref().ok().map(|(graph, _)| graph);
    let verdict =
        graph.map(|graph| Answers::of_session(graph, session).verdict(graph, &figures_of(session, graph)));
    let verdict = verdict.unwrap_or_default();
    let figures = SummaryFigures {
        pipeline: fact("pipeline"),
        started_utc: started(session),
        seconds: recording.length(),
        simulated: fact("directed").is_some_and(|d| d == "true"),
        complete: faults.gaps.is_empty(),
        ended_in_order: session.ended() == Ended::InOrder,
        operators: recording.wiring.stages().len(),
        samples: session.topics().iter().map(|t| t.samples).sum(),
        file_bytes: parts.iter().filter_map(|p| p.metadata().ok()).map(|m| m.len()).sum(),
        parts: parts.len(),
        failed_activations_and_restarts: faults.events.len(),
        uncaptured: recording
            .alignments
            .iter()
            .filter(|a| a.is_uncaptured())
            .map(|a| a.topic.clone())
            .collect(),
        unreadable_samples: faults.unreadable,
        ledger_lines: accounts.lines.len(),
        ledger_unexplained: accounts.unexplained,
        best: best.unwrap_or_default(),
        thinned: recording.is_thinned(),
        held: graph.and_then(|graph| Hold::of_session(graph, session)),
        found: verdict.found,
        unanswered: verdict.unanswered,
    };
    let mut section = Section::new("summary", "At a glance", &figures)?;
    section
        .blocks
        .extend(figures.unanswered.iter().map(|what| Block::Warning(format!("No answer: {what}."))));
    section.blocks.push(Block::Tiles(tiles(&figures, &accounts)));
    section.blocks.extend(figures.found.iter().map(|what| Block::Text(format!("{what}."))));
    if figures.thinned {
        section.blocks.push(Block::Warning(
            "The session is long. The figures of its longest topics are computed from evenly spaced samples."
                .into(),
        ));
    }
    Ok(section)
}

fn tiles(f: &SummaryFigures, accounts: &ledger::Accounts) -> Vec<Tile> {
    let mut tiles = vec![
        Tile::plain("pipeline", f.pipeline.clone().unwrap_or_else(|| "unknown".into())),
        Tile::plain("length", format!("{} s", fixed(f.seconds, 1))),
        Tile::plain("clock", if f.simulated { "simulated" } else { "live" }),
    ];
    tiles.extend(f.started_utc.iter().map(|t| Tile::plain("started", t.clone())));
    tiles.extend(f.held.iter().flat_map(held));
    tiles.push(Tile::state("session", if f.complete { "complete" } else { "has gaps" }, f.complete));
    let balanced = accounts.unexplained == 0 && accounts.from == ledger::From::Session;
    let ledger = match (accounts.from, accounts.unexplained) {
        (ledger::From::Nowhere, _) => "none".to_owned(),
        (_, 0) if balanced => "balances".to_owned(),
        (_, 0) => "from the journals only".to_owned(),
        (_, n) => format!("{} unexplained", count(n)),
    };
    tiles.push(Tile::state("ledger", ledger, balanced));
    let failed = f.failed_activations_and_restarts;
    tiles.push(Tile::state("failures and restarts", count(failed as u64), failed == 0));
    let without = f.uncaptured.iter();
    tiles.extend(
        without.map(|topic| Tile::state(&format!("reference of {topic}"), "none captured: no pose", false)),
    );
    tiles.push(Tile::plain("operators", f.operators.to_string()));
    tiles.push(Tile::plain("samples", count(f.samples)));
    let size = format!(
        "{}, {} MB/s",
        megabytes(f.file_bytes),
        fixed(f.file_bytes as f64 * 1e-6 / f.seconds.max(1e-9), 2)
    );
    tiles.push(Tile::plain("on disk", size));
    tiles.extend(f.best.iter().map(|e| {
        let name = format!("error of {}, {}: rms", e.topic, e.channel);
        Tile::plain(&name, format!("{} {}", fixed(e.rms, 3), e.unit))
    }));
    tiles
}

/// Beam, error from the target and faults of the valves.
fn held(held: &Held) -> Vec<Tile> {
    let beams = held.gates.iter().map(|gate| {
        let share = gate.duty.map_or("-".to_owned(), |duty| format!("{} %", fixed(duty * 100.0, 0)));
        Tile::state(&format!("{}: beam on", gate.topic), share, gate.duty.is_some_and(|duty| duty > 0.0))
    });
    let errors = held.targets.iter().flat_map(|against| {
        against.channels.iter().map(|off| {
            let name =
                format!("{} from {}, {}: rms of the last 5 s", against.estimate, against.target, off.channel);
            Tile::plain(&name, format!("{} {}", fixed(off.rms, 2), off.unit))
        })
    });
    let faults = held.valves.iter().map(|valves| {
        let sentence = valves.fault_times.line("in fault").unwrap_or_else(|| "none".to_owned());
        Tile::state(&format!("{}: faults", valves.topic), sentence, valves.fault_times.times == 0)
    });
    beams.chain(errors).chain(faults).collect()
}
