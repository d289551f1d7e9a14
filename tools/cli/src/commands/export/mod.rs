//! `stillpoint export`: topics of a session for other tools.
//!
//! - `table`: topics as tables, whatever the file
//! - `csv`, `parquet`: a table as a file; Parquet needs the feature `parquet`
//! - `mcap`: a smaller recording
//! - `sample`: one sample as a file of its own

mod csv;
mod mcap;
#[cfg(feature = "parquet")]
mod parquet;
mod sample;
mod table;

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;
use stillpoint_pipeline::config::quantity::nanoseconds;
use stillpoint_recorder::{Role, Session};

use crate::compress::Compress;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::recorded::with_topics;
use crate::tap::no_topic;

/// Write topics of a session as tables (CSV, Parquet) or as a smaller MCAP recording, or one sample as PLY, PCD or PNG.
///
/// Each table has a line for each sample, or for each element of a sample that has many. Numbers are as the sample has
/// them: SI units, codes as numbers. The first line of CSV names the columns with their units. Columns of Parquet have the
/// types of the fields, and units and words of codes as metadata.
#[derive(Args)]
pub struct Export {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// The topics. Default: all topics whose samples have one set of numbers; for MCAP, all topics.
    #[arg(value_name = "TOPIC")]
    topics: Vec<String>,
    /// The values of a table, such as `pose.z`. Default: all of them. Needs one topic.
    #[arg(long, value_name = "PATH")]
    field: Vec<String>,
    /// Only samples from this session time on, such as `2s`.
    #[arg(long, value_name = "TIME")]
    after: Option<String>,
    /// Only samples before this session time.
    #[arg(long, value_name = "TIME")]
    until: Option<String>,
    /// What is written.
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// The number (sequence) of the one sample that is written as PLY, PCD or PNG.
    #[arg(long, value_name = "N")]
    sample: Option<u64>,
    /// Compression of the MCAP recording.
    #[arg(long, value_enum, default_value_t)]
    compression: Compress,
    /// A folder that is not there yet.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A table of comma-separated values for each topic.
    #[default]
    Csv,
    /// A table of Apache Parquet for each topic, compressed by Zstandard. Needs a build with the feature `parquet`.
    Parquet,
    /// A recording.
    Mcap,
    /// One cloud, binary; points without a measurement are left out.
    Ply,
    /// One cloud, binary.
    Pcd,
    /// One image: depth in counts of 16 bits, grey in 8 bits.
    Png,
}

/// Which samples are exported.
struct Chosen {
    /// By topic of the session.
    topics: Vec<bool>,
    /// Session time, ns: from, and before.
    from: u64,
    before: u64,
}

impl Chosen {
    fn is_in_time(&self, stamp: u64) -> bool {
        (self.from..self.before).contains(&stamp)
    }
}

/// A file that was written.
struct Written {
    file: PathBuf,
    topic: String,
    /// Samples, and lines of a table.
    samples: u64,
    lines: u64,
}

