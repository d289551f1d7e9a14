//! `stillpoint graph`

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::{self, Machine};
use stillpoint_report::graph::{Drawing, dot, mermaid, svg};
use stillpoint_report::pipeline_of;
use stillpoint_report::trace::{Journals, as_run};

use super::hz::watched;
use crate::exit::{Ended, Exit, Failure};
use crate::journals::JournalTaps;
use crate::pipeline_file::PipelineFile;
use crate::private;
use crate::subject::{Of, Subject};

/// Draw a pipeline: processes and hosts, operators, topics, loops; with rates, latencies and losses of a run or a session.
#[derive(Args)]
pub struct Graph {
    /// A pipeline file, a running pipeline (PID or name), or a session. Without it, the default pipeline is drawn.
    #[arg(value_name = "FILE|RUN|SESSION")]
    of: Option<String>,
    /// The language of the drawing.
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// The file to write. Without it, the drawing is printed.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How long a running pipeline is watched for its rates and latencies.
    #[arg(long = "for", value_name = "TIME", default_value = "2s")]
    time: String,
    /// Print JSON, in place of a drawing.
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A picture that a browser shows.
    #[default]
    Svg,
    /// The language of Graphviz.
    Dot,
    /// The diagrams of Markdown pages.
    Mermaid,
}

impl Graph {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let (of, drawing) = match self.file() {
            Some(file) => {
                let pipeline = PipelineFile { file, ..PipelineFile::default() };
                match pipeline.check(registry, &Machine::any()) {
                    Ok(checked) => {
                        let name = checked.source.file.display().to_string();
                        (
                            json!({ "file": name, "pipeline": checked.graph.name }),
                            Drawing::of_graph(&checked.graph),
                        )
                    }
                    Err(refused) => return refused.end(self.json),
                }
            }
            None => self.measured(registry)?,
        };
        let text = if self.json {
            let value = json!({ "of": of, "operators": drawing.operators, "edges": drawing.edges });
            format!("{}\n", serde_json::to_string_pretty(&value).map_err(Failure::failed)?)
        } else {
            match self.format {
                Format::Svg => format!("{}\n", svg(&drawing)),
                Format::Dot => dot(&drawing),
                Format::Mermaid => mermaid(&drawing),
            }
        };
        match &self.out {
            None => out!("{text}"),
            Some(path) => {
                private::create(path).and_then(|mut file| file.write_all(text.as_bytes())).map_err(|e| {
                    Failure::failed(format!("{}: {e}; choose another file with --out", path.display()))
                })?;
                let (operators, edges) = (drawing.operators.len(), drawing.edges.len());
                outln!("{}: {operators} operators, {edges} edges", path.display());
            }
        }
        Ok(Exit::Done)
    }

    /// The pipeline file that is meant: `Some(None)` is the default one; none: a run or a session is meant.
    fn file(&self) -> Option<Option<PathBuf>> {
        let Some(name) = &self.of else { return Some(None) };
        let path = Path::new(name);
        let is_yaml = path.extension().is_some_and(|e| e == "yaml" || e == "yml");
        is_yaml.then(|| Some(path.to_owned()))
    }

    /// What is drawn of a run or a session, with what was measured.
    fn measured(&self, registry: &Registry) -> Result<(Value, Drawing), Failure> {
        let subject = Of::named(self.of.clone()).open(registry)?;
        let drawing = match &subject {
            Subject::Session(_, session) => {
                let graph = pipeline_of(session, registry).ok().map(|(graph, _)| graph);
                let ran = graph.as_ref().map(|graph| as_run(graph, session));
                Drawing::of(&Journals::of_session(session, ran.as_ref()), graph.as_ref())
            }
            Subject::Run(attached) => {
                let mut entries = vec![Vec::new(); attached.graph.operators.len()];
                let taps = JournalTaps::open(attached, |_| true)?;
                let time = watched(&self.time)?;
                taps.watch(attached, time, &mut |operator, entry| entries[operator].push(entry))?;
                // The edges of links are cut in a run: the pipeline as it was checked has them.
                let card = &attached.card;
                let whole = config::check(&card.source, &card.file, &card.sets, registry, &card.files).ok();
                Drawing::of(&Journals::of_run(&attached.graph, &entries), whole.as_ref())
            }
        };
        Ok((subject.of(), drawing))
    }
}
