//! How long samples took from a source to a sink, and which operator was to blame for the longest.

use crate::ReportError;
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Section, Table};
use crate::source::Source;
use crate::trace::{Blame, Journals, PathFigures, Trace, as_run, laps};

/// Paths that are shown; all of them are among the figures.
const SHOWN: usize = 20;

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let session = from.recording.session;
    let graph = from.pipeline.as_ref().ok().map(|(graph, _)| as_run(graph, session));
    let journals = Journals::of_session(session, graph.as_ref()).with_laps(laps(session));
    let trace = Trace::of(&journals, |_, _| true);
    let mut section = Section::new("trace", "From source to sink", &trace)?;
    let Some(longest) = trace.longest() else {
        return Ok(section.nothing("No sample came from a source to a sink, as far as the journals say."));
    };
    section.blocks.push(Block::Text(
        "The time from the acquisition of a sample to the last sending at the end of a path, from the journals. The \
         operator to blame is the one whose part of the time is the most beyond its median, in the ten longest."
            .into(),
    ));
    let arrived: Vec<&PathFigures> = trace.quickest().into_iter().map(|at| &trace.paths[at]).collect();
    section.blocks.push(Block::Table(overview(&arrived)));
    section.blocks.push(Block::Table(hops(longest)));
    if longest.hops.iter().any(|hop| !hop.laps.is_empty()) {
        section.blocks.push(Block::Table(within(longest)));
    }
    Ok(section)
}

fn ms(value: Option<f64>) -> Cell {
    Cell::number(fixed(value, 2))
}

fn overview(paths: &[&PathFigures]) -> Table {
    let columns =
        ["path", "samples", "arrived", "p50, ms", "p90", "p99", "worst", "to blame for the ten longest"];
    let caption = match paths.len().saturating_sub(SHOWN) {
        0 => "Of the paths with one start and one end, that on which samples arrive first.".to_owned(),
        more => format!("{more} more paths are among the figures of the report."),
    };
    let mut table = Table::new(caption, &columns);
    for path in paths.iter().take(SHOWN) {
        table.row([
            Cell::text(&path.path),
            Cell::number(count(path.samples as u64)),
            Cell::number(count(path.arrived as u64)),
            ms(path.total_ms.p50),
            ms(path.total_ms.p90),
            ms(path.total_ms.p99),
            ms(path.total_ms.max),
            Cell::text(path.blame.iter().map(Blame::text).collect::<Vec<_>>().join(", ")),
        ]);
    }
    table
}

fn hops(path: &PathFigures) -> Table {
    let columns = [
        "operator",
        "waited p50, ms",
        "p99",
        "worst",
        "stepped p50, ms",
        "p99",
        "worst",
        "since acquisition p50, ms",
        "worst",
    ];
    let mut table = Table::new(format!("The path {}.", path.path), &columns);
    for hop in &path.hops {
        table.row([
            Cell::text(&hop.operator),
            ms(hop.wait_ms.p50),
            ms(hop.wait_ms.p99),
            ms(hop.wait_ms.max),
            ms(hop.step_ms.p50),
            ms(hop.step_ms.p99),
            ms(hop.step_ms.max),
            ms(hop.since_ms.p50),
            ms(hop.since_ms.max),
        ]);
    }
    table
}

fn within(path: &PathFigures) -> Table {
    let columns = ["operator", "lap", "steps", "p50, ms", "p90", "p99", "worst"];
    let mut table = Table::new("The laps of the steps on this path.", &columns);
    for (hop, lap) in path.hops.iter().flat_map(|hop| hop.laps.iter().map(move |lap| (hop, lap))) {
        let time = &lap.time_ms;
        let names = [Cell::text(&hop.operator), Cell::text(&lap.lap), Cell::number(count(time.count as u64))];
        let times = [time.p50, time.p90, time.p99, time.max].map(ms);
        table.row(names.into_iter().chain(times).collect::<Vec<_>>());
    }
    table
}
