//! Diagnostics: named numbers that an operator says about its work.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Named numbers about one activation.
pub struct Diagnostics;

/// One named number.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Metric {
    /// The number.
    pub value: f64,
    /// Its name in ASCII, filled with zeros; a unit stands at the end (`plane_offset_m`).
    pub name: [u8; 32],
}

impl Metric {
    /// A metric of this name, which is cut at 32 bytes.
    pub fn new(name: &str, value: f64) -> Self {
        let mut bytes = [0; 32];
        let n = name.len().min(bytes.len());
        bytes[..n].copy_from_slice(&name.as_bytes()[..n]);
        Self { value, name: bytes }
    }

    /// The name as text; empty where it is not UTF-8.
    pub fn name(&self) -> &str {
        let end = self.name.iter().position(|b| *b == 0).unwrap_or(self.name.len());
        std::str::from_utf8(&self.name[..end]).unwrap_or("")
    }
}

impl Sample for Diagnostics {
    type Body = ();
    type Element = Metric;
    const NAME: &'static str = "Diagnostics";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Named numbers that an operator says about one activation.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
