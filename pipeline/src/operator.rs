//! The operator: a deterministic step machine, and the description of its kind.

use std::any::Any;
use std::sync::Arc;

use stillpoint_samples::SampleKind;

use crate::activation::Activation;
use crate::outputs::Outputs;
use crate::params::{CheckedParams, ParamField, ParamReader, Params};
use crate::setup::Setup;

/// What an operator is to the outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Sees nothing but its activations. Replay runs it again.
    Operator,
    /// Turns the outside into samples. Replay takes its recorded samples.
    Source,
}

/// How an input is consumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Every sample in order, one per activation; the oldest goes when more than this many wait.
    Queue(u32),
    /// The newest sample, held from activation to activation. It causes an activation only where the operator has
    /// neither a timer nor another kind of input.
    Latest,
    /// One sample each from all inputs of the set, their origins within this many ns of each other.
    Sync {
        /// Greatest distance of the origins, ns.
        within: u64,
    },
}

/// Which frame the samples of an output are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameRule {
    /// No frame: the numbers are not coordinates.
    None,
    /// The frame that the operator's `frame:` names; it must be given.
    Key,
    /// The frame that `frame:` names, else the frame of this input.
    KeyOr(&'static str),
    /// The frame of this input.
    SameAs(&'static str),
    /// This frame.
    Named(&'static str),
}

/// An input port of a kind of operator.
#[derive(Clone, Copy, Debug)]
pub struct Input {
    /// Name in the config.
    pub name: &'static str,
    /// What it takes.
    pub sample: &'static SampleKind,
    /// How it is consumed where the config does not say.
    pub policy: Policy,
    /// Whether the config must connect it.
    pub required: bool,
    /// What it is for, in one line.
    pub about: &'static str,
}

/// An output port of a kind of operator.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Name in the config.
    pub name: &'static str,
    /// What it sends.
    pub sample: &'static SampleKind,
    /// Frame of its samples.
    pub frame: FrameRule,
    /// What it is for, in one line.
    pub about: &'static str,
}

/// Whether a kind of operator has a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timer {
    /// It has none; `every:` is refused.
    No,
    /// `every:` may be given.
    Optional,
    /// `every:` must be given.
    Required,
}

/// What an operator's kind is called, takes, sends and is for.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name in the config, `family.kind`.
    pub name: &'static str,
    /// What it does, in one line.
    pub about: &'static str,
    /// Operator or source.
    pub role: Role,
    /// Input ports; their place is their number.
    pub inputs: &'static [Input],
    /// Output ports; their place is their number.
    pub outputs: &'static [Output],
    /// Whether it has a timer.
    pub timer: Timer,
}

/// Why an operator cannot be set up, in a sentence that names what to change.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct SetupError(pub String);

/// Parameters that are each in their range and do not go together.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{reason}")]
pub struct ParamConflict {
    /// The parameters of it: the fault stands at the first that the config gives, one of the command line before others.
    pub params: &'static [&'static str],
    /// What does not fit, with units.
    pub reason: String,
    /// What to write instead.
    pub help: &'static str,
}

impl ParamConflict {
    /// A conflict inside one parameter, of which a set-up would say this.
    pub fn inside(params: &'static [&'static str], reason: SetupError) -> Self {
        Self { params, reason: reason.0, help: "change one of them" }
    }
}

/// Why a step failed, in a sentence. None of the outputs of the activation is sent.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct StepError(pub String);

/// A deterministic step machine.
///
/// What [`step`](Operator::step) sends may depend on the parameters, the seed, the state that earlier activations left,
/// and the activation; on nothing else. No clock, file, environment or global random source is read in it.
pub trait Operator: Sized + Send + 'static {
    /// Parameters as the config gives them.
    type Params: Params;
    /// Name, ports and purpose.
    const KIND: Kind;
    /// Stages of a step whose times are worth knowing, in the order of their work. The live executor measures them and
    /// sends them as `<operator>.timing`; the step says when one has ended with [`Outputs::lap`].
    const LAPS: &'static [&'static str] = &[];

    /// Refuses parameters that are each in their range and do not go together. The checker says it with the place, and
    /// [`new`](Operator::new) sees no others.
    fn validate(_params: &Self::Params) -> Result<(), ParamConflict> {
        Ok(())
    }

    /// Makes the operator. Files that parameters name are read here, through [`Setup::file`], and nowhere later.
    fn new(params: Self::Params, setup: &Setup<'_>) -> Result<Self, SetupError>;

    /// The most elements that a sample of each output can have, in the order of the ports. Shared memory is laid out
    /// by it. Fixed samples have one.
    fn capacities(_params: &Self::Params) -> Vec<usize> {
        vec![1; Self::KIND.outputs.len()]
    }

    /// Does one activation.
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError>;
}

