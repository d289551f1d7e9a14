//! Parameters: one typed struct per operator, from which parsing, defaults, ranges, schema and reference come.
//!
//! ```
//! use stillpoint_operator::{Choice, Params};
//!
//! #[derive(Clone, Params)]
//! struct FaceParams {
//!     /// Edge of a voxel.
//!     #[param(unit = "m", default = "4 mm", min = "0.5 mm", max = "50 mm")]
//!     leaf: f64,
//!     /// Hypotheses that are tried for the plane.
//!     #[param(default = 500, min = 1, max = 100000)]
//!     iterations: u32,
//!     /// Wait before the first frame.
//!     #[param(unit = "ns", default = "0 s")]
//!     wait: u64,
//!     /// Where the sensor stands.
//!     #[param(unit = "m")]
//!     at: [f64; 3],
//!     /// What the head does.
//!     #[param(default = "nods")]
//!     motion: Motion,
//!     /// The model, a path from the pipeline's file.
//!     #[param(file)]
//!     model: Option<String>,
//! }
//!
//! #[derive(Clone, Copy, Choice)]
//! enum Motion {
//!     Still,
//!     Nods,
//! }
//! ```
//!
//! Fields are `f64`, `f32`, `u32`, `u64`, `i64`, `usize`, `bool`, `String`, a [`Choice`](derive@Choice), another
//! [`Params`] struct, `[T; N]`, `Vec<T>` or `Option<T>` of these. The doc comment is the description. A field without a
//! default that is no `Option` must be given. A float with a unit is SI; a whole number with a unit (`ns`, `px`) is an
//! exact count of that unit.
//!
//! - `value`: the types that a parameter can have
//! - `reader`: reading them, with every fault
//! - `live`: those that change while an operator runs
//! - `verify`: whether a kind declares them rightly

mod live;
mod reader;
mod value;
mod verify;

use std::any::Any;
use std::sync::Arc;

use crate::config::tree::Entry;
#[doc(hidden)]
pub use crate::config::tree::Node;
pub use live::{Origin, SetError, changed, find, has_live, live_paths, origin};
pub use reader::ParamReader;
#[doc(hidden)]
pub use serde_json as json;
pub use stillpoint_params_derive::{Choice, Params};
pub use value::{ParamType, ParamValue, Presence};
pub use verify::verify;

/// Parameters of an operator. Derive it.
pub trait Params: Sized + Clone + Send + Sync + 'static {
    /// The fields, in the order of the struct.
    const FIELDS: &'static [ParamField];
    /// Reads them from a config. Faults go into the reader; `None` where there was one.
    fn read(reader: &mut ParamReader<'_>) -> Option<Self>;
}

/// What a text parameter names outside the config.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// No file.
    Nothing,
    /// A file, by its path from the pipeline's file.
    File,
    /// Files, by a path relative to the pipeline file: one file, the files whose names fit a last part with `*`, or the
    /// files of a folder that fit this pattern.
    Files(&'static str),
}

/// One parameter, for reading, schema and reference.
#[derive(Clone, Copy, Debug)]
pub struct ParamField {
    /// Name in the config.
    pub name: &'static str,
    /// Its purpose, from the doc comment.
    pub about: &'static str,
    /// Its type.
    pub ty: ParamType,
    /// Whether it must be given where it has no default.
    pub presence: Presence,
    /// Its unit: SI for floats, the unit that is counted for whole numbers; empty for plain numbers.
    pub unit: &'static str,
    /// Its default as a config would write it.
    pub default: Option<&'static str>,
    /// Its least value as a config would write it.
    pub min: Option<&'static str>,
    /// A value that it must exceed, as a config would write it.
    pub above: Option<&'static str>,
    /// Its greatest value as a config would write it.
    pub max: Option<&'static str>,
    /// The texts that it may be; empty where any will do.
    pub choices: &'static [&'static str],
    /// What its text names.
    pub names: Names,
    /// Whether it, or each part of it, changes while the operator runs.
    pub is_live: bool,
}

impl ParamField {
    /// A field with only its name and type. The derive fills in the rest.
    pub const fn new(name: &'static str, ty: ParamType) -> Self {
        Self {
            name,
            about: "",
            ty,
            presence: Presence::Required,
            unit: "",
            default: None,
            min: None,
            above: None,
            max: None,
            choices: &[],
            names: Names::Nothing,
            is_live: false,
        }
    }

    /// Whether a config must give it.
    pub fn is_required(&self) -> bool {
        self.default.is_none()
            && match (self.presence, self.ty) {
                (Presence::Required, _) => true,
                (Presence::Group, ParamType::Group(fields)) => fields.iter().any(Self::is_required),
                _ => false,
            }
    }

    /// The allowed texts: its own choices, or those of its type.
    pub fn choices(&self) -> &'static [&'static str] {
        match self.ty {
            ParamType::Choice(names) => names,
            _ => self.choices,
        }
    }

    /// Its range as text, if it has one.
    pub fn range(&self) -> Option<String> {
        match (self.min, self.above, self.max) {
            (None, None, None) => None,
            (Some(min), _, Some(max)) => Some(format!("from {min} to {max}")),
            (None, Some(above), Some(max)) => Some(format!("above {above}, up to {max}")),
            (Some(min), _, None) => Some(format!("at least {min}")),
            (None, Some(above), None) => Some(format!("above {above}")),
            (None, None, Some(max)) => Some(format!("at most {max}")),
        }
    }
}

/// Parameters that were checked.
#[derive(Clone)]
pub struct CheckedParams {
    /// The typed struct.
    pub value: Arc<dyn Any + Send + Sync>,
    /// The same as text: defaults filled in, SI units.
    pub resolved: serde_json::Value,
    /// As the config gives them.
    pub given: Arc<[Entry]>,
}

impl Params for () {
    const FIELDS: &'static [ParamField] = &[];
    fn read(reader: &mut ParamReader<'_>) -> Option<Self> {
        reader.open(Self::FIELDS);
        reader.keep(serde_json::Value::Object(serde_json::Map::new()));
        Some(())
    }
}
