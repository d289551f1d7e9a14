//! A long row of things in bounded memory: when it is full, every second one is let go.

/// Things that are kept of one topic. A row that would be longer is kept with gaps of equal length.
pub const MOST: usize = 100_000;

/// The first, and from then on every `stride`-th of the things that were pushed.
#[derive(Clone, Debug)]
pub struct Thinned<T> {
    kept: Vec<T>,
    stride: u64,
    seen: u64,
    most: usize,
}

impl<T> Default for Thinned<T> {
    fn default() -> Self {
        Self::with_room(MOST)
    }
}

impl<T> Thinned<T> {
    /// An empty row that keeps at most this many, at least two.
    pub fn with_room(most: usize) -> Self {
        Self { kept: Vec::new(), stride: 1, seen: 0, most: most.max(2) }
    }

    /// Takes the next one.
    pub fn push(&mut self, item: T) {
        let number = self.seen;
        self.seen += 1;
        if !number.is_multiple_of(self.stride) {
            return;
        }
        if self.kept.len() >= self.most {
            let mut at = 0;
            self.kept.retain(|_| {
                at += 1;
                at % 2 == 1
            });
            self.stride *= 2;
            if !number.is_multiple_of(self.stride) {
                return;
            }
        }
        self.kept.push(item);
    }

    /// Those that were kept, in their order.
    pub fn items(&self) -> &[T] {
        &self.kept
    }

    /// The same, to be put in another order.
    pub fn items_mut(&mut self) -> &mut [T] {
        &mut self.kept
    }

    /// How many were pushed.
    pub fn seen(&self) -> u64 {
        self.seen
    }

    /// One of how many was kept.
    pub fn stride(&self) -> u64 {
        self.stride
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_row_keeps_every_second_from_its_first_on() {
        let mut row = Thinned::with_room(8);
        (0..8).for_each(|i| row.push(i));
        assert_eq!((row.items(), row.stride()), (&[0, 1, 2, 3, 4, 5, 6, 7][..], 1));
        (8..100).for_each(|i| row.push(i));
        assert_eq!(row.items(), &[0, 16, 32, 48, 64, 80, 96]);
        assert_eq!((row.seen(), row.stride()), (100, 16));
    }
}
