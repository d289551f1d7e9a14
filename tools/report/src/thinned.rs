//! A long series in bounded memory: when it is full, every second item is dropped.

/// Maximum number of items of a series. A longer series keeps every n-th item.
pub const MOST: usize = 100_000;

/// The first item and every `stride`-th item after it.
#[derive(Clone, Debug)]
pub struct Thinned<T> {
    retained: Vec<T>,
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
    /// An empty series that keeps at most this many items, at least two.
    pub fn with_room(most: usize) -> Self {
        Self { retained: Vec::new(), stride: 1, seen: 0, most: most.max(2) }
    }

    /// Takes the next item.
    pub fn push(&mut self, item: T) {
        let number = self.seen;
        self.seen += 1;
        if !number.is_multiple_of(self.stride) {
            return;
        }
        if self.retained.len() >= self.most {
            let mut at = 0;
            self.retained.retain(|_| {
                at += 1;
                at % 2 == 1
            });
            self.stride *= 2;
            if !number.is_multiple_of(self.stride) {
                return;
            }
        }
        self.retained.push(item);
    }

    /// The items that were kept, in their order.
    pub fn items(&self) -> &[T] {
        &self.retained
    }

    /// The items that were kept, to be reordered.
    pub fn items_mut(&mut self) -> &mut [T] {
        &mut self.retained
    }

    /// Number of items that were pushed.
    pub fn seen(&self) -> u64 {
        self.seen
    }

    /// One item of this many was kept.
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
