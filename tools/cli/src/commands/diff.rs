//! `stillpoint diff`

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;
use stillpoint_report::compare::{self, Choice};
use stillpoint_report::html;

use crate::exit::{Ended, Exit, Failure, print_json};
use crate::recorded::with_topics;
use crate::{differences, private};

/// Compare two sessions, topic by topic and field by field: what differs first, by how much, and how it goes on.
///
/// Times count from the start of each session. The command ends with 0 where the sessions are the same, and with 3 where
/// they differ.
#[derive(Args)]
pub struct Diff {
    /// The first session: a folder of parts, or one file.
    first: PathBuf,
    /// The second session.
    second: PathBuf,
    /// How samples of the two sessions are paired. `auto` chooses by topic: by time of acquisition where the sessions
    /// share at least half of these times, else by sequence.
    #[arg(long, value_enum, default_value_t)]
    align: Align,
    /// Write a page with both runs in each chart.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The argument that chooses how samples are paired.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Align {
    #[default]
    Auto,
    Sequence,
    Origin,
}

impl From<Align> for Choice {
    fn from(align: Align) -> Self {
        match align {
            Align::Auto => Self::Auto,
            Align::Sequence => Self::Sequence,
            Align::Origin => Self::Origin,
        }
    }
}

impl Diff {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let open = |path: &PathBuf| with_topics(Session::open_any(path), path);
        let (first, second) = (open(&self.first)?, open(&self.second)?);
        let found =
            compare::of_sessions([&first, &second], self.align.into(), registry).map_err(Failure::failed)?;
        let names = [self.first.display().to_string(), self.second.display().to_string()];
        let names = [names[0].as_str(), names[1].as_str()];
        if let Some(path) = &self.page {
            write_page(path, &found, names, &[])?;
        }
        if self.json {
            let mut value = serde_json::to_value(&found).map_err(Failure::failed)?;
            value["identical_all"] = json!(found.is_identical());
            value["sessions"] = json!(names);
            print_json(&value)?;
        } else {
            differences::print(&found, names);
            if found.is_identical() {
                outln!("the sessions are the same, to the bit");
            }
        }
        Ok(if found.is_identical() { Exit::Done } else { Exit::Differs })
    }
}

/// Writes the page of a comparison, with what was changed in the second one. Only its owner may read it, as a session.
pub fn write_page(
    path: &Path,
    found: &compare::Comparison,
    names: [&str; 2],
    changes: &[String],
) -> Result<(), Failure> {
    let sections = compare::sections(found, names).map_err(Failure::failed)?;
    let lead = format!("Comparison of two sessions by stillpoint {}", env!("CARGO_PKG_VERSION"));
    let about = match changes {
        [] => lead,
        changes => format!("{lead}. Changed: {}", changes.join("; ")),
    };
    let page = html::page(&format!("{} and {}", names[0], names[1]), &about, &sections);
    private::create(path)
        .and_then(|mut file| file.write_all(page.as_bytes()))
        .map_err(|e| Failure::failed(format!("{}: {e}; choose another file with --page", path.display())))
}
