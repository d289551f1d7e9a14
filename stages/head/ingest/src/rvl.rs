//! RVL, the compression of depth by Wilson (2017): runs of zeros, and differences of the other pixels in pieces of three
//! bits. `compressedDepth` of ROS 2 has it as a format.

/// Why bytes are not RVL.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RvlError {
    /// The size of the image is missing, or no image has it.
    #[error("its RVL has {width} x {height} pixels (allowed: 1 to {most} in all)")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// The most pixels.
        most: usize,
    },
    /// The runs do not make the image.
    #[error("its RVL is damaged: {found} of {expected} pixels unpacked")]
    Damaged {
        /// Pixels until there.
        found: usize,
        /// Pixels of the image.
        expected: usize,
    },
}

/// An unpacked image: counts, pixels in a row, rows.
pub type Unpacked = (Vec<u16>, usize, usize);

/// Unpacks an image: columns and rows as 32 bits each, then the runs.
///
/// # Errors
/// What is wrong with it. Nothing is allocated for a size that the bytes cannot make.
pub fn unpack(bytes: &[u8], most: usize) -> Result<Unpacked, RvlError> {
    let word = |at: usize| {
        let raw = bytes.get(at..).and_then(|b| b.first_chunk()).copied();
        raw.map(u32::from_le_bytes).unwrap_or_default()
    };
    let (width, height) = (word(0), word(4));
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > most as u64 {
        return Err(RvlError::Size { width, height, most });
    }
    let expected = pixels as usize;
    let mut nibbles = Nibbles { bytes: bytes.get(8..).unwrap_or_default(), at: 0 };
    let mut counts: Vec<u16> = Vec::new();
    let mut last = 0_i32;
    while counts.len() < expected {
        let damaged = RvlError::Damaged { found: counts.len(), expected };
        let (Some(zeros), left) = (nibbles.number(), expected - counts.len()) else { return Err(damaged) };
        if zeros as usize > left {
            return Err(damaged);
        }
        counts.resize(counts.len() + zeros as usize, 0);
        // A last run of zeros may end the image, with or without a run of no pixels behind it.
        let others = nibbles.number().unwrap_or(0) as usize;
        if others > expected - counts.len() || zeros == 0 && others == 0 {
            return Err(damaged);
        }
        for _ in 0..others {
            let Some(folded) = nibbles.number() else { return Err(damaged) };
            last = last.wrapping_add((folded >> 1).cast_signed() ^ -((folded & 1).cast_signed()));
            let Ok(count) = u16::try_from(last) else { return Err(damaged) };
            counts.push(count);
        }
    }
    Ok((counts, width as usize, height as usize))
}

/// Pieces of four bits, the highest of each little-endian word of 32 bits first.
struct Nibbles<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Nibbles<'_> {
    fn next(&mut self) -> Option<u32> {
        let word = self.bytes.get(self.at / 8 * 4..).and_then(|b| b.first_chunk()).copied()?;
        let shift = 28 - 4 * (self.at % 8);
        self.at += 1;
        Some(u32::from_le_bytes(word) >> shift & 0xf)
    }

    /// A number in pieces of three bits, the lowest first; the fourth bit says that one more follows.
    fn number(&mut self) -> Option<u32> {
        let mut number = 0_u32;
        for piece in 0.. {
            let nibble = self.next()?;
            let bits = nibble & 7;
            let shifted = u64::from(bits) << (3 * piece);
            number |= u32::try_from(shifted).ok()?;
            if nibble & 8 == 0 {
                return Some(number);
            }
            if piece == 10 {
                return None;
            }
        }
        None
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The inverse, as the paper describes it.
    fn pack(counts: &[u16], width: u32) -> Vec<u8> {
        let mut nibbles = Vec::new();
        let mut put = |mut number: u32| loop {
            let bits = number & 7;
            number >>= 3;
            nibbles.push(if number > 0 { bits | 8 } else { bits });
            if number == 0 {
                break;
            }
        };
        let (mut at, mut last) = (0, 0_i32);
        while at < counts.len() {
            let zeros = counts[at..].iter().take_while(|c| **c == 0).count();
            at += zeros;
            let others = counts[at..].iter().take_while(|c| **c != 0).count();
            put(zeros as u32);
            put(others as u32);
            for count in &counts[at..at + others] {
                let step = i32::from(*count) - last;
                put(((step << 1) ^ (step >> 31)).cast_unsigned());
                last = i32::from(*count);
            }
            at += others;
        }
        let mut bytes = [width.to_le_bytes(), (counts.len() as u32 / width).to_le_bytes()].concat();
        for word in nibbles.chunks(8) {
            let value = (0..8).fold(0, |v, i| v << 4 | word.get(i).copied().unwrap_or(0));
            bytes.extend(u32::to_le_bytes(value));
        }
        bytes
    }

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(counts in prop::collection::vec(prop_oneof![Just(0_u16), any::<u16>()], 1..60)) {
            prop_assert_eq!(unpack(&pack(&counts, 1), 64).unwrap(), (counts.clone(), 1, counts.len()));
        }

        #[test]
        fn any_bytes_are_unpacked_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..60), width in 0_u32..9) {
            let _ = unpack(&[&width.to_le_bytes()[..], &bytes].concat(), 64);
        }
    }

    #[test]
    fn a_size_that_no_image_has_takes_no_memory() {
        let bytes = [u32::MAX.to_le_bytes(), u32::MAX.to_le_bytes()].concat();
        assert!(matches!(unpack(&bytes, 64), Err(RvlError::Size { .. })));
        let few = unpack(&[8_u32.to_le_bytes(), 8_u32.to_le_bytes()].concat(), 64);
        assert!(matches!(few, Err(RvlError::Damaged { found: 0, expected: 64 })));
    }
}
