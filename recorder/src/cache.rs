//! The blocks that were read last, so that samples asked for one by one do not decompress a chunk each.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of records that are kept.
const CAPACITY: usize = 64 << 20;

/// Number of the part, number of the block in it.
type Key = (u32, u32);

/// The blocks read last, the newest in front.
#[derive(Debug, Default)]
pub(crate) struct BlockCache {
    blocks: Mutex<VecDeque<(Key, Arc<Vec<u8>>)>>,
}

impl BlockCache {
    /// The block, out of the cache or by `load`.
    pub fn get(&self, key: Key, load: impl FnOnce() -> io::Result<Vec<u8>>) -> io::Result<Arc<Vec<u8>>> {
        let mut blocks = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = blocks.iter().position(|(k, _)| *k == key)
            && let Some(found) = blocks.remove(at)
        {
            let bytes = Arc::clone(&found.1);
            blocks.push_front(found);
            return Ok(bytes);
        }
        let bytes = Arc::new(load()?);
        blocks.push_front((key, Arc::clone(&bytes)));
        let mut held = 0;
        let mut keep = 0;
        for (_, b) in blocks.iter() {
            held += b.len();
            if keep > 0 && held > CAPACITY {
                break;
            }
            keep += 1;
        }
        blocks.truncate(keep);
        Ok(bytes)
    }
}
