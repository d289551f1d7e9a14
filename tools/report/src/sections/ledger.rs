//! The ledger: for every edge, sent = received + accounted loss.

use serde::{Deserialize, Serialize};
use stillpoint_pipeline::ledger::Ledger;
use stillpoint_recorder::LEDGER_ATTACHMENT;

use crate::ReportError;
use crate::numbers::count;
use crate::page::{Block, Cell, Mood, Section, Table};
use crate::source::Source;

/// The ledger of a session, and where it is from.
#[derive(Serialize)]
pub struct Accounts {
    /// Where it is from.
    pub from: From,
    /// One line for each edge.
    pub lines: Vec<LedgerLine>,
    /// Samples that nothing explains, and lines that do not add up.
    pub unexplained: u64,
}

/// Where a ledger is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum From {
    /// The end of the run: it stands in the session.
    Session,
    /// The journals, since the session has no end of its own.
    Journals,
    Nowhere,
}

/// The account of one edge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct LedgerLine {
    topic: String,
    consumer: String,
    sent: u64,
    received: u64,
    passed: u64,
    overwritten: u64,
    #[serde(alias = "homeless")]
    pool_exhausted: u64,
    down: u64,
    left: u64,
    unheard: u64,
    refused: u64,
    lost: u64,
    unexplained: u64,
}

impl LedgerLine {
    /// What did not pass between hosts: nobody there, not valid, lost.
    fn over_the_network(&self) -> [u64; 3] {
        [self.unheard, self.refused, self.lost]
    }

    fn balances(&self) -> bool {
        let in_memory = [self.received, self.overwritten, self.pool_exhausted, self.down, self.left];
        let parts = in_memory.into_iter().chain(self.over_the_network());
        let accounted = parts.fold(0u64, u64::saturating_add);
        self.unexplained == 0 && accounted == self.sent
    }
}

/// The ledger that stands in the session, or the one that its journals make.
pub fn of(source: &Source<'_>) -> Accounts {
    let session = source.recording.session;
    let retained = session.attachments().get(LEDGER_ATTACHMENT);
    let (from, lines) = match retained.and_then(|a| serde_json::from_slice(&a.bytes).ok()) {
        Some(lines) => (From::Session, lines),
        None => from_journals(source).map_or((From::Nowhere, Vec::new()), |lines| (From::Journals, lines)),
    };
    let lines: Vec<LedgerLine> = lines;
    let wrong = lines.iter().filter(|l| !l.balances());
    let unexplained = wrong.map(|l| l.unexplained.max(1)).fold(0, u64::saturating_add);
    Accounts { from, lines, unexplained }
}

fn from_journals(source: &Source<'_>) -> Option<Vec<LedgerLine>> {
    let (graph, _) = source.pipeline.as_ref().ok()?;
    let mut ledger = Ledger::default();
    for (operator, node) in graph.operators.iter().enumerate() {
        let entries = source.recording.session.journals().get(&node.name);
        entries.into_iter().flatten().for_each(|entry| ledger.enter(operator, entry));
    }
    serde_json::from_value(serde_json::to_value(ledger.lines(graph)).ok()?).ok()
}

pub fn section(source: &Source<'_>) -> Result<Section, ReportError> {
    let accounts = of(source);
    let section = Section::new("ledger", "Ledger", &accounts)?;
    let sentence = match accounts.from {
        From::Session => "For every edge, sent = received + overwritten + without memory + down + left.",
        From::Journals => {
            "The session has no end of its own, so this ledger is made of the journals that it recorded: what was sent behind \
             their last entries is not in it."
        }
        From::Nowhere => {
            "The session has no ledger, and this build cannot compute one because it cannot run the pipeline."
        }
    };
    let section = section.with(Block::Text(sentence.into()));
    if accounts.lines.is_empty() {
        return Ok(section);
    }
    let is_remote = accounts.lines.iter().any(|l| l.over_the_network().iter().any(|count| *count > 0));
    let network: &[&str] = if is_remote { &["unheard", "refused", "lost"] } else { &[] };
    let memory = [
        "topic",
        "input",
        "sent",
        "received",
        "of these passed over",
        "overwritten",
        "without memory",
        "down",
        "left",
    ];
    let columns: Vec<&str> = memory.iter().chain(network).copied().chain(["balance"]).collect();
    let mut table = Table::new("", &columns);
    for l in &accounts.lines {
        let n = |v: u64| Cell::number(count(v));
        let balance = match l.balances() {
            true => Cell::State(Mood::Good, "balances".into()),
            false => Cell::State(Mood::Bad, format!("unexplained: {}", count(l.unexplained))),
        };
        let over_the_network = l.over_the_network().into_iter().take(network.len()).map(n);
        let in_memory = [
            Cell::text(&l.topic),
            Cell::text(&l.consumer),
            n(l.sent),
            n(l.received),
            n(l.passed),
            n(l.overwritten),
            n(l.pool_exhausted),
            n(l.down),
            n(l.left),
        ];
        table.row(in_memory.into_iter().chain(over_the_network).chain([balance]));
    }
    Ok(section.with(Block::Table(table)).with(Block::Text(
        "Passed over: taken, but superseded by a newer one or without partners. Overwritten: pushed out of a full buffer. \
         Without memory: never sent. Down: lost while the consumer was down. Left: waiting when it ended. \
         Between hosts: unheard, with no host there to take it; refused, as not valid; lost, or under way at the end."
            .into(),
    )))
}
