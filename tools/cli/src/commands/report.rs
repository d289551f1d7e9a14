//! `stillpoint report`

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Map, Value, json};
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;
use stillpoint_report::{Section, html, sections_of};

use crate::exit::{Ended, Exit, Failure};
use crate::private;
use crate::recorded::with_topics;

/// Write a report of a session: tracks against the truth, pictures, rates, latencies, ledger, faults, provenance.
///
/// The report is one HTML file that needs no network. It can hold pictures of a face, so its mode is 0600.
#[derive(Args)]
pub struct Report {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// The file to write. Default: the name of the session with `.html`, next to the session.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print every figure of the report as JSON; the HTML file is then written only with --out.
    #[arg(long)]
    json: bool,
    /// Maximum number of pictures per camera. If the session lacks faces, planes or hulls, they are computed again from
    /// the recorded images of these pictures.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(0..=60))]
    pictures: u16,
}

impl Report {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let session = with_topics(Session::open_any(&self.session), &self.session)?;
        let sections = sections_of(&session, &self.session, registry, usize::from(self.pictures))
            .map_err(Failure::failed)?;
        let name = name(&self.session);
        if self.json {
            let value = to_json(&self.session, &sections);
            outln!("{}", serde_json::to_string(&value).map_err(Failure::failed)?);
        }
        if !self.json || self.out.is_some() {
            let path = self.out.clone().unwrap_or_else(|| sibling(&self.session));
            let about = format!("Report of a session of stillpoint {}", env!("CARGO_PKG_VERSION"));
            let page = html::page(&name, &about, &sections);
            private::create(&path).and_then(|mut file| file.write_all(page.as_bytes())).map_err(|e| {
                Failure::failed(format!("{}: {e}; choose another file with --out", path.display()))
            })?;
            if !self.json {
                outln!("{} ({:.1} MB)", path.display(), page.len() as f64 / 1e6);
            }
        }
        Ok(Exit::Done)
    }
}

fn to_json(session: &Path, sections: &[Section]) -> Value {
    let sections: Map<String, Value> = sections.iter().map(|s| (s.id.to_owned(), s.to_json())).collect();
    json!({ "session": session.display().to_string(), "sections": sections })
}

/// The last part of the session's path.
fn name(session: &Path) -> String {
    let path = std::path::absolute(session).unwrap_or_else(|_| session.to_owned());
    path.file_name().map_or_else(|| "session".to_owned(), |n| n.to_string_lossy().into_owned())
}

fn sibling(session: &Path) -> PathBuf {
    let file = format!("{}.html", name(session).trim_end_matches(".mcap"));
    match std::path::absolute(session).ok().as_deref().and_then(Path::parent) {
        Some(_) => session.parent().map_or_else(|| PathBuf::from(&file), |folder| folder.join(&file)),
        None => PathBuf::from(file),
    }
}
