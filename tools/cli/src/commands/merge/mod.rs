//! `stillpoint merge`: the sessions of several hosts as one session on the time axis of the first.
//!
//! - `part`: the session of one host, and the clocks that it measured
//! - `axis`: the time of each session against that of the first
//! - `joined`: the session that is written

mod axis;
mod joined;
mod part;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;

use crate::exit::{Ended, Exit, Failure, print_json};
use part::MergedPart;

/// Join the sessions of the hosts of one run on the time axis of the first session.
///
/// The offset of the clocks is the one that the bridges measured during the run. It and its uncertainty are printed,
/// and kept in the metadata of the new session. Topics get the name of their host (`bedside.rig.truth`). Journals are
/// left out: each session replays by itself.
#[derive(Args)]
pub struct Merge {
    /// The sessions, one for each host; the first one gives the time axis.
    #[arg(required = true, num_args = 2.., value_name = "SESSION")]
    sessions: Vec<PathBuf>,
    /// The new session: a folder that does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Merge {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let parts: Vec<MergedPart> =
            self.sessions.iter().map(|path| MergedPart::open(path, registry)).collect::<Result<_, _>>()?;
        let clocks = axis::clocks(&parts)?;
        let written = joined::write(&self.out, &parts, &clocks)?;
        if self.json {
            let hosts: Vec<_> = parts
                .iter()
                .zip(&clocks)
                .zip(&written.samples)
                .map(|((part, clock), samples)| {
                    json!({
                        "host": part.host,
                        "session": part.path.display().to_string(),
                        "offset_ns": clock.offset,
                        "uncertainty_ns": clock.uncertainty,
                        "samples": samples,
                    })
                })
                .collect();
            let session = self.out.display().to_string();
            print_json(&json!({ "session": session, "hosts": hosts, "left_out": written.left_out }))?;
            return Ok(Exit::Done);
        }
        for ((part, clock), samples) in parts.iter().zip(&clocks).zip(&written.samples) {
            outln!(
                "{}: {samples} samples, clock {:+.6} s, within {:.6} s",
                part.host,
                clock.offset as f64 * 1e-9,
                clock.uncertainty as f64 * 1e-9
            );
        }
        for topic in &written.left_out {
            errln!("{topic} is left out: this build has no such type of samples, or another layout of it");
        }
        outln!("{}", self.out.display());
        Ok(Exit::Done)
    }
}

/// A fault of the given sessions.
fn wrong(text: String) -> Failure {
    Failure::failed(text)
}
