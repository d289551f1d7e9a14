//! The contracts of the pipeline against the times of the session.

use serde::Serialize;

use crate::ReportError;
use crate::contracts::{self, ContractFigures};
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Mood, Section, Table};
use crate::source::Source;
use crate::trace::{Blame, Journals, as_run};

#[derive(Serialize)]
struct ContractsFigures {
    contracts: Vec<ContractFigures>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let session = from.recording.session;
    let judged = from.pipeline.as_ref().ok().map(|(graph, _)| {
        let ran = as_run(graph, session);
        contracts::of(&ran, &Journals::of_session(session, Some(&ran)))
    });
    let figures = ContractsFigures { contracts: judged.unwrap_or_default() };
    let mut section = Section::new("contracts", "Contracts", &figures)?;
    if figures.contracts.is_empty() {
        return Ok(section.nothing("The pipeline has no bounds of time, or this build does not know it."));
    }
    let columns = ["contract", "judged", "broken", "kept", "needed", "worst, ms", "to blame"];
    let mut table = Table::new("", &columns);
    for c in &figures.contracts {
        let mood = if c.is_broken { Mood::Bad } else { Mood::Good };
        table.row([
            Cell::text(&c.contract),
            Cell::number(count(c.judged)),
            Cell::number(count(c.broken)),
            Cell::State(mood, percent(c.retained)),
            Cell::number(percent(c.needed)),
            Cell::number(fixed(c.worst_ms, 1)),
            Cell::text(c.blame.iter().map(Blame::text).collect::<Vec<_>>().join(", ")),
        ]);
    }
    section.blocks.push(Block::Table(table));
    Ok(section)
}
