//! How the patient lies on the couch.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How the patient lies: DICOM's "Patient Position" (0018,5100).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum PatientPosition {
    /// Head first, supine.
    #[default]
    #[serde(rename = "HFS")]
    HeadFirstSupine,
    /// Head first, prone.
    #[serde(rename = "HFP")]
    HeadFirstProne,
    /// Feet first, supine.
    #[serde(rename = "FFS")]
    FeetFirstSupine,
    /// Feet first, prone.
    #[serde(rename = "FFP")]
    FeetFirstProne,
}

impl PatientPosition {
    /// All of them.
    pub const ALL: [Self; 4] =
        [Self::HeadFirstSupine, Self::HeadFirstProne, Self::FeetFirstSupine, Self::FeetFirstProne];

    /// The position of this DICOM term.
    pub fn of_term(term: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|position| position.term() == term)
    }

    /// Its DICOM term.
    pub fn term(self) -> &'static str {
        match self {
            Self::HeadFirstSupine => "HFS",
            Self::HeadFirstProne => "HFP",
            Self::FeetFirstSupine => "FFS",
            Self::FeetFirstProne => "FFP",
        }
    }

    /// What a direction of the DICOM patient frame becomes, axis by axis, in the frame of a patient who lies head first
    /// and supine in the same place: half a turn about one axis of the patient, or none.
    pub fn signs(self) -> [f64; 3] {
        match self {
            Self::HeadFirstSupine => [1.0, 1.0, 1.0],
            Self::HeadFirstProne => [-1.0, -1.0, 1.0],
            Self::FeetFirstSupine => [-1.0, 1.0, -1.0],
            Self::FeetFirstProne => [1.0, -1.0, -1.0],
        }
    }

    /// Whether the patient lies head first and supine, as a case does that says no position.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for PatientPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::HeadFirstSupine => "head first supine",
            Self::HeadFirstProne => "head first prone",
            Self::FeetFirstSupine => "feet first supine",
            Self::FeetFirstProne => "feet first prone",
        })
    }
}