/// An operator behind its trait.
pub trait ErasedOperator: Send {
    /// Does one activation.
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError>;
}

impl<T: Operator> ErasedOperator for T {
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        Operator::step(self, activation, outputs)
    }
}

/// Makes an operator from its checked parameters.
pub type Build = fn(&CheckedParams, &Setup<'_>) -> Result<Box<dyn ErasedOperator>, SetupError>;

/// A kind of operator in a family's list: what checker and executors need, without its type.
#[derive(Clone, Copy)]
pub struct Stage {
    /// Name, ports and purpose.
    pub kind: Kind,
    /// Stages of a step that the live executor measures.
    pub laps: &'static [&'static str],
    /// Parameters with defaults, units and ranges.
    pub fields: &'static [ParamField],
    /// Reads the parameters of a config; faults go into the reader.
    pub read: fn(&mut ParamReader<'_>) -> Option<CheckedParams>,
    /// Refuses parameters that do not go together.
    pub validate: fn(&CheckedParams) -> Result<(), ParamConflict>,
    /// The most elements per sample of each output.
    pub capacities: fn(&CheckedParams) -> Vec<usize>,
    /// Makes the operator.
    pub build: Build,
}

impl Stage {
    /// The entry of `T`.
    pub const fn of<T: Operator>() -> Self {
        const { check_names(&T::KIND, T::LAPS) };
        Self {
            kind: T::KIND,
            laps: T::LAPS,
            fields: <T::Params as Params>::FIELDS,
            read: |reader| {
                let params = <T::Params as Params>::read(reader)?;
                Some(CheckedParams { value: Arc::new(params), resolved: reader.resolved() })
            },
            validate: |checked| typed::<T>(&checked.value).map_or(Ok(()), |params| T::validate(&params)),
            capacities: |checked| typed::<T>(&checked.value).map(|p| T::capacities(&p)).unwrap_or_default(),
            build: |checked, setup| {
                let params = typed::<T>(&checked.value).ok_or_else(|| {
                    SetupError(format!(
                        "the parameters are not those of {}: check the pipeline again",
                        T::KIND.name
                    ))
                })?;
                T::validate(&params).map_err(|conflict| SetupError(conflict.to_string()))?;
                Ok(Box::new(T::new(params, setup)?))
            },
        }
    }
}

/// Port of the topic of laps.
pub const TIMING: &str = "timing";
/// Names of topics that an operator has without saying so.
const IMPLICIT: [&str; 3] = [TIMING, "journal", "inbox"];
/// The longest name of a lap: as a metric it ends in `_s`.
const LONGEST_LAP: usize = 30;

/// Refuses a kind, when it is compiled, whose outputs would share their topic with another, or whose laps have names
/// that do not fit.
const fn check_names(kind: &Kind, laps: &[&str]) {
    let mut output = 0;
    while output < kind.outputs.len() {
        let mut name = 0;
        while name < IMPLICIT.len() {
            assert!(
                !is_same(kind.outputs[output].name, IMPLICIT[name]),
                "timing, journal and inbox are topics that every operator may have: give the output another name"
            );
            name += 1;
        }
        output += 1;
    }
    let mut lap = 0;
    while lap < laps.len() {
        assert!(
            !laps[lap].is_empty() && laps[lap].len() <= LONGEST_LAP,
            "the name of a lap has 1 to 30 bytes"
        );
        lap += 1;
    }
}

const fn is_same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut same = a.len() == b.len();
    let mut at = 0;
    while same && at < a.len() {
        same = a[at] == b[at];
        at += 1;
    }
    same
}

fn typed<T: Operator>(value: &Arc<dyn Any + Send + Sync>) -> Option<T::Params> {
    value.downcast_ref::<T::Params>().cloned()
}

/// All kinds of operators that a build knows, by name.
#[derive(Clone, Default)]
pub struct Registry {
    stages: std::collections::BTreeMap<&'static str, Stage>,
}

impl Registry {
    /// The kinds of these lists. A later entry of the same name replaces an earlier one.
    pub fn new(lists: &[&[Stage]]) -> Self {
        Self { stages: lists.iter().flat_map(|l| l.iter()).map(|s| (s.kind.name, *s)).collect() }
    }

    /// The kind of this name.
    pub fn get(&self, name: &str) -> Option<&Stage> {
        self.stages.get(name)
    }

    /// All kinds, by name.
    pub fn iter(&self) -> impl Iterator<Item = &Stage> {
        self.stages.values()
    }
}
