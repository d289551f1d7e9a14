//! Parameters: one typed struct per operator, from which parsing, defaults, ranges, schema and reference come.

use std::any::Any;
use std::sync::Arc;

/// Parameters of an operator. Derive it.
pub trait Params: Sized + Clone + Send + Sync + 'static {
    /// The fields, in the order of the struct.
    const FIELDS: &'static [ParamField];
    /// Reads them from a config. Faults go into the reader; `None` where there was one.
    fn read(reader: &mut ParamReader<'_>) -> Option<Self>;
}

/// One parameter, for schema and reference.
#[derive(Clone, Copy, Debug)]
pub struct ParamField {
    /// Name in the config.
    pub name: &'static str,
}

/// Reads parameters out of a config.
pub struct ParamReader<'a> {
    resolved: &'a serde_json::Value,
}

impl ParamReader<'_> {
    /// The parameters as read, defaults filled in, in SI units.
    pub fn resolved(&self) -> serde_json::Value {
        self.resolved.clone()
    }
}

/// Parameters that were checked.
#[derive(Clone)]
pub struct CheckedParams {
    /// The typed struct.
    pub value: Arc<dyn Any + Send + Sync>,
    /// The same as text: defaults filled in, SI units.
    pub resolved: serde_json::Value,
}

impl Params for () {
    const FIELDS: &'static [ParamField] = &[];
    fn read(_: &mut ParamReader<'_>) -> Option<Self> {
        Some(())
    }
}
