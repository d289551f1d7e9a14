//! Whether the samples of a recorded topic are a kind of this build, and where not, which fields differ.

use std::sync::Arc;

use stillpoint_samples::{SampleKind, by_name};

use crate::form::{Decoded, Envelope, Fault, Form, Shared};
use crate::mapping::{Mapping, is_field};

/// What the samples of a recorded topic are to this build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TopicKind {
    /// A kind of this build.
    Known(&'static SampleKind),
    /// A kind of this build had another layout when the session was recorded, out of which this build's samples are made.
    Mapped {
        /// The kind as this build has it.
        ours: &'static SampleKind,
        /// What goes where.
        mapping: Arc<Mapping>,
    },
    /// A kind of this build had another layout when the session was recorded.
    Changed {
        /// The kind as this build has it.
        ours: &'static SampleKind,
        /// Names of the fields that differ.
        difference: String,
    },
    /// No kind of this build: to be shown by its schema.
    Opaque,
}

impl TopicKind {
    /// Looks up a recorded type (`Pose@0123456789abcdef`) with its schema text.
    pub(crate) fn of(type_name: &str, schema: &str) -> Self {
        let name = type_name.split('@').next().unwrap_or_default();
        match by_name(name) {
            Some(kind) if kind.type_name() == type_name => Self::Known(kind),
            Some(ours) => match Mapping::new(schema, ours) {
                Some(mapping) => Self::Mapped { ours, mapping: Arc::new(mapping) },
                None => Self::Changed { ours, difference: difference(schema, &ours.ros_schema()) },
            },
            None => Self::Opaque,
        }
    }

    /// The kind that its samples are in this build; `None` where it has none to give.
    pub fn kind(&self) -> Option<&'static SampleKind> {
        match self {
            Self::Known(kind) | Self::Mapped { ours: kind, .. } => Some(kind),
            Self::Changed { .. } | Self::Opaque => None,
        }
    }

    /// The sample behind a message; `None` where this build has no kind for it.
    pub(crate) fn decode<'m>(
        &self,
        form: Form,
        shared: &Shared,
        envelope: Envelope,
        data: &'m [u8],
    ) -> Result<Option<Decoded<'m>>, Fault> {
        let Some(kind) = self.kind() else { return Ok(None) };
        if form != Form::Own && !Form::of(kind).contains(&form) {
            return Err(Fault::Form { kind: kind.name, form: form.name() });
        }
        match self {
            Self::Mapped { mapping, .. } => mapping.decode(kind, data),
            _ => form.decode(kind, shared, envelope, data),
        }
        .map(Some)
    }
}

/// The fields of one schema text that the other has not, in a sentence.
fn difference(recorded: &str, ours: &str) -> String {
    let fields = |text: &str| -> Vec<String> {
        let is_field = |l: &&str| is_field(l) && !l.starts_with("MSG:");
        text.lines().map(str::trim).filter(is_field).map(|l| l.replace("  # ", " in ")).collect()
    };
    let (recorded, ours) = (fields(recorded), fields(ours));
    let only = |a: &[String], b: &[String]| -> Vec<String> {
        a.iter().filter(|f| !b.contains(f)).map(|f| format!("`{f}`")).collect()
    };
    let (there, here) = (only(&recorded, &ours), only(&ours, &recorded));
    match (there.is_empty(), here.is_empty()) {
        (true, true) if recorded.is_empty() => "the recording does not describe its fields".to_owned(),
        (true, true) => "the fields have another order".to_owned(),
        (false, true) => format!("only the recording has {}", there.join(", ")),
        (true, false) => format!("only this build has {}", here.join(", ")),
        (false, false) => {
            format!("the recording has {} where this build has {}", there.join(", "), here.join(", "))
        }
    }
}
