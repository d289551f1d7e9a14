//! The live parameters of an operator: a change, its check, and its answer. What an operator took holds over its restarts:
//! a new incarnation begins with the changes of the one before, and its first entry says with how many.

use serde::{Deserialize, Serialize};
use stillpoint_samples::{Header, SettingAnswerElement, SettingElement, filled};

use crate::graph::{Edge, Graph, OperatorNode};
use crate::operator::{AdoptError, ErasedOperator, Stage};
use crate::params::{self, CheckedParams};

/// From the sending of a change to the activation that takes it, ns: no operator takes it at the time at which it is sent.
const DELAY: u64 = 1;

/// A change that an operator took.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TakenChange {
    /// The parameter, such as `proportional`.
    pub parameter: String,
    /// The value as a config would write it.
    pub value: String,
}

impl TakenChange {
    /// The change of an answer; `None` where it was refused.
    pub fn of(answer: &SettingAnswerElement) -> Option<Self> {
        let (_, parameter) = answer.path().split_once('.')?;
        let taken = || Self { parameter: parameter.to_owned(), value: answer.value().to_owned() };
        answer.refusal().is_none().then(taken)
    }
}

/// An operator with the parameters that changes leave, oldest first.
///
/// # Errors
/// A change does not fit the operator: it is one of another build.
pub fn with_changes(node: &OperatorNode, changes: &[TakenChange]) -> Result<OperatorNode, params::SetError> {
    let mut node = node.clone();
    for change in changes {
        node.params = params::changed(&node.stage, &node.params, &change.parameter, &change.value)?;
    }
    Ok(node)
}

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
    /// All changes that were taken, those of earlier incarnations first.
    changes: Vec<TakenChange>,
}

impl Settings {
    /// The parameters of an operator that has taken `changes`; `None`: none of them is live.
    pub fn of(node: &OperatorNode, changes: &[TakenChange]) -> Option<Self> {
        let output = node.stage.settings_output()?;
        Some(Self {
            operator: node.name.clone(),
            stage: node.stage,
            every: node.every,
            output,
            params: node.params.clone(),
            changes: changes.to_vec(),
        })
    }

    /// All changes that were taken, those of earlier incarnations first.
    pub fn changes(&self) -> &[TakenChange] {
        &self.changes
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
            self.changes.push(TakenChange { parameter: path.to_owned(), value: change.value().to_owned() });
        }
        let answer = SettingAnswerElement {
            setting: header.sequence,
            generation: self.changes.len() as u64,
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
