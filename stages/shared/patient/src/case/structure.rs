//! Structures and their roles.

use serde::{Deserialize, Serialize};

use super::mask::Mask;

/// What a structure is to a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The outline of the patient.
    External,
    /// A planning target volume: dose is prescribed to it, and the isocentre lies in its middle.
    Target,
    /// Tumour inside a target (GTV, CTV): its dose is reported.
    ClinicalTarget,
    /// An organ at risk.
    Organ,
    /// Any other drawn structure: markers, couch, planning aids.
    Other,
}

impl Role {
    /// The role of a DICOM "RT ROI Interpreted Type" (3006,00A4), or of `type` in the JSON beside NRRD volumes. `None`
    /// where neither knows the word.
    pub fn of_interpreted_type(word: &str) -> Option<Self> {
        Some(match word.trim().to_ascii_uppercase().as_str() {
            "EXTERNAL" => Self::External,
            "PTV" | "TARGET" | "TREATED_VOLUME" | "IRRAD_VOLUME" => Self::Target,
            "CTV" | "GTV" => Self::ClinicalTarget,
            "ORGAN" | "OAR" | "AVOIDANCE" => Self::Organ,
            "BOLUS" | "BRACHY_CHANNEL" | "BRACHY_ACCESSORY" | "BRACHY_SRC_APP" | "BRACHY_CHNL_SHLD"
            | "CAVITY" | "CONTRAST_AGENT" | "CONTROL" | "DOSE_REGION" | "FIXATION" | "ISOCENTER"
            | "MARKER" | "REGISTRATION" | "SUPPORT" | "DOSE_MEASUREMENT" | "OTHER" => Self::Other,
            _ => return None,
        })
    }

    /// The word for people and for files.
    pub fn word(self) -> &'static str {
        match self {
            Self::External => "external",
            Self::Target => "target",
            Self::ClinicalTarget => "clinical target",
            Self::Organ => "organ",
            Self::Other => "other",
        }
    }
}

/// A named part of the patient.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Structure {
    /// Its name, unique in a case.
    pub name: String,
    /// Its role in a plan.
    pub role: Role,
    /// Its voxels.
    pub mask: Mask,
}
