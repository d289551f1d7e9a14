//! The header of an LZ4 frame.

const MAGIC: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];
/// A checksum of the content follows it.
const CONTENT_CHECKSUM: u8 = 1 << 2;
/// The size of the content, or the number of a dictionary, stands in the header.
const LONGER_HEADER: u8 = 1 << 3 | 1;

/// Tells the decoder of a frame not to look at the frame's own checksum, and says whether there was one. For a frame whose
/// content is checked otherwise: the checksum of a chunk is of the same bytes, and takes a third of the time.
pub(super) fn without_checksum(frame: &mut [u8]) -> bool {
    let Some([a, b, c, d, flags, block, check]) = frame.first_chunk_mut() else { return false };
    if [*a, *b, *c, *d] != MAGIC || *flags & LONGER_HEADER != 0 || *flags & CONTENT_CHECKSUM == 0 {
        return false;
    }
    if *check != header_check([*flags, *block]) {
        return false;
    }
    *flags &= !CONTENT_CHECKSUM;
    *check = header_check([*flags, *block]);
    true
}

/// The second byte of the XXH32 of the two bytes of a descriptor (LZ4 Frame Format 1.6.4, "Header Checksum").
fn header_check(descriptor: [u8; 2]) -> u8 {
    const PRIMES: [u32; 4] = [0x9e37_79b1, 0x85eb_ca77, 0xc2b2_ae3d, 0x1656_67b1];
    let mut h = PRIMES[3].wrapping_add(2);
    for byte in descriptor {
        h = h.wrapping_add(u32::from(byte).wrapping_mul(PRIMES[3])).rotate_left(11).wrapping_mul(PRIMES[0]);
    }
    h = (h ^ h >> 15).wrapping_mul(PRIMES[1]);
    h = (h ^ h >> 13).wrapping_mul(PRIMES[2]);
    ((h ^ h >> 16) >> 8) as u8
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    fn frame(content: &[u8]) -> Option<Vec<u8>> {
        let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).ok()?;
        encoder.write_all(content).ok()?;
        Some(encoder.finish().0)
    }

    fn content(frame: &[u8]) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        lz4::Decoder::new(frame).ok()?.read_to_end(&mut bytes).ok()?;
        Some(bytes)
    }

    #[test]
    fn a_frame_gives_its_content_without_its_checksum() {
        for len in [0, 1, 1000, 300_000] {
            let written: Vec<u8> = (0..len).map(|i| (i / 7) as u8).collect();
            let mut frame = frame(&written).unwrap_or_default();
            assert!(without_checksum(&mut frame), "{len}");
            assert_eq!(content(&frame).as_ref(), Some(&written), "{len}");
            // The checksum stands last: a wrong one is not looked at.
            if let Some(last) = frame.last_mut() {
                *last ^= 1;
            }
            assert_eq!(content(&frame), Some(written), "{len}");
        }
    }

    #[test]
    fn what_is_no_frame_with_a_checksum_is_left_as_it_is() {
        let mut bytes = frame(b"some content").unwrap_or_default();
        assert!(without_checksum(&mut bytes));
        for (at, value) in [(0, 0), (4, 0x6c), (6, 0)] {
            let mut other = frame(b"some content").unwrap_or_default();
            other[at] = value;
            let before = other.clone();
            assert!(!without_checksum(&mut other), "{at}");
            assert_eq!(other, before, "{at}");
        }
        assert!(!without_checksum(&mut bytes), "it has none any more");
        assert!(!without_checksum(&mut []));
    }
}
