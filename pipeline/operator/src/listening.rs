//! Where a source listens for another program on its host.

/// A socket at which a source takes the messages of another program in a live run.
///
/// It is a stream socket of the Unix domain. A message is four bytes, its length in bytes without these eight (`u32`,
/// little-endian), and its content. All of it is handed to the source, also what is no message: the source counts each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listening {
    /// Path of the socket; one that is not absolute is looked for from the folder in which the run was started.
    pub socket: String,
    /// First bytes of each message.
    pub beginning: [u8; 4],
    /// The most bytes of a message, with the eight before its content.
    pub longest: usize,
}
