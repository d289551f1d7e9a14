//! `stillpoint replay`

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_pipeline::graph::{Graph, Record};
use stillpoint_pipeline::replay::{ReplayError, ReplayReport, Selection, replay};
use stillpoint_pipeline::session::{HASHES, IDENTITY, INCLUDED, RUN, VARIABLES, identity};
use stillpoint_pipeline::session_recorder::SessionRecorder;
use stillpoint_pipeline::stdout::StdoutRedirect;
use stillpoint_recorder::{Opening, Session};
use stillpoint_report::facts::layout;
use stillpoint_report::pipeline_of;

use super::what_if::WhatIfArgs;
use crate::compress::Compress;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::recorded::with_topics;
use crate::rerun::{Nobody, add_metadata};

/// Replay a session from its journals and compare every recorded topic byte by byte; or, with `--set`, compute what a
/// change would have done.
///
/// With `--set`, `--with` or `--rerun`, all that the change does not reach is taken from the recording, to the bit. The
/// changed operators and all that is downstream of them run again. The command prints which topics are the same, which
/// differ, since when and by how much.
#[derive(Args)]
pub struct Replay {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// Compare only this operator.
    #[arg(long, value_name = "OPERATOR", conflicts_with = "from")]
    only: Option<String>,
    /// Compare this operator and all operators downstream of it.
    #[arg(long, value_name = "OPERATOR")]
    from: Option<String>,
    /// Write every topic that the replay computes as a session into this folder. With a change, the session has the topics
    /// that the pipeline records.
    #[arg(long, value_name = "FOLDER")]
    record: Option<PathBuf>,
    /// Compression of the written session. The replay can be repeated at any time, so the default favours speed.
    #[arg(long, value_enum, default_value_t = Compress::None, requires = "record")]
    compression: Compress,
    #[command(flatten)]
    what_if: WhatIfArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Gaps that are shown.
const MOST_GAPS: usize = 5;

impl Replay {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let session = with_topics(Session::open(&self.session), &self.session)?;
        self.what_if.check()?;
        if self.what_if.is_asked() {
            self.warn_of_other_machine(&session);
            let (record, compression) = (self.record.as_deref(), self.compression.into());
            return self.what_if.execute(&self.session, &session, registry, record, compression, self.json);
        }
        let (graph, files) = pipeline_of(&session, registry)?;
        self.warn_of_other_layouts(&session);
        self.warn_of_other_machine(&session);
        let selection = match (&self.only, &self.from) {
            (Some(name), _) => Selection::Only(name.clone()),
            (_, Some(name)) => Selection::From(name.clone()),
            _ => Selection::All,
        };
        let graph = Arc::new(graph);
        let aside = StdoutRedirect::to_stderr();
        let begun = std::time::Instant::now();
        let report = match &self.record {
            None => replay(&session, &graph, &files, &selection, &mut Nobody).map_err(failed)?,
            Some(folder) => {
                let all = Graph { record: Record::All, ..(*graph).clone() };
                let opening = opening_of(&session);
                let mut session_recorder =
                    SessionRecorder::create(folder, &all, &opening, self.compression.into())
                        .map_err(Failure::failed)?;
                let report =
                    replay(&session, &graph, &files, &selection, &mut session_recorder).map_err(failed)?;
                session_recorder.finish(None).map_err(Failure::failed)?;
                add_metadata(folder, &Session::open(folder).map_err(Failure::failed)?);
                report
            }
        };
        drop(aside);
        self.say(&report, begun.elapsed().as_secs_f64())
    }

    fn warn_of_other_layouts(&self, session: &Session) {
        for t in session.topics() {
            if let Some(layout) = layout(t) {
                errln!("stillpoint: {} was recorded in {layout}", t.name);
            }
        }
    }

    fn warn_of_other_machine(&self, session: &Session) {
        let here = identity();
        let Some(there) = session.metadata().get(IDENTITY) else { return };
        for (key, what) in [("build", "another build"), ("cpu_features", "a CPU with other features")] {
            if there.get(key) != here.get(key) {
                errln!(
                    "stillpoint: the session was recorded by {what}; results may differ in the last digit"
                );
            }
        }
    }

    fn say(&self, report: &ReplayReport, wall: f64) -> Ended {
        let exit = match report.differences {
            0 if !report.open.is_empty() => Exit::Open,
            0 if report.compared_nothing() => Exit::Nothing,
            0 if report.is_identical() => Exit::Done,
            0 => Exit::Open,
            _ => Exit::Differs,
        };
        if self.json {
            let mut value = serde_json::to_value(report).map_err(Failure::failed)?;
            value["wall_seconds"] = wall.into();
            value["identical_all"] = (report.is_identical() && !report.compared_nothing()).into();
            print_json(&value)?;
            return Ok(exit);
        }
        for (topic, count) in &report.identical {
            outln!("{topic:<24} {count:>9} identical");
        }
        for (topic, count) in &report.recomputed {
            outln!("{topic:<24} {count:>9} recomputed, not in the recording");
        }
        for (topic, count) in &report.measured {
            outln!("{topic:<24} {count:>9} measured when it was recorded, not compared");
        }
        for open in &report.open {
            outln!(
                "{}, incarnation {}, cannot be replayed exactly from activation {} on: {}",
                open.operator,
                open.incarnation,
                open.from_activation,
                open.reason
            );
        }
        for gap in report.gaps.iter().take(MOST_GAPS) {
            outln!("gap in the session: {gap}");
        }
        if report.gaps.len() > MOST_GAPS {
            outln!("and {} more gaps: `stillpoint info` lists them", report.gaps.len() - MOST_GAPS);
        }
        let speed = report.seconds / wall.max(1e-9);
        let missing = match report.missing() {
            0 => String::new(),
            1 => "; 1 sample of a recorded topic is not in the recording".to_owned(),
            n => format!("; {n} samples of recorded topics are not in the recording"),
        };
        let verdict = report.verdict();
        outln!(
            "{verdict}{missing}: {} activations, {} samples compared, {} incarnations exact, {:.1} s of session in {wall:.2} s \
             ({speed:.1}x real time)",
            report.activations,
            report.compared(),
            report.exact_incarnations,
            report.seconds
        );
        let others: String = report.not_compared.iter().map(|name| format!("{name}, ")).collect();
        outln!(
            "not compared: {others}and of the journals the times, causes and inputs, which the replay follows"
        );
        Ok(exit)
    }
}

/// The failure of a replay that cannot begin or continue.
fn failed(error: ReplayError) -> Failure {
    let exit = if matches!(error, ReplayError::Operator(..)) { Exit::Wrong } else { Exit::Failed };
    Failure { exit, ..Failure::failed(error) }
}

/// The opening of the session that a replay writes: the attachments and metadata of the replayed session.
pub fn opening_of(session: &Session) -> Opening {
    let keep = [RUN, IDENTITY, HASHES, VARIABLES, INCLUDED];
    Opening {
        attachments: session
            .attachments()
            .values()
            .filter(|a| a.name != stillpoint_recorder::LEDGER_ATTACHMENT)
            .cloned()
            .collect(),
        metadata: session
            .metadata()
            .iter()
            .filter(|(name, _)| keep.contains(&name.as_str()))
            .map(|(name, entries)| (name.clone(), entries.clone()))
            .collect(),
        frames: session.frames().to_vec(),
        clock: session.clock().first().copied(),
    }
}
