//! The description of a topic in a session: its kind, its sender, and whether replay needs it.

use std::collections::BTreeMap;

use stillpoint_samples::SampleKind;

/// Name of the metadata record that describes a topic; there is one per topic.
pub(crate) const TOPIC_RECORD: &str = "stillpoint.topic";

/// What a topic is to replay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Role {
    /// The journal of an operator. Replay needs every entry.
    Journal {
        /// Topic that feeds each input of the operator, by the input's number; empty if there is none.
        inputs: Vec<String>,
        /// Topic of each output of the operator, by the output's number.
        outputs: Vec<String>,
    },
    /// What came from outside: a source, a person, another host. Replay needs every sample.
    Source,
    /// What an operator computed. Replay makes it again.
    Computed,
    /// A measurement of the live executor: how long a step took. Every run has other values, so replay does not compare
    /// them.
    Measured,
}

impl Role {
    /// Whether a sample that was not kept leaves a gap in the session.
    pub fn is_required(&self) -> bool {
        matches!(self, Self::Journal { .. } | Self::Source)
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Journal { .. } => "journal",
            Self::Source => "source",
            Self::Computed => "computed",
            Self::Measured => "measured",
        }
    }
}

/// A topic that is to be recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicInfo {
    /// `operator.port`; `operator.journal` for a journal.
    pub name: String,
    /// The operator that sends it.
    pub operator: String,
    /// What its samples are.
    pub kind: &'static SampleKind,
    /// The frame that its coordinates are in, where they are in one.
    pub frame: Option<String>,
    /// The role of the topic in a replay.
    pub role: Role,
}

impl TopicInfo {
    /// The entries of the topic's metadata record.
    pub(crate) fn entries(&self) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([
            ("topic".to_owned(), self.name.clone()),
            ("operator".to_owned(), self.operator.clone()),
            ("type".to_owned(), self.kind.type_name()),
            ("schema".to_owned(), self.kind.ros_schema()),
            ("role".to_owned(), self.role.name().to_owned()),
        ]);
        if let Some(frame) = &self.frame {
            entries.insert("frame".to_owned(), frame.clone());
        }
        if let Role::Journal { inputs, outputs } = &self.role {
            entries.insert("inputs".to_owned(), lines(inputs));
            entries.insert("outputs".to_owned(), lines(outputs));
        }
        entries
    }
}

/// A topic as a recording describes it, before its type is looked up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Described {
    pub name: String,
    pub operator: String,
    pub type_name: String,
    pub schema: String,
    pub frame: Option<String>,
    pub role: Role,
}

impl Described {
    /// Out of the entries of a topic's metadata record. `None`: they do not name a topic and its type.
    pub fn from_entries(entries: &BTreeMap<String, String>) -> Option<Self> {
        let get = |key: &str| entries.get(key).cloned();
        let ports =
            |key: &str| entries.get(key).map(|t| t.lines().map(str::to_owned).collect()).unwrap_or_default();
        Some(Self {
            name: get("topic")?,
            operator: get("operator").unwrap_or_default(),
            type_name: get("type")?,
            schema: get("schema").unwrap_or_default(),
            frame: get("frame"),
            role: match entries.get("role").map(String::as_str) {
                Some("journal") => Role::Journal { inputs: ports("inputs"), outputs: ports("outputs") },
                Some("source") => Role::Source,
                Some("measured") => Role::Measured,
                _ => Role::Computed,
            },
        })
    }
}

/// One name a line, each line ended, so that an empty name keeps its place.
fn lines(names: &[String]) -> String {
    names.iter().map(|n| format!("{n}\n")).collect()
}
