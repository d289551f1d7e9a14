//! Bytes whose room is kept from one use to the next: only what it grows by is cleared.

use std::ops::{Deref, DerefMut};

/// Bytes in room that outlives them.
#[derive(Debug, Default)]
pub(crate) struct Buffer {
    room: Vec<u8>,
    len: usize,
}

impl Buffer {
    /// Sets the length. What is new holds zeros or bytes of an earlier use.
    pub fn set_len(&mut self, len: usize) {
        if len > self.room.len() {
            // Nothing of the old bytes is worth a copy once all of them are to be replaced.
            if self.len == 0 {
                self.room.clear();
            }
            self.room.resize(len, 0);
        }
        self.len = len;
    }

    /// Bytes that it takes in memory.
    pub fn room(&self) -> usize {
        self.room.len()
    }
}

impl Deref for Buffer {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.room[..self.len]
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [u8] {
        &mut self.room[..self.len]
    }
}
