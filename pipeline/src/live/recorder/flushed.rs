//! The numbers of the samples that are in the file: a recorder that is started again goes on behind them.
//!
//! The note stands in the folder of the run and is replaced after each flush. A recorder that dies in between leaves an
//! older note: its successor then writes again what the publishers kept, and a session that holds a sample twice, with
//! equal bytes, counts it once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use stillpoint_recorder::TopicId;

/// Name of the note in the folder of a run.
const NOTE: &str = "flushed.json";

/// By incarnation: the number behind the last sample.
type Ends = BTreeMap<u32, u64>;

/// By topic: where the samples in the file end.
pub struct Flushed {
    path: PathBuf,
    topics: BTreeMap<TopicId, (String, Ends)>,
    before: BTreeMap<String, Ends>,
}

impl Flushed {
    /// An empty note of the run whose domain has this root folder, behind the note of the part before.
    pub fn new(root: &Path, before: Option<&Self>) -> Self {
        let before = before.map(|b| b.before.clone()).unwrap_or_default();
        Self { path: root.with_file_name(NOTE), topics: BTreeMap::new(), before }
    }

    /// The note that the recorder before this one left. `None`: it left none that can be read.
    pub fn load(root: &Path) -> Option<Self> {
        let path = root.with_file_name(NOTE);
        let before = serde_json::from_slice(&std::fs::read(&path).ok()?).ok()?;
        Some(Self { path, topics: BTreeMap::new(), before })
    }

    /// Where the samples of a topic end in the parts before this one.
    pub fn of(&self, topic: &str) -> Ends {
        self.before.get(topic).cloned().unwrap_or_default()
    }

    /// Adds a topic whose numbers are noted.
    pub fn add(&mut self, topic: TopicId, name: &str) {
        self.topics.insert(topic, (name.to_string(), self.of(name)));
    }

    /// Notes that the samples of an incarnation before number `end` are written, or listed as lost.
    pub fn note(&mut self, topic: TopicId, incarnation: u32, end: u64) {
        if let Some((_, ends)) = self.topics.get_mut(&topic) {
            ends.insert(incarnation, end);
        }
    }

    /// Replaces the note: all that was noted is in the file now. An old note costs a successor time, and no sample.
    pub fn store(&self) {
        let all: BTreeMap<&str, &Ends> =
            self.topics.values().map(|(name, ends)| (name.as_str(), ends)).collect();
        let draft = self.path.with_extension("new");
        let text = serde_json::to_vec(&all).unwrap_or_default();
        let _ = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, &self.path));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use stillpoint_recorder::{Compression, Opening, PartWriter, Role, TopicInfo};
    use stillpoint_samples::{Pose, Sample};

    #[test]
    fn the_next_recorder_reads_what_was_stored_and_keeps_it() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("d");
        assert!(Flushed::load(&root).is_none());
        let mut part = PartWriter::new(Vec::new(), Compression::None, &Opening::default()).unwrap();
        let mut topic = |name: &str| {
            let (name, operator) = (name.to_string(), String::new());
            part.add_topic(TopicInfo { name, operator, kind: Pose::KIND, frame: None, role: Role::Source })
                .unwrap()
        };
        let (a, b, unnoted) = (topic("a"), topic("b"), topic("unnoted"));
        let mut first = Flushed::new(&root, None);
        first.add(a, "a");
        first.add(b, "b");
        first.note(a, 0, 7);
        first.note(a, 1, 3);
        first.note(unnoted, 0, 9);
        first.store();
        first.note(a, 1, 4);
        let second = Flushed::load(&root).unwrap();
        assert_eq!(second.of("a"), BTreeMap::from([(0, 7), (1, 3)]));
        assert_eq!((second.of("b"), second.of("unnoted")), (Ends::new(), Ends::new()));
        let mut third = Flushed::new(&root, Some(&second));
        third.add(a, "a");
        third.note(a, 1, 5);
        third.store();
        assert_eq!(Flushed::load(&root).unwrap().of("a"), BTreeMap::from([(0, 7), (1, 5)]));
    }
}
