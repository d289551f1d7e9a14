//! The operator: a deterministic step machine.

use std::collections::BTreeMap;

use crate::activation::Activation;
use crate::error::{AdoptError, ParamConflict, SetupError, StepError};
use crate::feeder::{Feeder, FeederConflict};
use crate::files::Files;
use crate::kind::Kind;
use crate::listening::Listening;
use crate::outputs::Outputs;
use crate::params::{CheckedParams, Params};
use crate::ros2::Subscription;
use crate::setup::Setup;
use crate::stage::typed;
use crate::wire_form::WireForm;

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
    /// The form of the datagrams that it sends, where they have one: the far end of its link then takes no others. Without
    /// it, the far end takes any datagram.
    const WIRE: Option<WireForm> = None;

    /// Refuses parameters that are each in their range and do not go together. The checker says it with the place, and
    /// [`new`](Operator::new) sees no others.
    fn validate(_params: &Self::Params) -> Result<(), ParamConflict> {
        Ok(())
    }

    /// Refuses parameters that do not go together with the period of the operator's timer, ns.
    fn validate_period(_params: &Self::Params, _every: u64) -> Result<(), ParamConflict> {
        Ok(())
    }

    /// Refuses parameters that do not go together with those of the operator that feeds an input, given by its number.
    fn validate_input(
        _params: &Self::Params,
        _input: usize,
        _from: &Feeder<'_>,
    ) -> Result<(), FeederConflict> {
        Ok(())
    }

    /// Refuses parameters that do not fit the files that they name. The checker says it with the place, before a run and
    /// without making the operator.
    fn check_files(_params: &Self::Params, _files: &dyn Files) -> Result<(), ParamConflict> {
        Ok(())
    }

    /// The files of which a run and its session keep a part, with that part. `params` are those of all operators of this
    /// kind. [`new`](Operator::new) must read the same from a part as from the whole.
    fn cut_files(
        _params: &[&Self::Params],
        _files: &dyn Files,
    ) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
        Ok(BTreeMap::new())
    }

    /// What the operator leaves out of the files that its parameters name, in sentences for people. A run prints them at
    /// its end and keeps them in its session.
    fn remarks(_params: &Self::Params, _files: &dyn Files) -> Vec<String> {
        Vec::new()
    }

    /// Makes the operator. Files that parameters name are read here, through [`Setup::file`], and nowhere later.
    fn new(params: Self::Params, setup: &Setup<'_>) -> Result<Self, SetupError>;

    /// The most elements that a sample of each output can have, in the order of the ports. Shared memory is laid out
    /// by it. Fixed samples have one.
    fn capacities(_params: &Self::Params) -> Vec<usize> {
        vec![1; Self::KIND.outputs.len()]
    }

    /// The topics of ROS 2 whose messages reach the operator in a live run, where it is a source of them. They come as
    /// [`Delivery`](crate::ros2::Delivery) through [`Outside::arrivals`](crate::outside::Outside::arrivals). For each of them,
    /// the operator sends one sample on its last output, by which the ledger counts them.
    fn subscriptions(_params: &Self::Params) -> Vec<Subscription> {
        Vec::new()
    }

    /// Where a source listens for another program in a live run; `None` for all others.
    fn listens(_params: &Self::Params) -> Option<Listening> {
        None
    }

    /// Whether a source finishes by itself ([`Outputs::finish`]) with these parameters, as one that reads files and stops at
    /// the last does. A simulated run of which all sources do needs no length.
    fn finishes(_params: &Self::Params) -> bool {
        false
    }

    /// Takes parameters of which only live ones differ from those that it has: `validate` has taken them. It happens between
    /// two steps and must leave the state as it is where it refuses.
    ///
    /// # Errors
    /// Why they cannot hold now, such as wider tolerances while the beam is on.
    fn adopt(&mut self, _params: Self::Params) -> Result<(), AdoptError> {
        Err(AdoptError(format!("{} takes no changes while it runs", Self::KIND.name)))
    }

    /// Does one activation.
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError>;
}

/// An operator behind its trait.
pub trait ErasedOperator: Send {
    /// Takes changed parameters.
    fn adopt(&mut self, params: &CheckedParams) -> Result<(), AdoptError>;

    /// Does one activation.
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError>;
}

impl<T: Operator> ErasedOperator for T {
    fn adopt(&mut self, params: &CheckedParams) -> Result<(), AdoptError> {
        let params = typed::<T>(&params.value)
            .ok_or_else(|| AdoptError(format!("the parameters are not those of {}", T::KIND.name)))?;
        Operator::adopt(self, params)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        Operator::step(self, activation, outputs)
    }
}
