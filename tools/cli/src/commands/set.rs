//! `stillpoint set`

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_operator::params::changed;
use stillpoint_pipeline::config::near::nearest;
use stillpoint_pipeline::console::{KIND_NAME, SETTING};
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Sample, Setting, SettingAnswerElement, SettingElement};
use zerocopy::IntoBytes;

use super::send::{pass, sender};
use crate::answer::LOOK;
use crate::attach::{Attached, Which};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::settings::Values;

/// Time within which an operator has to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Time in which earlier answers of operators arrive.
const JOINING: Duration = Duration::from_millis(200);

/// Change a live parameter of a running pipeline, or list them. The value is checked as in the pipeline's file, becomes a
/// sample that is recorded and replayed, and holds from an activation on. The command prints that activation, or why the
/// operator refuses the value; a refusal exits with 1.
#[derive(Args)]
pub struct Set {
    /// Operator and parameter, such as `law.proportional`. Without it, all live parameters with their values and where each
    /// came from.
    parameter: Option<String>,
    /// The value as a pipeline's file gives it, such as "3 1/s".
    #[arg(allow_negative_numbers = true, requires = "parameter")]
    value: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: Which,
}

impl Set {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let attached = self.which.attach(registry)?;
        let mut answers = Values::open(&attached)?;
        // Operators hand on the answers that they keep at their next step.
        let begun = Instant::now();
        while begun.elapsed() < JOINING {
            answers.look()?;
            std::thread::sleep(LOOK);
        }
        match (&self.parameter, &self.value) {
            (Some(path), Some(value)) => self.change(&attached, &mut answers, path, value),
            (only, _) => self.list(&attached.graph, &answers, only.as_deref()),
        }
    }

    fn list(&self, graph: &Graph, answers: &Values, only: Option<&str>) -> Ended {
        if let Some(path) = only {
            operator_of(graph, path)?;
        }
        let is_asked = |parameter: &str| {
            only.is_none_or(|only| parameter == only || parameter.starts_with(&format!("{only}.")))
        };
        let all = graph.operators.iter().enumerate().flat_map(|(number, node)| answers.rows(number, node));
        let rows: Vec<_> = all.filter(|row| row.live && is_asked(&row.parameter)).collect();
        if self.json {
            print_json(&rows)?;
        } else if rows.is_empty() {
            outln!("no live parameter; `stillpoint operators KIND` shows what can be set");
        } else {
            rows.iter().for_each(|row| outln!("{}", row.text()));
        }
        Ok(Exit::Done)
    }

    fn change(&self, attached: &Attached, answers: &mut Values, path: &str, value: &str) -> Ended {
        let graph = &attached.graph;
        let (operator, parameter) = operator_of(graph, path)?;
        let node = &graph.operators[operator];
        // What can be seen from here is refused here; the operator checks the rest against what it does.
        changed(&node.stage, &answers.params(operator, node), parameter, value)
            .map_err(|e| Failure::wrong(format!("{path}: {e}")))?;
        let edge = node.stage.set_input().and_then(|input| node.inputs.get(input)?.edge).filter(|edge| {
            let console = &graph.operators[edge.operator];
            console.stage.kind.name == KIND_NAME && edge.output == SETTING
        });
        let console = edge.map(|edge| edge.operator).ok_or_else(|| {
            Failure::wrong(format!(
                "{}: no console on its host sends changes to it: add `console: {{ use: console, every: 20 ms }}`",
                node.name
            ))
        })?;
        let change = SettingElement::new(path, value, &sender()).ok_or_else(|| {
            Failure::wrong(format!("{path}: the value has {} bytes (allowed: up to 160)", value.len()))
        })?;
        let inbox = contracts::setting_inbox(graph, console);
        let sent = pass(attached, (console, SETTING), &inbox, Setting::KIND, change.as_bytes())?;
        let is_answer = |answer: &&SettingAnswerElement| {
            answer.setting == sent.sequence && answer.console_incarnation == sent.incarnation
        };
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            answers.look()?;
            if let Some(answer) = answers.of(operator).iter().find(is_answer) {
                return self.print(path, value, answer);
            }
            std::thread::sleep(LOOK);
        }
        Err(Failure::failed(format!(
            "{} has not answered within {} s, but may still take the value: `stillpoint set {path}` shows it",
            node.name,
            PATIENCE.as_secs()
        )))
    }

    fn print(&self, path: &str, value: &str, answer: &SettingAnswerElement) -> Ended {
        let refusal = answer.refusal();
        if self.json {
            print_json(&json!({
                "parameter": path,
                "value": value,
                "taken": refusal.is_none(),
                "generation": answer.generation,
                "from_activation": answer.from,
                "setting": answer.setting,
                "refusal": refusal,
            }))?;
        } else {
            match refusal {
                None => outln!(
                    "{path} is {value} in generation {} from activation {} on",
                    answer.generation,
                    answer.from
                ),
                Some(why) => outln!("{path} refused: {why}; the value before holds"),
            }
        }
        Ok(if refusal.is_none() { Exit::Done } else { Exit::Failed })
    }
}

/// The operator that a path begins with, and the rest of the path.
fn operator_of<'p>(graph: &Graph, path: &'p str) -> Result<(usize, &'p str), Failure> {
    let (name, rest) = path.split_once('.').unwrap_or((path, ""));
    graph.operator(name).map(|operator| (operator, rest)).ok_or_else(|| {
        let names = graph.operators.iter().map(|o| o.name.as_str());
        let near = nearest(name, names).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
        Failure::wrong(format!("there is no operator `{name}`{near}"))
    })
}
