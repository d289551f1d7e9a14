//! Canonical bytes: little endian, lists and texts behind their length. The reader makes nothing before its bytes are there.

use thiserror::Error;

use crate::Hash;

/// Why bytes cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum WireError {
    /// They end too early.
    #[error("the bytes end within {0}")]
    Short(&'static str),
    /// A length or a number is beyond its bound.
    #[error("{what} is {found}; at most {most} is allowed")]
    Bound {
        /// What it is.
        what: &'static str,
        /// Its value.
        found: u64,
        /// The most.
        most: u64,
    },
    /// A number names nothing.
    #[error("{0} is not known")]
    Unknown(&'static str),
    /// A text is not UTF-8.
    #[error("{0} is not a text")]
    Text(&'static str),
    /// There are bytes behind the end.
    #[error("there are {0} bytes behind the end")]
    Trailing(usize),
}

/// Appends values.
#[derive(Default)]
pub struct Writer(pub Vec<u8>);

impl Writer {
    /// Appends a byte.
    pub fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    /// Appends a number.
    pub fn number(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    /// Appends a number with a fraction, by its bits.
    pub fn real(&mut self, value: f64) {
        self.number(value.to_bits());
    }

    /// Appends a hash.
    pub fn hash(&mut self, hash: &Hash) {
        self.0.extend(hash.0);
    }

    /// Appends bytes behind their length.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.number(bytes.len() as u64);
        self.0.extend(bytes);
    }

    /// Appends numbers behind their count.
    pub fn reals(&mut self, values: &[f64]) {
        self.number(values.len() as u64);
        values.iter().for_each(|value| self.real(*value));
    }

    /// Appends numbers behind their count.
    pub fn words(&mut self, values: &[u32]) {
        self.number(values.len() as u64);
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }
}

/// Reads values.
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Of these bytes.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// As many bytes.
    pub fn raw(&mut self, count: usize, what: &'static str) -> Result<&'a [u8], WireError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(WireError::Short(what))?;
        self.rest = rest;
        Ok(taken)
    }

    fn fixed<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], WireError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.raw(N, what)?);
        Ok(bytes)
    }

    /// A byte.
    pub fn byte(&mut self, what: &'static str) -> Result<u8, WireError> {
        Ok(self.fixed::<1>(what)?[0])
    }

    /// Whether something holds.
    pub fn flag(&mut self, what: &'static str) -> Result<bool, WireError> {
        match self.byte(what)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(WireError::Unknown(what)),
        }
    }

    /// A number.
    pub fn number(&mut self, what: &'static str) -> Result<u64, WireError> {
        Ok(u64::from_le_bytes(self.fixed(what)?))
    }

    /// A number of at most `most`.
    pub fn count(&mut self, most: usize, what: &'static str) -> Result<usize, WireError> {
        let found = self.number(what)?;
        match usize::try_from(found) {
            Ok(count) if count <= most => Ok(count),
            _ => Err(WireError::Bound { what, found, most: most as u64 }),
        }
    }

    /// A number with a fraction.
    pub fn real(&mut self, what: &'static str) -> Result<f64, WireError> {
        Ok(f64::from_bits(self.number(what)?))
    }

    /// A hash.
    pub fn hash(&mut self, what: &'static str) -> Result<Hash, WireError> {
        Ok(Hash(self.fixed(what)?))
    }

    /// At most `most` bytes.
    pub fn bytes(&mut self, most: usize, what: &'static str) -> Result<&'a [u8], WireError> {
        let count = self.count(most, what)?;
        self.raw(count, what)
    }

    /// A text of at most `most` bytes.
    pub fn text(&mut self, most: usize, what: &'static str) -> Result<String, WireError> {
        let bytes = self.bytes(most, what)?.to_vec();
        String::from_utf8(bytes).map_err(|_| WireError::Text(what))
    }

    /// As many numbers as there are bytes for.
    pub fn reals(&mut self, what: &'static str) -> Result<Vec<f64>, WireError> {
        let count = self.count(self.rest.len() / 8, what)?;
        (0..count).map(|_| self.real(what)).collect()
    }

    /// As many numbers as there are bytes for.
    pub fn words(&mut self, what: &'static str) -> Result<Vec<u32>, WireError> {
        let count = self.count(self.rest.len() / 4, what)?;
        (0..count).map(|_| Ok(u32::from_le_bytes(self.fixed(what)?))).collect()
    }

    /// A list of at most `most`.
    pub fn list<T>(
        &mut self,
        most: usize,
        what: &'static str,
        mut each: impl FnMut(&mut Self) -> Result<T, WireError>,
    ) -> Result<Vec<T>, WireError> {
        let count = self.count(most, what)?;
        (0..count).map(|_| each(self)).collect()
    }

    /// That nothing is left.
    pub fn end(self) -> Result<(), WireError> {
        if self.rest.is_empty() { Ok(()) } else { Err(WireError::Trailing(self.rest.len())) }
    }
}
