//! stillpoint
use stillpoint_samples::Pieces;
/// A loaned buffer.
pub struct Loan {}
impl Loan {
    /// Head and body, and room for the elements.
    pub fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        (&mut [], &mut [])
    }
    /// The bytes as they stand.
    pub fn pieces(&self) -> Pieces<'_> {
        Pieces { meta: &[], payload: &[] }
    }
}
