//! Writes messages, little-endian.

use crate::{ENCAPSULATION, NANOSECONDS};

/// Appends a CDR message.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut Vec<u8>,
    start: usize,
}

impl<'a> Writer<'a> {
    /// Starts a message at the end of `out`.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        out.extend_from_slice(&ENCAPSULATION);
        let start = out.len();
        Self { out, start }
    }

    fn align(&mut self, to: usize) {
        let over = (self.out.len() - self.start) % to;
        if over > 0 {
            self.out.resize(self.out.len() + to - over, 0);
        }
    }

    /// A whole number of 8 bits.
    pub fn u8(&mut self, v: u8) {
        self.out.push(v);
    }

    /// A whole number of 32 bits.
    pub fn u32(&mut self, v: u32) {
        self.align(4);
        self.out.extend_from_slice(&v.to_le_bytes());
    }

    /// A whole number of 64 bits.
    pub fn u64(&mut self, v: u64) {
        self.align(8);
        self.out.extend_from_slice(&v.to_le_bytes());
    }

    /// Floats of 64 bits, without a length before them.
    pub fn f64s(&mut self, values: &[f64]) {
        for v in values {
            self.u64(v.to_bits());
        }
    }

    /// A text and its closing zero. A zero inside it would end it for other readers: it ends it here too.
    pub fn text(&mut self, text: &str) {
        let text = text.split('\0').next().unwrap_or_default();
        self.u32(text.len() as u32 + 1);
        self.out.extend_from_slice(text.as_bytes());
        self.out.push(0);
    }

    /// Bytes that are laid out already, at a multiple of `align`.
    pub fn raw(&mut self, bytes: &[u8], align: usize) {
        self.align(align);
        self.out.extend_from_slice(bytes);
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.out.extend_from_slice(bytes);
    }

    /// A `std_msgs/Header`. The stamp is ns and must pass [`is_ros_time`](crate::is_ros_time).
    pub fn header(&mut self, stamp: u64, frame: &str) {
        self.u32((stamp / NANOSECONDS) as u32);
        self.u32((stamp % NANOSECONDS) as u32);
        self.text(frame);
    }
}
