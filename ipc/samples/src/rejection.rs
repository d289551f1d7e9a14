//! Why a frame gave no result.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Why a frame gave no result: sent in place of it, so that a frame is never passed over in silence.
pub struct Rejection;

/// The fields of a [`Rejection`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct RejectionElement {
    /// What was found.
    pub found: f64,
    /// What was needed.
    pub needed: f64,
    /// Number of the reason, from 1; the operator's page lists them.
    pub code: u32,
    /// Zero.
    pub reserved: u32,
    /// The reason in ASCII, filled with zeros.
    pub reason: [u8; 96],
}

impl RejectionElement {
    /// A rejection whose reason is cut at 96 bytes.
    pub fn new(code: u32, reason: &str, found: f64, needed: f64) -> Self {
        let mut bytes = [0; 96];
        let n = reason.len().min(bytes.len());
        bytes[..n].copy_from_slice(&reason.as_bytes()[..n]);
        Self { found, needed, code, reserved: 0, reason: bytes }
    }

    /// The reason as text; empty where it is not UTF-8.
    pub fn reason(&self) -> &str {
        let end = self.reason.iter().position(|b| *b == 0).unwrap_or(self.reason.len());
        std::str::from_utf8(&self.reason[..end]).unwrap_or("")
    }
}

impl Sample for Rejection {
    type Body = ();
    type Element = RejectionElement;
    const NAME: &'static str = "Rejection";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Why a frame gave no result.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
