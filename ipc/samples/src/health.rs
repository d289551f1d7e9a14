//! Health of the sensors behind an estimate.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Which sensors stand behind an estimate, and why the others do not. One element per sensor.
pub struct Health;

/// The health of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct SensorHealth {
    /// Age of its newest sample; NaN where there is none.
    #[unit("s")]
    pub age: f64,
    /// How long the reason has held.
    #[unit("s")]
    pub since: f64,
    /// Distance from the other sensor, squared and over its variance, of the worst channel; NaN where there is none.
    pub distance: f64,
    /// Samples of it that were used.
    pub used: u64,
    /// Samples of it that were left out.
    pub left_out: u64,
    /// Its input, in ASCII, filled with zeros.
    pub name: [u8; 16],
    /// `used`, or why it is left out, in ASCII, filled with zeros.
    pub reason: [u8; 16],
}

impl SensorHealth {
    /// The name as text; empty where it is not UTF-8.
    pub fn name(&self) -> &str {
        text(&self.name)
    }

    /// The reason as text; empty where it is not UTF-8.
    pub fn reason(&self) -> &str {
        text(&self.reason)
    }

    /// Whether the sensor takes part in the estimate.
    pub fn is_used(&self) -> bool {
        self.reason() == "used"
    }

    /// Text as a field holds it, cut at 16 bytes.
    pub fn field(text: &str) -> [u8; 16] {
        let mut bytes = [0; 16];
        let n = text.len().min(bytes.len());
        bytes[..n].copy_from_slice(&text.as_bytes()[..n]);
        bytes
    }
}

fn text(bytes: &[u8; 16]) -> &str {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    std::str::from_utf8(&bytes[..end]).unwrap_or("")
}

impl Sample for Health {
    type Body = ();
    type Element = SensorHealth;
    const NAME: &'static str = "Health";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Which sensors support an estimate, and why others do not.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
