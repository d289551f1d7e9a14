//! The laps of a running pipeline, read without being a part of it.

use stillpoint_pipeline::graph::timing_topic;
use stillpoint_report::trace::{Laps, add_laps};

use crate::attach::Attached;
use crate::exit::Failure;
use crate::tap::Tap;

/// The laps of the operators whose kinds name some. An activation that came between two looks with others may be missed.
pub struct LapTaps {
    taps: Vec<(String, Tap)>,
    /// What was measured so far.
    pub laps: Laps,
}

impl LapTaps {
    /// Opens the topics of all laps.
    ///
    /// # Errors
    /// The run has ended, or takes no further reader.
    pub fn open(attached: &Attached) -> Result<Self, Failure> {
        let measured = attached.graph.operators.iter().filter(|o| !o.stage.laps.is_empty());
        let tap = |name: &String| Ok((name.clone(), Tap::of_topic(attached, &timing_topic(name))?.0));
        Ok(Self { taps: measured.map(|o| tap(&o.name)).collect::<Result<_, Failure>>()?, laps: Laps::new() })
    }

    /// Takes what came since the last look.
    ///
    /// # Errors
    /// A topic cannot be read.
    pub fn look(&mut self) -> Result<(), Failure> {
        for (operator, tap) in &self.taps {
            while let Some(sample) = tap.next()? {
                add_laps(&mut self.laps, operator, sample.pieces());
            }
        }
        Ok(())
    }
}
