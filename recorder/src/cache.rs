//! The blocks that were read last, so that samples asked for one by one do not decompress a chunk each.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};

use crate::file::Buffer;

/// Bytes of records that are kept.
const CAPACITY: usize = 64 << 20;
/// The largest room that is used again for the next block; larger is given back.
const LARGEST_SPARE: usize = 8 << 20;

/// Number of the part, number of the block in it.
type Key = (u32, u32);

/// The blocks read last, the newest in front.
#[derive(Debug, Default)]
pub(crate) struct BlockCache {
    blocks: Mutex<Blocks>,
}

#[derive(Debug, Default)]
struct Blocks {
    newest: VecDeque<(Key, Arc<Buffer>)>,
    /// Room of a block that went.
    spare: Buffer,
    /// Room for the bytes of a block before they are decompressed.
    stored: Buffer,
}

impl BlockCache {
    /// The block, out of the cache or by `load`, which gets room for the block and for its stored bytes.
    pub fn get(
        &self,
        key: Key,
        load: impl FnOnce(&mut Buffer, &mut Buffer) -> io::Result<()>,
    ) -> io::Result<Arc<Buffer>> {
        let mut blocks = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let Blocks { newest, spare, stored } = &mut *blocks;
        if let Some(at) = newest.iter().position(|(k, _)| *k == key)
            && let Some(found) = newest.remove(at)
        {
            let bytes = Arc::clone(&found.1);
            newest.push_front(found);
            return Ok(bytes);
        }
        let mut bytes = std::mem::take(spare);
        load(&mut bytes, stored)?;
        if stored.room() > LARGEST_SPARE {
            *stored = Buffer::default();
        }
        let bytes = Arc::new(bytes);
        newest.push_front((key, Arc::clone(&bytes)));
        let mut held: usize = newest.iter().map(|(_, b)| b.room()).sum();
        while held > CAPACITY && newest.len() > 1 {
            let Some((_, oldest)) = newest.pop_back() else { break };
            held -= oldest.room();
            if let Some(room) = Arc::into_inner(oldest).filter(|b| b.room() <= LARGEST_SPARE) {
                *spare = room;
            }
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_in_used_room_holds_its_own_bytes_and_the_room_stays_bounded() {
        let cache = BlockCache::default();
        // Long and short ones, more than are kept, and one too large for its room to be used again.
        let length = |n: u32| if n == 7 { LARGEST_SPARE + 1 } else { (2 + n as usize % 3) << 20 };
        let fill = |n: u32| {
            move |bytes: &mut Buffer, _: &mut Buffer| {
                bytes.set_len(0);
                bytes.set_len(length(n));
                bytes.fill(n as u8);
                Ok(())
            }
        };
        for n in 0..64 {
            let bytes = cache.get((0, n), fill(n)).ok();
            assert!(bytes.is_some_and(|b| b.len() == length(n) && b.iter().all(|x| *x == n as u8)), "{n}");
            let blocks = cache.blocks.lock().unwrap_or_else(PoisonError::into_inner);
            assert!(blocks.newest.iter().map(|(_, b)| b.room()).sum::<usize>() <= CAPACITY, "{n}");
            assert!(blocks.spare.room() <= LARGEST_SPARE, "{n}");
        }
    }

    #[test]
    fn a_block_in_the_cache_is_not_loaded_again() {
        let cache = BlockCache::default();
        let mut loads = 0;
        for _ in 0..3 {
            let found = cache.get((0, 0), |bytes, _| {
                loads += 1;
                bytes.set_len(5);
                Ok(())
            });
            assert!(found.is_ok_and(|b| b.len() == 5));
        }
        assert_eq!(loads, 1);
    }
}
