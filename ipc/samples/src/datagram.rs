//! Bytes as they leave for another machine, or came from one.

use crate::{Sample, SampleKind, Shape};

/// One datagram: its payload, without addresses.
pub struct Datagram;

impl Sample for Datagram {
    type Body = ();
    type Element = u8;
    const NAME: &'static str = "Datagram";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "The bytes of a datagram.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
