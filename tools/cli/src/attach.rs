//! Joining a running pipeline, to read its topics or to send a command.

use std::path::Path;

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::run_folder::{RunCard, going_on};
use stillpoint_shm::{Domain, VISITOR};

use crate::exit::Failure;

/// The choice of a run.
#[derive(Args, Clone, Debug, Default)]
pub struct Which {
    /// PID of the run's supervisor, or the name of its pipeline; needed if several runs are active.
    #[arg(long, value_name = "PID|NAME")]
    pub run: Option<String>,
}

/// A run that was joined.
pub struct Attached {
    /// Its graph.
    pub graph: Graph,
    /// Its domain.
    pub domain: Domain,
    /// Root folder of the domain; it is removed when the run ends.
    pub root: std::path::PathBuf,
    /// The session that it records; `None`: none.
    pub session: Option<std::path::PathBuf>,
    /// Process number of its supervisor.
    pub pid: u32,
    /// Its card.
    pub card: RunCard,
}

impl Attached {
    /// The folder of the run.
    pub fn folder(&self) -> std::path::PathBuf {
        self.root.parent().map(Path::to_path_buf).unwrap_or_default()
    }
}

impl Which {
    /// Whether the run with this root folder is still active. A supervisor that was killed leaves the folder behind.
    pub fn is_going_on(&self, root: &Path) -> bool {
        root.parent().is_some_and(stillpoint_pipeline::live::run_folder::is_going_on)
    }

    /// The card of the run that is meant.
    pub fn card(&self) -> Result<RunCard, Failure> {
        let cards = going_on().map_err(Failure::failed)?;
        let fits =
            |c: &RunCard| self.run.as_ref().is_none_or(|r| *r == c.pid.to_string() || *r == c.pipeline);
        let found: Vec<&RunCard> = cards.iter().filter(|c| fits(c)).collect();
        let card = match found.as_slice() {
            [card] => (*card).clone(),
            [] if cards.is_empty() => {
                return Err(Failure::failed("no pipeline is running: start one with `stillpoint run`"));
            }
            [] => {
                return Err(Failure::failed(format!("there is no such run; active runs: {}", list(&cards))));
            }
            _ => {
                return Err(Failure::failed(format!(
                    "several runs are going on: choose one with --run: {}",
                    list(&cards)
                )));
            }
        };
        Ok(card)
    }

    /// Joins the run.
    pub fn attach(&self, registry: &Registry) -> Result<Attached, Failure> {
        let card = self.card()?;
        let graph =
            config::check(&card.source, &card.file, &card.sets, registry, &card.files).map_err(|faults| {
                Failure::wrong(format!("the run's pipeline does not fit this build:\n{faults}"))
            })?;
        let domain = Domain::join(&card.root, &card.prefix, VISITOR).map_err(Failure::failed)?;
        Ok(Attached {
            graph: graph.live(),
            domain,
            root: card.root.clone(),
            session: card.session.clone(),
            pid: card.pid,
            card,
        })
    }
}

fn list(cards: &[RunCard]) -> String {
    cards.iter().map(|c| format!("{} ({})", c.pid, c.pipeline)).collect::<Vec<_>>().join(", ")
}
