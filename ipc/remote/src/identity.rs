//! What two hosts compare before anything flows.

use serde::{Deserialize, Serialize};

/// What a host runs. Two hosts exchange samples only if all of it is equal.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostIdentity {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Hash of the pipeline's text, settings and files.
    pub hash: String,
    /// Version of the program.
    pub version: String,
    /// Processor architecture and features that results depend on.
    pub cpu: String,
}

impl HostIdentity {
    /// What differs, one sentence per difference; empty if nothing does.
    pub fn differences(&self, peer: &Self) -> Vec<String> {
        let pairs = [
            ("pipeline", &self.pipeline, &peer.pipeline),
            ("hash of the pipeline with its settings and files", &self.hash, &peer.hash),
            ("version of stillpoint", &self.version, &peer.version),
            ("processor", &self.cpu, &peer.cpu),
        ];
        let differing = pairs.into_iter().filter(|(_, here, there)| here != there);
        differing
            .map(|(what, here, there)| format!("the {what} is `{here}` here and `{there}` there"))
            .collect()
    }

    /// Its texts.
    pub(crate) fn texts(&self) -> [&str; 4] {
        [&self.pipeline, &self.hash, &self.version, &self.cpu]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_difference_is_named() {
        let here =
            HostIdentity { pipeline: "a".into(), hash: "1".into(), version: "2".into(), cpu: "3".into() };
        assert!(here.differences(&here).is_empty());
        let there = HostIdentity { hash: "9".into(), cpu: "8".into(), ..here.clone() };
        let reported = here.differences(&there);
        assert_eq!(reported.len(), 2);
        assert!(reported[0].contains("`1` here and `9` there"), "{reported:?}");
        assert!(reported[1].contains("processor"), "{reported:?}");
    }
}
