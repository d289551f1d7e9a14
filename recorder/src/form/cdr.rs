//! Numbers and texts at their CDR places: little-endian, each at a multiple of its size from behind the 4-byte header.

use super::Fault;

/// XCDR1, little-endian.
pub(crate) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

const NANOSECONDS: u64 = 1_000_000_000;

/// Whether a stamp in ns has a place in ROS time, whose seconds are 31 bits.
pub(crate) fn is_ros_time(stamp: u64) -> bool {
    stamp / NANOSECONDS <= i32::MAX as u64
}

/// Appends a CDR message.
pub(crate) struct Writer<'a> {
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

    pub fn u8(&mut self, v: u8) {
        self.out.push(v);
    }

    pub fn u32(&mut self, v: u32) {
        self.align(4);
        self.out.extend_from_slice(&v.to_le_bytes());
    }

    pub fn u64(&mut self, v: u64) {
        self.align(8);
        self.out.extend_from_slice(&v.to_le_bytes());
    }

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

    /// A `std_msgs/Header`. The stamp is ns and must pass [`is_ros_time`].
    pub fn header(&mut self, stamp: u64, frame: &str) {
        self.u32((stamp / NANOSECONDS) as u32);
        self.u32((stamp % NANOSECONDS) as u32);
        self.text(frame);
    }
}

/// Reads a CDR message.
pub(crate) struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Starts behind the 4-byte header.
    pub fn new(data: &'a [u8]) -> Result<Self, Fault> {
        match data.split_first_chunk() {
            Some((&ENCAPSULATION, body)) => Ok(Self { body, at: 0 }),
            Some((other, _)) => {
                Err(format!("it starts with {other:02x?} where {ENCAPSULATION:02x?} marks CDR"))
            }
            None => Err(format!("{} bytes are no CDR message", data.len())),
        }
    }

    /// `n` bytes at a multiple of `align`.
    pub fn raw(&mut self, n: usize, align: usize) -> Result<&'a [u8], Fault> {
        let start = self.at.next_multiple_of(align);
        let end = start.checked_add(n).filter(|end| *end <= self.body.len());
        let end =
            end.ok_or_else(|| format!("it ends at {} bytes, before its field at {start}", self.body.len()))?;
        self.at = end;
        Ok(&self.body[start..end])
    }

    /// Bytes that were not read.
    pub fn rest(&self) -> usize {
        self.body.len() - self.at
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let bytes = self.raw(N, N)?;
        bytes.try_into().map_err(|_| "it is too short".to_owned())
    }

    pub fn u8(&mut self) -> Result<u8, Fault> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    pub fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub fn f64(&mut self) -> Result<f64, Fault> {
        Ok(f64::from_bits(self.u64()?))
    }

    pub fn text(&mut self) -> Result<&'a str, Fault> {
        let len = self.u32()? as usize;
        let bytes = self.raw(len, 1)?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        std::str::from_utf8(bytes).map_err(|_| "a text is not UTF-8".to_owned())
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self) -> Result<&'a [u8], Fault> {
        let len = self.u32()? as usize;
        self.raw(len, 1)
    }

    /// Stamp in ns of a `std_msgs/Header`.
    pub fn header(&mut self) -> Result<u64, Fault> {
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        self.text()?;
        if seconds > i32::MAX as u32 || u64::from(nanoseconds) >= NANOSECONDS {
            return Err(format!("its stamp of {seconds} s and {nanoseconds} ns is none"));
        }
        Ok(u64::from(seconds) * NANOSECONDS + u64::from(nanoseconds))
    }
}
