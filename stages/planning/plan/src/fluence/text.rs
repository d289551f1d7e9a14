//! Quantities in the text form of objectives: a number with its unit, or a comparison.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::shapes::Bound;

/// A dose: `35 Gy`, `95 %` of the prescription, or `104 % of the highest` prescription.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Dose {
    /// Gray.
    Gray(f64),
    /// Percent of the prescription of the structure; of the highest one for a structure that has none.
    OfPrescription(f64),
    /// Percent of the highest prescription.
    OfHighest(f64),
}

/// A volume in percent of the structure: `30 %`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Volume(pub f64);

/// A length in millimetres: `20 mm`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Length(pub f64);

/// A dose with its side: `<= 30 Gy`, `>= 95 %`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct DoseBound {
    /// The side.
    pub bound: Bound,
    /// The dose.
    pub dose: Dose,
}

/// A DVH point: `D95% >= 50 Gy`, `V20Gy <= 30 %`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct DvhText {
    /// What is measured.
    pub reading: Reading,
    /// The side.
    pub bound: Bound,
    /// The dose.
    pub dose: Dose,
    /// The volume.
    pub volume: Volume,
}

/// What is measured of a histogram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// `D95%`: the dose that a volume gets.
    DoseAtVolume,
    /// `V20Gy`: the volume that gets a dose.
    VolumeAtDose,
}

impl Dose {
    /// Gray, with the prescription of the structure and the highest one.
    pub fn gray(self, prescribed_gy: f64, highest_gy: f64) -> f64 {
        match self {
            Self::Gray(gray) => gray,
            Self::OfPrescription(percent) => percent / 100.0 * prescribed_gy,
            Self::OfHighest(percent) => percent / 100.0 * highest_gy,
        }
    }
}

impl Volume {
    /// As a fraction.
    pub fn part(self) -> f64 {
        self.0 / 100.0
    }
}

/// Why a text of an objective is not read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// Not a dose.
    #[error(
        "{0:?} is not a dose: write `35 Gy`, `95 %` (of the prescription) or `104 % of the highest` (prescription)"
    )]
    Dose(String),
    /// Not a part of a structure.
    #[error("{0:?} is not a volume: write `30 %` (of the structure; allowed: 0 to 100)")]
    Volume(String),
    /// Not a distance.
    #[error("{0:?} is not a length: write `20 mm` (allowed: above 0)")]
    Length(String),
    /// Not a bound.
    #[error("{0:?} is not a bound of a dose: write `<= 30 Gy` or `>= 95 %` (of the prescription)")]
    Bound(String),
    /// Not a point of a histogram.
    #[error(
        "{0:?} is not a DVH point: write one like `D95% >= 50 Gy`, `D5% <= 107 %`, `V20Gy <= 30 %` or `V95% >= 98 %`"
    )]
    Dvh(String),
}

impl TryFrom<String> for Dose {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        let gray = number(&text, "Gy").map(Self::Gray);
        gray.or_else(|| number(&text, "%").map(Self::OfPrescription))
            .or_else(|| number(&text, "% of the highest").map(Self::OfHighest))
            .ok_or(TextError::Dose(text))
    }
}

impl TryFrom<String> for Volume {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        let percent = number(&text, "%").filter(|percent| (0.0..=1.0).contains(&(percent / 100.0)));
        percent.map(Self).ok_or(TextError::Volume(text))
    }
}

impl TryFrom<String> for Length {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        let mm = number(&text, "mm").filter(|mm| *mm > 0.0);
        mm.map(Self).ok_or(TextError::Length(text))
    }
}

impl TryFrom<String> for DoseBound {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        let found = compared(&text).filter(|(left, ..)| left.trim().is_empty());
        let (_, bound, right) = found.ok_or_else(|| TextError::Bound(text.clone()))?;
        Ok(Self { bound, dose: right.to_owned().try_into()? })
    }
}