impl Export {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let session = with_topics(Session::open_any(&self.session), &self.session)?;
        let is_table = matches!(self.format, Format::Csv | Format::Parquet);
        if !is_table && !self.field.is_empty() {
            return Err(Failure::wrong("--field chooses columns of tables: remove it, or --format"));
        }
        let is_single = matches!(self.format, Format::Ply | Format::Pcd | Format::Png);
        if is_single != self.sample.is_some() || is_single && self.topics.len() != 1 {
            return Err(Failure::wrong(
                "--format ply, pcd and png write one sample: name one topic and the number of the sample (--sample 12)",
            ));
        }
        if !self.field.is_empty() && self.topics.len() != 1 {
            return Err(Failure::wrong(
                "--field needs exactly one topic: name the topic that has these values",
            ));
        }
        let chosen = self.chosen(&session)?;
        stillpoint_pipeline::session_recorder::create_folder(&self.out)
            .map_err(|e| Failure::failed(e.to_string().replace("--record", "--out")))?;
        let written = match self.format {
            Format::Csv => {
                table::write(&session, &chosen, &self.field, &self.out, "csv", |file, _, columns| {
                    Ok(Box::new(csv::Csv::create(file, columns)?))
                })
            }
            Format::Parquet => parquet(&session, &chosen, &self.field, &self.out),
            Format::Mcap => mcap::write(&session, &chosen, &self.out, self.compression.into()),
            Format::Ply | Format::Pcd | Format::Png => {
                let topic = chosen.topics.iter().position(|chosen| *chosen).unwrap_or_default();
                let sequence = self.sample.unwrap_or_default();
                sample::write(&session, topic, sequence, self.format, &self.out).map(|written| vec![written])
            }
        };
        // What is half written is no export.
        let written = written.inspect_err(|_| drop(std::fs::remove_dir_all(&self.out)))?;
        if self.json {
            let file = |w: &Written| json!({ "file": w.file, "topic": w.topic, "samples": w.samples, "lines": w.lines });
            print_json(&json!({ "files": written.iter().map(file).collect::<Vec<_>>() }))?;
        } else {
            for w in &written {
                outln!("{}: {}, samples: {}, lines: {}", w.file.display(), w.topic, w.samples, w.lines);
            }
        }
        Ok(Exit::Done)
    }

    fn chosen(&self, session: &Session) -> Result<Chosen, Failure> {
        let names = || session.topics().iter().map(|t| t.name.as_str());
        let mut topics = vec![false; session.topics().len()];
        for name in &self.topics {
            let number = session.topic_number(name).ok_or_else(|| no_topic(name, names()))?;
            if session.topics()[number].kind.kind().is_none() {
                let path = self.session.display();
                return Err(Failure::failed(format!(
                    "{path}: `{name}` has messages of another program, which `export` cannot read"
                )));
            }
            topics[number] = true;
        }
        if self.topics.is_empty() {
            for (chosen, topic) in topics.iter_mut().zip(session.topics()) {
                let is_table = topic.kind.kind().is_some_and(table::is_default)
                    && !matches!(topic.role, Role::Journal { .. } | Role::Measured);
                *chosen = topic.kind.kind().is_some() && (self.format == Format::Mcap || is_table);
            }
        }
        let started = session.journals().values().filter_map(|j| j.first()).map(|e| e.header.stamp).min();
        let started = started.or_else(|| session.clock().first().map(|c| c.logical_ns)).unwrap_or(0);
        let time = |name: &str, text: &Option<String>| match text {
            None => Ok(None),
            Some(text) => nanoseconds(text)
                .map(|ns| Some(started.saturating_add(ns)))
                .map_err(|e| Failure::wrong(format!("--{name} {text}: {}; {}", e.message, e.help))),
        };
        let from = time("after", &self.after)?.unwrap_or(0);
        let before = time("until", &self.until)?.unwrap_or(u64::MAX);
        if from >= before {
            return Err(Failure::wrong("--after is not before --until: no sample is in between"));
        }
        Ok(Chosen { topics, from, before })
    }
}

/// Writes tables of Parquet, which not every build can.
#[cfg(feature = "parquet")]
fn parquet(
    session: &Session,
    chosen: &Chosen,
    fields: &[String],
    out: &Path,
) -> Result<Vec<Written>, Failure> {
    table::write(session, chosen, fields, out, "parquet", |file, topic, columns| {
        Ok(Box::new(parquet::Parquet::create(file, topic, columns)?))
    })
}

#[cfg(not(feature = "parquet"))]
fn parquet(_: &Session, _: &Chosen, _: &[String], _: &Path) -> Result<Vec<Written>, Failure> {
    Err(Failure::wrong(
        "--format parquet: this program was built without Parquet: build it with \
         `cargo build --release --features stillpoint/parquet`, or write --format csv",
    ))
}
