//! `stillpoint restart`

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::near::nearest;
use stillpoint_pipeline::live::{REFUSED, contracts, log};
use stillpoint_samples::{Cause, HEADER_SIZE, Header, SettingElement};
use stillpoint_shm::Topic;
use zerocopy::IntoBytes;

use super::send::sender;
use crate::attach::{Attached, Which};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::journals::{JournalTaps, LOOK};

/// Time within which the operator has to begin again: a step may be under way.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time that the first activation may take after that; an operator without a timer waits for samples.
const ACTIVATION: Duration = Duration::from_secs(2);

/// Restart one operator of a running pipeline. It begins a new incarnation with the parameters that it has now, changed ones
/// included, and without its state: a filter begins without an estimate, valves are disarmed. The command prints the
/// incarnation and when it was first activated. A replay does the same.
#[derive(Args)]
pub struct Restart {
    /// The operator.
    operator: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: Which,
}

/// An incarnation that began. Times are session time, ns.
struct Began {
    incarnation: u32,
    at: u64,
    first_activation: Option<u64>,
}

impl Restart {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let attached = self.which.attach(registry)?;
        let graph = &attached.graph;
        if graph.operator(&self.operator).is_none() {
            let near = nearest(&self.operator, graph.operators.iter().map(|o| o.name.as_str()));
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            return Err(Failure::wrong(format!("there is no operator `{}`{near}", self.operator)));
        }
        let journal = JournalTaps::open(&attached, |name| name == self.operator)?;
        let lines_before = log::read(&attached.folder()).unwrap_or_default().len();
        let inbox = contracts::restart_inbox(graph);
        let topic = Topic::open(&attached.domain, &inbox).map_err(Failure::failed)?;
        let publisher = topic.publisher().map_err(Failure::failed)?;
        publisher.connect().map_err(Failure::failed)?;
        let request = SettingElement::new(&self.operator, "", &sender())
            .ok_or_else(|| Failure::wrong(format!("{}: the name is too long", self.operator)))?;
        let loan = publisher.loan(1).map_err(Failure::failed)?;
        let mut loan = loan.ok_or_else(|| Failure::failed("too many requests wait: try again"))?;
        let (meta, payload) = loan.parts_mut();
        meta[..HEADER_SIZE].copy_from_slice(Header { count: 1, ..Header::default() }.as_bytes());
        payload.copy_from_slice(request.as_bytes());
        publisher.send(loan).map_err(Failure::failed)?;
        // The request lives in this process until the supervisor has it.
        self.print(&self.wait(&attached, &journal, lines_before)?)
    }

    /// Waits for the new incarnation and its first activation, or for the reason why there is none.
    fn wait(
        &self,
        attached: &Attached,
        journal: &JournalTaps,
        lines_before: usize,
    ) -> Result<Began, Failure> {
        let (begun, mut began) = (Instant::now(), None::<(Began, Instant)>);
        loop {
            journal.look(&mut |_, entry| match (&mut began, entry.cause()) {
                (_, Some(Cause::Start)) => {
                    let (incarnation, at) = (entry.header.incarnation, entry.header.stamp);
                    began = Some((Began { incarnation, at, first_activation: None }, Instant::now()));
                }
                (Some((began, _)), Some(cause)) if cause != Cause::Set && cause != Cause::End => {
                    began.first_activation.get_or_insert(entry.header.stamp);
                }
                _ => {}
            })?;
            began = match began {
                Some((began, at)) if began.first_activation.is_some() || at.elapsed() > ACTIVATION => {
                    return Ok(began);
                }
                other => other,
            };
            if began.is_none() {
                let lines = log::read(&attached.folder()).unwrap_or_default();
                let refused = lines.iter().skip(lines_before).filter(|line| line.operator == self.operator);
                if let Some(why) = refused.filter_map(|line| line.message.strip_prefix(REFUSED)).next() {
                    return Err(Failure::failed(format!("{} was not restarted: {why}", self.operator)));
                }
                if begun.elapsed() > PATIENCE {
                    return Err(Failure::failed(format!(
                        "{} has not begun again within {} s, but may still do so: `stillpoint log --operator {}` shows it",
                        self.operator,
                        PATIENCE.as_secs(),
                        self.operator
                    )));
                }
            }
            std::thread::sleep(LOOK);
        }
    }

    fn print(&self, began: &Began) -> Ended {
        let Began { incarnation, at, first_activation } = began;
        if self.json {
            print_json(&json!({
                "operator": self.operator,
                "incarnation": incarnation,
                "began_ns": at,
                "first_activation_ns": first_activation,
            }))?;
        } else {
            let first = first_activation.map_or_else(
                || format!("not activated within {} s", ACTIVATION.as_secs()),
                |first| {
                    format!(
                        "first activated {:.1} ms after its start",
                        first.saturating_sub(*at) as f64 * 1e-6
                    )
                },
            );
            outln!("{} was restarted: incarnation {incarnation}, {first}", self.operator);
        }
        Ok(Exit::Done)
    }
}
