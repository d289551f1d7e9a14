//! What feeds an input, for checks of parameters that have to go together with those of another operator.

use serde_json::Value;

/// The operator whose output an input is connected to, as the checker knows it.
#[derive(Clone, Copy, Debug)]
pub struct Feeder<'a> {
    /// Its name in the pipeline.
    pub operator: &'a str,
    /// Its kind.
    pub kind: &'a str,
    /// Period of its timer, ns.
    pub every: Option<u64>,
    /// Its parameters with their defaults, SI units.
    pub params: &'a Value,
}

/// Parameters, or a timer, that do not go together with what feeds an input. The fault stands at the input.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct FeederConflict {
    /// What does not fit.
    pub reason: String,
    /// What to write instead.
    pub help: String,
}

impl<'a> Feeder<'a> {
    /// A parameter, by the names on the way to it.
    pub fn param(&self, path: &[&str]) -> Option<&'a Value> {
        path.iter().try_fold(self.params, |value, name| value.get(name))
    }

    /// A whole number.
    pub fn whole(&self, path: &[&str]) -> Option<u64> {
        self.param(path)?.as_u64()
    }

    /// A choice or a text.
    pub fn text(&self, path: &[&str]) -> Option<&'a str> {
        self.param(path)?.as_str()
    }

    /// Refuses another number of bladders than `own`.
    ///
    /// # Errors
    /// The feeder has a parameter `bladders` with another number.
    pub fn check_bladders(&self, own: u64) -> Result<(), FeederConflict> {
        match self.whole(&["bladders"]) {
            Some(theirs) if theirs != own => Err(FeederConflict {
                reason: format!("{} is for {theirs} bladders, but there are {own} here", self.operator),
                help: format!("write `bladders: {own}` for {}", self.operator),
            }),
            _ => Ok(()),
        }
    }
}
