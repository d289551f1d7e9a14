//! The live parameters of one incarnation of an operator: a change, its check, and its answer.

use stillpoint_samples::{Header, SettingAnswerElement, SettingElement, filled};

use crate::graph::{Edge, Graph, OperatorNode};
use crate::operator::{AdoptError, ErasedOperator, Stage};
use crate::params::{self, CheckedParams};

/// From the sending of a change to the activation that takes it, ns: no operator takes it at the time at which it is sent.
const DELAY: u64 = 1;

/// Why a change is not taken.
#[derive(Debug, thiserror::Error)]
enum RefusedChange {
    /// The value is none of the parameter.
    #[error(transparent)]
    Value(#[from] params::SetError),
    /// The operator does not step as often as the value needs.
    #[error("{0}")]
    Period(String),
    /// The operator refuses it.
    #[error(transparent)]
    Operator(#[from] AdoptError),
}

/// The parameters of an operator, some of which are live.
pub struct Settings {
    operator: String,
    stage: Stage,
    every: Option<u64>,
    output: usize,
    params: CheckedParams,
    generation: u64,
}

impl Settings {
    /// The parameters of an operator; `None`: none of them is live.
    pub fn of(node: &OperatorNode) -> Option<Self> {
        let output = node.stage.settings_output()?;
        Some(Self {
            operator: node.name.clone(),
            stage: node.stage,
            every: node.every,
            output,
            params: node.params.clone(),
            generation: 0,
        })
    }

    /// Takes a change, with the header of its sample. `from` is the number of the next activation. Gives the answer and its
    /// output; `None`: the change is for another operator.
    pub fn take(
        &mut self,
        header: &Header,
        change: &SettingElement,
        from: u64,
        operator: &mut dyn ErasedOperator,
    ) -> Option<(usize, SettingAnswerElement)> {
        let (name, path) = change.path().split_once('.')?;
        if name != self.operator {
            return None;
        }
        let taken = self.adopt(path, change.value(), operator);
        if taken.is_ok() {
            self.generation += 1;
        }
        let answer = SettingAnswerElement {
            setting: header.sequence,
            generation: self.generation,
            from,
            console_incarnation: header.incarnation,
            taken: u32::from(taken.is_ok()),
            path: change.path,
            value: change.value,
            reason: filled(&taken.err().map(|refused| refused.to_string()).unwrap_or_default()),
        };
        Some((self.output, answer))
    }

    fn adopt(
        &mut self,
        path: &str,
        value: &str,
        operator: &mut dyn ErasedOperator,
    ) -> Result<(), RefusedChange> {
        let params = params::changed(&self.stage, &self.params, path, value)?;
        if let Some(every) = self.every {
            (self.stage.validate_period)(&params, every)
                .map_err(|conflict| RefusedChange::Period(conflict.reason))?;
        }
        operator.adopt(&params)?;
        self.params = params;
        Ok(())
    }
}

/// Connects each operator with live parameters to the first console of its host, where the config does not.
pub fn connect(graph: &mut Graph) {
    let host = |operator: usize| &graph.processes[graph.operators[operator].process].host;
    let consoles: Vec<usize> = (0..graph.operators.len())
        .filter(|o| graph.operators[*o].stage.kind.name == crate::console::KIND_NAME)
        .collect();
    let mut edges = Vec::new();
    for (number, node) in graph.operators.iter().enumerate() {
        let Some(input) = node.stage.set_input().filter(|input| node.inputs[*input].edge.is_none()) else {
            continue;
        };
        if let Some(console) = consoles.iter().find(|console| host(**console) == host(number)) {
            let edge = Edge { operator: *console, output: crate::console::SETTING, delay: DELAY };
            edges.push((number, input, edge));
        }
    }
    for (number, input, edge) in edges {
        graph.operators[number].inputs[input].edge = Some(edge);
    }
}