impl TryFrom<String> for DvhText {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        let wrong = || TextError::Dvh(text.clone());
        let (left, bound, right) = compared(&text).ok_or_else(wrong)?;
        let (left, right) = (left.trim(), right.trim().to_owned());
        if let Some(volume) = left.strip_prefix('D') {
            // `D95` is `D95%`, as people write it.
            let volume = if volume.ends_with('%') { volume.to_owned() } else { format!("{volume}%") };
            let volume = volume.try_into().map_err(|_: TextError| wrong())?;
            return Ok(Self { reading: Reading::DoseAtVolume, bound, dose: right.try_into()?, volume });
        }
        let dose = left.strip_prefix('V').ok_or_else(wrong)?.to_owned();
        let dose = dose.try_into().map_err(|_: TextError| wrong())?;
        Ok(Self { reading: Reading::VolumeAtDose, bound, dose, volume: right.try_into()? })
    }
}

impl fmt::Display for Dose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gray(gray) => write!(f, "{gray} Gy"),
            Self::OfPrescription(percent) => write!(f, "{percent} %"),
            Self::OfHighest(percent) => write!(f, "{percent} % of the highest"),
        }
    }
}

impl fmt::Display for Volume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} %", self.0)
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} mm", self.0)
    }
}

impl fmt::Display for DoseBound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.bound.sign(), self.dose)
    }
}

impl fmt::Display for DvhText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reading, bound, dose, volume } = self;
        match reading {
            Reading::DoseAtVolume => write!(f, "D{}% {} {dose}", volume.0, bound.sign()),
            Reading::VolumeAtDose => {
                write!(f, "V{} {} {volume}", dose.to_string().replacen(' ', "", 1), bound.sign())
            }
        }
    }
}

macro_rules! written {
    ($($type:ty),*) => {
        $(impl From<$type> for String {
            fn from(value: $type) -> Self {
                value.to_string()
            }
        })*
    };
}

written!(Dose, Volume, Length, DoseBound, DvhText);

/// A number with this unit.
fn number(text: &str, unit: &str) -> Option<f64> {
    text.trim().strip_suffix(unit)?.trim().parse().ok().filter(|n: &f64| n.is_finite())
}

/// What is left and right of `<=` or `>=`.
fn compared(text: &str) -> Option<(&str, Bound, &str)> {
    let both = |bound: Bound| text.split_once(bound.sign()).map(|(left, right)| (left, bound, right));
    both(Bound::AtMost).or_else(|| both(Bound::AtLeast))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dvh_point_is_read_as_protocols_write_it() {
        let read = |text: &str| DvhText::try_from(text.to_owned());
        let d95 = read("D95 >= 50 Gy").unwrap();
        assert_eq!(d95, read(" D95% >=50Gy").unwrap());
        assert_eq!((d95.reading, d95.bound), (Reading::DoseAtVolume, Bound::AtLeast));
        assert_eq!((d95.dose, d95.volume), (Dose::Gray(50.0), Volume(95.0)));
        let v20 = read("V20Gy <= 30 %").unwrap();
        assert_eq!(
            (v20.reading, v20.dose, v20.volume.part()),
            (Reading::VolumeAtDose, Dose::Gray(20.0), 0.3)
        );
        assert_eq!(read("V95% of the highest >= 98 %").unwrap().dose, Dose::OfHighest(95.0));
        for wrong in [
            "D95",
            "D95 = 50 Gy",
            "D195 >= 50 Gy",
            "V20 <= 30 %",
            "Q5 <= 3 Gy",
            "V20Gy <= 30",
            "D2% <= 20",
            "D0.03cc <= 4 Gy",
        ] {
            let why = read(wrong).unwrap_err().to_string();
            assert!(why.contains("write"), "{wrong}: {why}");
        }
    }

    #[test]
    fn a_bound_has_a_side_and_a_dose() {
        let read = |text: &str| DoseBound::try_from(text.to_owned());
        assert_eq!(read("<= 30 Gy").unwrap(), DoseBound { bound: Bound::AtMost, dose: Dose::Gray(30.0) });
        assert_eq!(read("30 Gy"), Err(TextError::Bound("30 Gy".into())));
        assert!(read("gEUD <= 30 Gy").is_err());
        assert_eq!(read("<= 30"), Err(TextError::Dose(" 30".into())));
    }
}
