//! Which voxels belong to a structure.

/// A set of voxels of a volume, one bit each, in the order of the volume's values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    len: usize,
    /// Bit `i % 64` of word `i / 64` is voxel `i`; bits beyond `len` are zero.
    words: Vec<u64>,
}

impl Mask {
    /// The voxels of `len` for which `inside` is true.
    pub fn from_fn(len: usize, mut inside: impl FnMut(usize) -> bool) -> Self {
        let mut mask = Self::empty(len);
        for index in 0..len {
            if inside(index) {
                mask.words[index / 64] |= 1 << (index % 64);
            }
        }
        mask
    }

    /// No voxel of `len`.
    pub fn empty(len: usize) -> Self {
        Self { len, words: vec![0; len.div_ceil(64)] }
    }

    /// Puts a voxel of the volume inside. An index beyond the volume changes nothing.
    pub fn insert(&mut self, index: usize) {
        if index < self.len {
            self.words[index / 64] |= 1 << (index % 64);
        }
    }

    /// Voxels of the volume, inside or not.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether no voxel is inside.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&w| w == 0)
    }

    /// Whether a voxel is inside. Beyond the volume nothing is.
    pub fn contains(&self, index: usize) -> bool {
        self.words.get(index / 64).is_some_and(|w| w >> (index % 64) & 1 == 1)
    }

    /// How many voxels are inside.
    pub fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The voxels inside, rising.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(place, &word)| {
            let mut left = word;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros() as usize)?;
                left &= left - 1;
                Some(64 * place + bit)
            })
        })
    }

    /// The bits, eight to a byte, least significant first.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.words.iter().flat_map(|w| w.to_le_bytes()).collect();
        bytes.truncate(self.len.div_ceil(8));
        bytes
    }

    /// The mask of these bits, if they are as many as `len` needs and none stands beyond it.
    pub fn from_bytes(len: usize, bytes: &[u8]) -> Option<Self> {
        let spare = bytes.len().checked_mul(8)?.checked_sub(len)?;
        let beyond = spare > 0 && *bytes.last()? >> (8 - spare.min(8)) != 0;
        if spare > 7 || beyond {
            return None;
        }
        let word = |part: &[u8]| {
            let mut whole = [0; 8];
            whole[..part.len()].copy_from_slice(part);
            u64::from_le_bytes(whole)
        };
        Some(Self { len, words: bytes.chunks(8).map(word).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_mask_holds_what_it_was_given_and_its_bytes_give_it_back(bits in prop::collection::vec(any::<bool>(), 0..300)) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            let inside: Vec<usize> = (0..bits.len()).filter(|&i| bits[i]).collect();
            prop_assert_eq!(mask.indices().collect::<Vec<_>>(), inside.clone());
            prop_assert_eq!(mask.count(), inside.len());
            prop_assert!((0..bits.len() + 70).all(|i| mask.contains(i) == bits.get(i).copied().unwrap_or(false)));
            prop_assert_eq!(Mask::from_bytes(bits.len(), &mask.to_bytes()), Some(mask));
        }
    }

    #[test]
    fn bits_beyond_the_volume_are_refused() {
        assert!(Mask::from_bytes(3, &[0b111]).is_some());
        assert!(Mask::from_bytes(3, &[0b1000]).is_none());
        assert!(Mask::from_bytes(3, &[0, 0]).is_none());
        assert!(Mask::from_bytes(9, &[0]).is_none());
        assert!(Mask::from_bytes(0, &[]).is_some());
    }
}
