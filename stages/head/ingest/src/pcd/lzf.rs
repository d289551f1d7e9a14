//! LZF decompression: literal runs and back references of up to 8 KiB.

/// Bytes that one compressed byte can stand for at most: a three-byte reference repeats 264 bytes.
pub(super) const MAX_EXPANSION: usize = 88;

/// Where unpacking stopped, in bytes read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Damage {
    pub read: usize,
    pub unpacked: usize,
}

/// Unpacks `packed` into exactly `expected` bytes.
///
/// The caller has checked `expected` against [`MAX_EXPANSION`], so that damaged sizes allocate nothing.
pub(super) fn unpack(packed: &[u8], expected: usize) -> Result<Vec<u8>, Damage> {
    let mut out: Vec<u8> = Vec::with_capacity(expected);
    let mut at = 0;
    while at < packed.len() {
        let damage = Damage { read: at, unpacked: out.len() };
        let control = usize::from(packed[at]);
        at += 1;
        if control < 32 {
            let run = packed.get(at..at + control + 1).ok_or(damage)?;
            if out.len() + run.len() > expected {
                return Err(damage);
            }
            out.extend_from_slice(run);
            at += run.len();
            continue;
        }
        let mut length = control >> 5;
        if length == 7 {
            length += usize::from(*packed.get(at).ok_or(damage)?);
            at += 1;
        }
        length += 2;
        let low = usize::from(*packed.get(at).ok_or(damage)?);
        at += 1;
        let distance = ((control & 0x1f) << 8 | low) + 1;
        let start = out.len().checked_sub(distance).ok_or(damage)?;
        if out.len() + length > expected {
            return Err(damage);
        }
        if distance >= length {
            out.extend_from_within(start..start + length);
        } else {
            // The reference reaches into what it writes: a repeated pattern.
            for i in start..start + length {
                out.push(out[i]);
            }
        }
    }
    if out.len() == expected { Ok(out) } else { Err(Damage { read: at, unpacked: out.len() }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literal_runs_are_copied() {
        assert_eq!(unpack(&[2, b'a', b'b', b'c'], 3), Ok(b"abc".to_vec()));
    }

    #[test]
    fn overlapping_reference_repeats_its_pattern() {
        // "ab", then 6 bytes from distance 2.
        assert_eq!(unpack(&[1, b'a', b'b', 4 << 5, 1], 8), Ok(b"abababab".to_vec()));
    }

    #[test]
    fn long_reference_takes_its_length_from_the_next_byte() {
        let out = unpack(&[0, b'x', 7 << 5, 255, 0], 265).unwrap();
        assert_eq!(out, vec![b'x'; 265]);
    }

    #[test]
    fn reference_before_the_start_is_refused_where_it_stands() {
        assert_eq!(unpack(&[0, b'x', 1 << 5, 1], 4), Err(Damage { read: 2, unpacked: 1 }));
    }

    #[test]
    fn too_little_and_too_much_output_are_refused() {
        assert_eq!(unpack(&[0, b'x'], 2), Err(Damage { read: 2, unpacked: 1 }));
        assert_eq!(unpack(&[1, b'x', b'y'], 1), Err(Damage { read: 0, unpacked: 0 }));
    }
}
