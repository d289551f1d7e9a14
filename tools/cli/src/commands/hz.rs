//! `stillpoint hz`

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::quantity;
use stillpoint_recorder::Session;

use crate::attach::Which;
use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::rates::{Rate, Rates, of_run, of_session};
use crate::recorded::with_topics;
use crate::tap::no_topic;

/// Measure the rates of topics and their jitter, from the journals: of a running pipeline for a time, or of a whole session.
#[derive(Args)]
pub struct Hz {
    /// The topics, `operator.port`; without one, all.
    topics: Vec<String>,
    /// How long a running pipeline is watched.
    #[arg(long = "for", value_name = "TIME", default_value = "2s")]
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

impl Hz {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let (of, rates) = match &self.session {
            Some(path) => {
                let session = with_topics(Session::open(path), path)?;
                let rates = Rates::of_session(&session).rates();
                self.check(rates.iter().map(|r| r.topic.as_str()))?;
                (of_session(path), rates)
            }
            None => {
                let time = watched(&self.time)?;
                let attached = self.which.attach(registry)?;
                let operators = &attached.graph.operators;
                self.check(operators.iter().flat_map(|o| o.outputs.iter().map(|p| p.topic.as_str())))?;
                let asked = |name: &str| {
                    self.topics.is_empty() || self.topics.iter().any(|t| t.split('.').next() == Some(name))
                };
                let rates = Rates::of_run(&attached, time, asked)?;
                (of_run(&attached), rates.rates())
            }
        };
        let rates: Vec<Rate> =
            rates.into_iter().filter(|r| self.topics.is_empty() || self.topics.contains(&r.topic)).collect();
        if self.json {
            print_json(&json!({ "of": of, "topics": rates }))?;
            return Ok(Exit::Done);
        }
        let right = ["samples", "Hz", "jitter ms", "min ms", "p50 ms", "p99 ms", "max ms"];
        let head = std::iter::once((Side::Left, "topic")).chain(right.map(|name| (Side::Right, name)));
        let mut table = Columns::new(head);
        for rate in &rates {
            let number =
                |x: Option<f64>, digits: usize| x.map_or("-".to_owned(), |x| format!("{x:.digits$}"));
            let of =
                |pick: fn(&crate::rates::Interval) -> f64| number(rate.interval_ms.as_ref().map(pick), 2);
            let cells = [
                rate.topic.clone(),
                rate.samples.to_string(),
                number(rate.rate_hz, 2),
                of(|i| i.jitter),
                of(|i| i.min),
                of(|i| i.p50),
                of(|i| i.p99),
                of(|i| i.max),
            ];
            table.row(cells);
        }
        out!("{table}");
        Ok(Exit::Done)
    }

    /// Refuses a topic that is not there.
    fn check<'a>(&self, all: impl Iterator<Item = &'a str> + Clone) -> Result<(), Failure> {
        match self.topics.iter().find(|topic| !all.clone().any(|known| known == topic.as_str())) {
            Some(topic) => Err(no_topic(topic, all)),
            None => Ok(()),
        }
    }
}

/// How long a run is watched.
pub fn watched(text: &str) -> Result<Duration, Failure> {
    let time = quantity::nanoseconds(text)
        .map_err(|e| Failure::wrong(format!("--for {text}: {}; {}", e.message, e.help)))?;
    Ok(Duration::from_nanos(time))
}
