//! What a session says about itself: losses, the clock, how it ended.

use std::collections::BTreeMap;

use stillpoint_cdr::{CdrError, Reader, Writer};

/// Channel of the losses.
pub(crate) const LOST_CHANNEL: &str = "/stillpoint/lost";
/// Channel of the clock's relation to realtime.
pub(crate) const CLOCK_CHANNEL: &str = "/stillpoint/clock";
/// Channel of the static frames.
pub(crate) const FRAMES_CHANNEL: &str = "/tf_static";
/// Name of the metadata record that ends a session.
pub(crate) const END_RECORD: &str = "stillpoint.end";
/// Name of the metadata record of a mended file.
pub(crate) const RECOVERED_RECORD: &str = "stillpoint.recovered";
/// Entry of that record: how many places of the file were damaged.
pub(crate) const DAMAGED_PLACES: &str = "damaged_places";
/// Name of the attachment that holds the ledger.
pub const LEDGER_ATTACHMENT: &str = "ledger.json";

/// Samples that the recorder could not keep.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Lost {
    /// Topic that they were on.
    pub topic: String,
    /// Incarnation of their producer.
    pub incarnation: u32,
    /// Number of the first.
    pub first: u64,
    /// Number of them.
    pub count: u64,
}

/// Logical time against realtime at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSample {
    /// The session's time, ns since the epoch.
    pub logical_ns: u64,
    /// The machine's realtime clock, ns since the epoch.
    pub realtime_ns: u64,
}

/// What ends a session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Closing {
    /// The ledger as JSON; kept as the attachment `ledger.json`.
    pub ledger: Option<Vec<u8>>,
    /// Why the session is not complete, as the recorder and the supervisor know it beyond the losses noted.
    pub gaps: Vec<String>,
    /// What else is to be said of the end, by name.
    pub facts: BTreeMap<String, String>,
    /// Realtime of the end, ns since the epoch.
    pub realtime_ns: u64,
}

impl Lost {
    pub(crate) fn encode(&self, out: &mut Vec<u8>) {
        let mut w = Writer::new(out);
        w.u64(self.first);
        w.u64(self.count);
        w.u32(self.incarnation);
        w.text(&self.topic);
    }

    pub(crate) fn decode(data: &[u8]) -> Result<Self, CdrError> {
        let mut r = Reader::new(data)?;
        let (first, count, incarnation) = (r.u64()?, r.u64()?, r.u32()?);
        Ok(Self { topic: r.text()?.to_owned(), incarnation, first, count })
    }
}

impl ClockSample {
    pub(crate) fn encode(&self, out: &mut Vec<u8>) {
        let mut w = Writer::new(out);
        w.u64(self.logical_ns);
        w.u64(self.realtime_ns);
    }

    pub(crate) fn decode(data: &[u8]) -> Result<Self, CdrError> {
        let mut r = Reader::new(data)?;
        Ok(Self { logical_ns: r.u64()?, realtime_ns: r.u64()? })
    }
}

impl Closing {
    /// The entries of the end record.
    pub(crate) fn entries(&self, lost: u64) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([
            ("lost_samples".to_owned(), lost.to_string()),
            ("realtime_ns".to_owned(), self.realtime_ns.to_string()),
        ]);
        for (i, gap) in self.gaps.iter().enumerate() {
            entries.insert(format!("gap.{i:06}"), gap.clone());
        }
        for (name, value) in &self.facts {
            entries.insert(format!("fact.{name}"), value.clone());
        }
        entries
    }
}
