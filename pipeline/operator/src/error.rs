//! Why an operator cannot be made, why a step failed, and why changed parameters are refused.

/// Why the source of a kind of operator describes no kind.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{reason}")]
pub struct DescribeError {
    /// What is wrong, with the place in the source.
    pub reason: String,
    /// What to do.
    pub help: String,
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

/// Why an operator does not take changed parameters, in a sentence that says what is allowed. It goes on as before.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct AdoptError(pub String);
