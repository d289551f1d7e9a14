//! What the datagrams of a kind of operator look like from outside.

/// The form of a datagram that an operator sends over a link: what has another form is none of its.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireForm {
    /// First bytes.
    pub beginning: &'static [u8],
    /// Bytes of the shortest.
    pub shortest: usize,
    /// Bytes of the longest.
    pub longest: usize,
}

impl WireForm {
    /// Whether a datagram has this form.
    pub fn fits(&self, datagram: &[u8]) -> bool {
        (self.shortest..=self.longest).contains(&datagram.len()) && datagram.starts_with(self.beginning)
    }
}
