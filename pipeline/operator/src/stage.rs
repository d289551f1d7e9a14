//! The list of the kinds of operators that a build knows: what checker and executors need, without the types.

use std::any::Any;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

use stillpoint_samples::{Sample, Setting, SettingAnswer};

use crate::error::{DescribeError, ParamConflict, SetupError};
use crate::feeder::{Feeder, FeederConflict};
use crate::files::Files;
use crate::kind::{FrameRule, Input, Kind, Output, Policy, check_names};
use crate::listening::Listening;
use crate::operator::{ErasedOperator, Operator};
use crate::params::{CheckedParams, ParamField, ParamReader, Params, has_live};
use crate::ros2::Subscription;
use crate::setup::Setup;
use crate::wire_form::WireForm;

/// Makes an operator from its checked parameters.
pub type Build = fn(&CheckedParams, &Setup<'_>) -> Result<Box<dyn ErasedOperator>, SetupError>;

/// Gives the files of which a run keeps a part, with that part.
pub type CutFiles = fn(&[&CheckedParams], &dyn Files) -> Result<BTreeMap<String, Vec<u8>>, SetupError>;

/// Describes a kind that is in no list, by its name in the config and the files of the pipeline: `ops/speed.py:Speed`.
/// `None`: the name is not that of such a kind.
pub type Describe = fn(&str, &dyn Files) -> Option<Result<Stage, DescribeError>>;

/// A kind of operator in a family's list: what checker and executors need, without its type.
#[derive(Clone, Copy)]
pub struct Stage {
    /// Name, ports and purpose.
    pub kind: Kind,
    /// Stages of a step that the live executor measures.
    pub laps: &'static [&'static str],
    /// The form of the datagrams that it sends, where they have one.
    pub wire: Option<WireForm>,
    /// Parameters with defaults, units and ranges.
    pub fields: &'static [ParamField],
    /// What the functions below need of a kind that was described at run time.
    pub described: Option<&'static (dyn Any + Send + Sync)>,
    /// Reads the parameters of a config for this stage; faults go into the reader.
    pub read: fn(&Stage, &mut ParamReader<'_>) -> Option<CheckedParams>,
    /// Refuses parameters that do not go together.
    pub validate: fn(&CheckedParams) -> Result<(), ParamConflict>,
    /// Refuses parameters that do not go together with the period of the timer, ns.
    pub validate_period: fn(&CheckedParams, u64) -> Result<(), ParamConflict>,
    /// Refuses parameters that do not go together with those of the operator that feeds an input.
    pub validate_input: fn(&CheckedParams, usize, &Feeder<'_>) -> Result<(), FeederConflict>,
    /// Refuses parameters that do not fit the files that they name.
    pub check_files: fn(&CheckedParams, &dyn Files) -> Result<(), ParamConflict>,
    /// The files of which a run keeps a part, with that part, by the parameters of all operators of the kind.
    pub cut_files: CutFiles,
    /// What an operator leaves out of the files that its parameters name.
    pub remarks: fn(&CheckedParams, &dyn Files) -> Vec<String>,
    /// The most elements per sample of each output.
    pub capacities: fn(&CheckedParams) -> Vec<usize>,
    /// The topics of ROS 2 that a source takes.
    pub subscriptions: fn(&CheckedParams) -> Vec<Subscription>,
    /// Where a source listens for another program in a live run.
    pub listens: fn(&CheckedParams) -> Option<Listening>,
    /// Whether a source finishes by itself.
    pub finishes: fn(&CheckedParams) -> bool,
    /// Makes the operator.
    pub build: Build,
}

/// Input of changes of live parameters. An executor connects it to the console where the config does not.
pub const SET: Input = Input {
    name: "set",
    sample: Setting::KIND,
    policy: Policy::Queue(16),
    required: false,
    about: "Changes of live parameters (`stillpoint set`). It is connected to the console of the pipeline by itself.",
};

/// Output of the answers to these changes.
pub const SETTINGS: Output = Output {
    name: "settings",
    sample: SettingAnswer::KIND,
    frame: FrameRule::None,
    about: "Whether a change of a live parameter was taken, and from which generation and activation on it holds.",
};

/// The most ports on one side of a kind with live parameters.
const MOST_PORTS: usize = 24;

/// The kind of an operator with the ports for changes behind its own, where it has live parameters.
struct WithSettings<T>(PhantomData<T>);

impl<T: Operator> WithSettings<T> {
    const INPUTS: [Input; MOST_PORTS] = {
        let (mut all, own, mut at) = ([SET; MOST_PORTS], T::KIND.inputs, 0);
        while at < own.len() && at < MOST_PORTS {
            all[at] = own[at];
            at += 1;
        }
        all
    };
    const OUTPUTS: [Output; MOST_PORTS] = {
        let (mut all, own, mut at) = ([SETTINGS; MOST_PORTS], T::KIND.outputs, 0);
        while at < own.len() && at < MOST_PORTS {
            all[at] = own[at];
            at += 1;
        }
        all
    };
    const KIND: Kind = match has_live(<T::Params as Params>::FIELDS) {
        true => Kind {
            inputs: Self::INPUTS.split_at(T::KIND.inputs.len() + 1).0,
            outputs: Self::OUTPUTS.split_at(T::KIND.outputs.len() + 1).0,
            ..T::KIND
        },
        false => T::KIND,
    };
}

impl Stage {
    /// Whether it has live parameters: its last input takes changes, and its last output answers.
    pub fn is_live(&self) -> bool {
        has_live(self.fields)
    }

    /// The input of changes, where it has live parameters.
    pub fn set_input(&self) -> Option<usize> {
        self.is_live().then(|| self.kind.inputs.len() - 1)
    }

    /// The output of answers, where it has live parameters.
    pub fn settings_output(&self) -> Option<usize> {
        self.is_live().then(|| self.kind.outputs.len() - 1)
    }

    /// The entry of `T`.
    pub const fn of<T: Operator>() -> Self {
        const { check_names(&T::KIND, T::LAPS) };
        Self {
            kind: WithSettings::<T>::KIND,
            laps: T::LAPS,
            wire: T::WIRE,
            fields: <T::Params as Params>::FIELDS,
            described: None,
            read: |_, reader| {
                let params = <T::Params as Params>::read(reader)?;
                let given = reader.given().into();
                Some(CheckedParams { value: Arc::new(params), resolved: reader.resolved(), given })
            },
            validate: |checked| typed::<T>(&checked.value).map_or(Ok(()), |params| T::validate(&params)),
            validate_period: |checked, every| {
                typed::<T>(&checked.value).map_or(Ok(()), |params| T::validate_period(&params, every))
            },
            validate_input: |checked, input, from| {
                typed::<T>(&checked.value).map_or(Ok(()), |params| T::validate_input(&params, input, from))
            },
            check_files: |checked, files| {
                typed::<T>(&checked.value).map_or(Ok(()), |params| T::check_files(&params, files))
            },
            cut_files: |checked, files| {
                let params: Vec<T::Params> = checked.iter().filter_map(|c| typed::<T>(&c.value)).collect();
                T::cut_files(&params.iter().collect::<Vec<_>>(), files)
            },
            remarks: |checked, files| {
                typed::<T>(&checked.value).map(|p| T::remarks(&p, files)).unwrap_or_default()
            },
            capacities: |checked| typed::<T>(&checked.value).map(|p| T::capacities(&p)).unwrap_or_default(),
            subscriptions: |checked| {
                typed::<T>(&checked.value).map(|p| T::subscriptions(&p)).unwrap_or_default()
            },
            listens: |checked| typed::<T>(&checked.value).and_then(|p| T::listens(&p)),
            finishes: |checked| typed::<T>(&checked.value).is_some_and(|p| T::finishes(&p)),
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

pub(crate) fn typed<T: Operator>(value: &Arc<dyn Any + Send + Sync>) -> Option<T::Params> {
    value.downcast_ref::<T::Params>().cloned()
}

/// All kinds of operators that a build knows, by name, and how it describes others.
#[derive(Clone, Default)]
pub struct Registry {
    stages: BTreeMap<&'static str, Stage>,
    describe: Vec<Describe>,
    describe_recorded: Vec<Describe>,
}

impl Registry {
    /// The kinds of these lists. A later entry of the same name replaces an earlier one.
    pub fn new(lists: &[&[Stage]]) -> Self {
        let stages = lists.iter().flat_map(|l| l.iter()).map(|s| (s.kind.name, *s)).collect();
        Self { stages, ..Self::default() }
    }

    /// The same registry, which describes further kinds that are in no list; those of pipelines that sessions keep by `recorded`,
    /// because the source of such a kind is code of someone else.
    #[must_use]
    pub fn describing(mut self, describe: Describe, recorded: Describe) -> Self {
        self.describe.push(describe);
        self.describe_recorded.push(recorded);
        self
    }

    /// The same registry for a pipeline that a session keeps.
    #[must_use]
    pub fn for_recorded(&self) -> Self {
        Self { describe: self.describe_recorded.clone(), ..self.clone() }
    }

    /// The kind of this name, of a list or described from these files. `None`: there is none.
    ///
    /// # Errors
    /// The files describe no kind.
    pub fn find(&self, name: &str, files: &dyn Files) -> Option<Result<Stage, DescribeError>> {
        let listed = self.stages.get(name).copied().map(Ok);
        listed.or_else(|| self.describe.iter().find_map(|describe| describe(name, files)))
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
