//! Bytes in memory or in a file, read by offset.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use super::buffer::Buffer;
use crate::folder::is_being_written;

/// Where the bytes of one part are.
#[derive(Clone, Debug)]
pub enum Source {
    /// In memory.
    Bytes(Arc<[u8]>),
    /// In a file, of which only what is asked for is read.
    File(Arc<File>),
}

impl Source {
    /// Opens a file.
    ///
    /// # Errors
    /// What the operating system answers.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self::File(Arc::new(File::open(path)?)))
    }

    /// Whether a recorder has the file open.
    pub(crate) fn is_being_written(&self) -> bool {
        match self {
            Self::Bytes(_) => false,
            Self::File(f) => is_being_written(f),
        }
    }

    /// Bytes that are there.
    pub(crate) fn size(&self) -> io::Result<u64> {
        match self {
            Self::Bytes(b) => Ok(b.len() as u64),
            Self::File(f) => Ok(f.metadata()?.len()),
        }
    }

    /// The bytes from `offset` on, at most `len` of them: fewer at the end.
    pub(crate) fn read(&self, offset: u64, len: usize) -> io::Result<Vec<u8>> {
        let mut bytes = Buffer::default();
        self.read_into(offset, len, &mut bytes)?;
        Ok(bytes.to_vec())
    }

    /// Puts the bytes from `offset` on into `bytes`, at most `len` of them: fewer at the end.
    pub(crate) fn read_into(&self, offset: u64, len: usize, bytes: &mut Buffer) -> io::Result<()> {
        let there = self.size()?.saturating_sub(offset);
        let len = len.min(usize::try_from(there).unwrap_or(usize::MAX));
        bytes.set_len(0);
        bytes.set_len(len);
        match self {
            Self::Bytes(b) => {
                let start = usize::try_from(offset).unwrap_or(usize::MAX).min(b.len());
                bytes.copy_from_slice(&b[start..start + len]);
            }
            Self::File(f) => {
                let mut read = 0;
                while read < len {
                    match f.read_at(&mut bytes[read..], offset + read as u64) {
                        Ok(0) => break,
                        Ok(n) => read += n,
                        Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                        Err(e) => return Err(e),
                    }
                }
                bytes.set_len(read);
            }
        }
        Ok(())
    }
}
