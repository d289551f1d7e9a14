//! `stillpoint topics`

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::contracts;
use stillpoint_recorder::{Role, Session};
use stillpoint_samples::{Field, SampleKind};

use super::hz::watched;
use crate::attach::{Attached, Which};
use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, print_json};
use crate::rates::{Rate, Rates, of_run, of_session, senders};
use crate::recorded::with_topics;

/// List the topics of a running pipeline or a session: type, units, rate, size and consumers.
#[derive(Args)]
pub struct Topics {
    /// How long a running pipeline is watched for the rates.
    #[arg(long = "for", value_name = "TIME", default_value = "1s")]
    time: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Read a session instead of a running pipeline.
    #[arg(long, value_name = "SESSION")]
    session: Option<PathBuf>,
    #[command(flatten)]
    which: Which,
}

#[derive(Serialize)]
struct Row {
    topic: String,
    /// Name of the sample type.
    r#type: String,
    frame: Option<String>,
    /// Units of its fields.
    units: Vec<&'static str>,
    /// Samples a second.
    rate_hz: Option<f64>,
    /// Standard deviation of the time from one sending to the next.
    jitter_ms: Option<f64>,
    /// Of a sample: the mean in a session, the most in a run.
    bytes: u64,
    /// Samples of the session, or of the time in which the run was watched.
    samples: u64,
    /// Operators that take it.
    consumers: Vec<String>,
    recorded: bool,
}

impl Topics {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let (of, rows) = match &self.session {
            Some(path) => (of_session(path), of_recorded(&with_topics(Session::open(path), path)?)),
            None => {
                let time = watched(&self.time)?;
                let attached = self.which.attach(registry)?;
                let rates = Rates::of_run(&attached, time, |_| true)?.rates();
                (of_run(&attached), of_graph(&attached, &rates))
            }
        };
        if self.json {
            print_json(&json!({ "of": of, "topics": rows }))?;
            return Ok(Exit::Done);
        }
        let head = [
            (Side::Left, "topic"),
            (Side::Left, "type"),
            (Side::Right, "Hz"),
            (Side::Right, "bytes"),
            (Side::Left, "units"),
            (Side::Left, "consumers"),
        ];
        let mut table = Columns::new(head);
        for row in rows {
            let frame = row.frame.map_or_else(String::new, |frame| format!(" in {frame}"));
            let units: Vec<&str> = row.units.iter().filter(|u| **u != "ns").copied().collect();
            table.row([
                row.topic,
                format!("{}{frame}", row.r#type),
                row.rate_hz.map_or("-".to_owned(), |r| format!("{r:.1}")),
                row.bytes.to_string(),
                units.join(", "),
                if row.consumers.is_empty() { "none".to_owned() } else { row.consumers.join(", ") },
            ]);
        }
        out!("{table}");
        Ok(Exit::Done)
    }
}

fn of_graph(attached: &Attached, rates: &[Rate]) -> Vec<Row> {
    let graph = &attached.graph;
    let mut rows = Vec::new();
    for (operator, node) in graph.operators.iter().enumerate() {
        for (port, (output, of)) in node.outputs.iter().zip(node.stage.kind.outputs).enumerate() {
            let rate = rates.iter().find(|r| r.topic == output.topic);
            let mut consumers: Vec<String> =
                graph.consumers(operator, port).map(|(o, _)| graph.operators[o].name.clone()).collect();
            consumers.dedup();
            rows.push(Row {
                topic: output.topic.clone(),
                r#type: of.sample.name.to_owned(),
                frame: output.frame.clone(),
                units: units(of.sample),
                rate_hz: rate.and_then(|r| r.rate_hz),
                jitter_ms: rate.and_then(|r| Some(r.interval_ms?.jitter)),
                bytes: contracts::output(graph, operator, port).sample_bytes() as u64,
                samples: rate.map_or(0, |r| r.samples),
                consumers,
                recorded: attached.session.is_some() && graph.is_recorded(operator, port),
            });
        }
    }
    rows
}

fn of_recorded(session: &Session) -> Vec<Row> {
    let rates = Rates::of_session(session).rates();
    let senders = senders(session);
    let outputs = session.topics().iter().filter(|t| !matches!(t.role, Role::Journal { .. }));
    let row = |t: &stillpoint_recorder::Topic| {
        let rate = rates.iter().find(|r| r.topic == t.name);
        let takes = senders.iter().filter(|(_, inputs)| inputs.contains(&t.name));
        Row {
            topic: t.name.clone(),
            r#type: t.type_name.split('@').next().unwrap_or_default().to_owned(),
            frame: t.frame.clone(),
            units: t.kind.kind().map(units).unwrap_or_default(),
            rate_hz: rate.and_then(|r| r.rate_hz),
            jitter_ms: rate.and_then(|r| Some(r.interval_ms?.jitter)),
            bytes: t.bytes.checked_div(t.samples).unwrap_or(0),
            samples: t.samples,
            consumers: takes.map(|((operator, _), _)| operator.clone()).collect(),
            recorded: true,
        }
    };
    let mut rows: Vec<Row> = outputs.map(row).collect();
    // Topics that replay makes again are not kept, and their rates are known.
    let takes = |topic: &str| {
        senders.iter().filter(|(_, i)| i.iter().any(|t| t == topic)).map(|((o, _), _)| o.clone()).collect()
    };
    for rate in rates.iter().filter(|r| session.topic_number(&r.topic).is_none()) {
        rows.push(Row {
            topic: rate.topic.clone(),
            r#type: "not recorded".to_owned(),
            frame: None,
            units: Vec::new(),
            rate_hz: rate.rate_hz,
            jitter_ms: rate.interval_ms.map(|i| i.jitter),
            bytes: 0,
            samples: rate.samples,
            consumers: takes(&rate.topic),
            recorded: false,
        });
    }
    rows
}

/// The units of the fields of a kind, each once.
fn units(kind: &SampleKind) -> Vec<&'static str> {
    let mut units = Vec::new();
    for Field { unit, .. } in kind.body.iter().chain(kind.element) {
        for unit in unit.split(", ").filter(|u| !u.is_empty()) {
            if !units.contains(&unit) {
                units.push(unit);
            }
        }
    }
    units
}
