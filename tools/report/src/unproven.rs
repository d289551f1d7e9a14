//! Why a reference is not proven, in words for a person.

use stillpoint_samples::Unproven;

/// The cause of this code; `None` where there is none, or none that is known.
#[must_use]
pub fn cause(code: u32) -> Option<&'static str> {
    Some(match Unproven::from_number(code)? {
        Unproven::None => return None,
        Unproven::TooLittleMotion => "the head has moved too little, or was seen too coarsely, to tell",
        Unproven::PieceApart => {
            "a piece of the reference moves against the rest of it, such as a hand, a blanket or a shoulder"
        }
        Unproven::Mixed => "neighbouring patches do not move alike, as under a mask at rest",
        Unproven::FaceMoves => "the face moves by itself, and such frames prove nothing",
        Unproven::Doubted => "the frames are doubted",
        Unproven::OtherCameras => "it is seen by other cameras than those with which it was proven",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cause_has_words_of_its_own() {
        let causes: std::collections::BTreeSet<_> =
            Unproven::ALL.iter().filter_map(|(_, code)| cause(*code as u32)).collect();
        assert_eq!(causes.len(), Unproven::ALL.len() - 1);
        assert_eq!((cause(Unproven::None as u32), cause(1000)), (None, None));
    }
}
