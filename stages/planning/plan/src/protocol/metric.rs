//! The quantity of a limit.

use std::str::FromStr;

use thiserror::Error;

use crate::evaluation::FallOff;
use crate::metrics::Dvh;

/// A quantity of a structure or of a whole plan. Doses in percent are of the prescription, volumes in percent of the
/// structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Metric {
    /// `V75Gy[%]`: the volume that gets at least a dose.
    VolumeAt(Dose, VolumeUnit),
    /// `D95%[Gy]`, `D0.03cc[Gy]`: the dose that a volume gets at least.
    DoseAt(Volume, DoseUnit),
    /// `Mean[Gy]`.
    Mean(DoseUnit),
    /// `Paddick`: Paddick's conformity index of a target, of the isodose of 95 %.
    Paddick,
    /// `HI`: `(D2% - D98%) / D50%`.
    Homogeneity,
    /// `R50`: volume of the isodose of 50 % over that of all targets. Of a plan.
    R50,
    /// `D2cm[%]`: D0.03cc more than 2 cm from every target. Of a plan.
    Beyond2cm(DoseUnit),
    /// `Entry[%]`: D0.03cc within 1 cm of the skin and outside targets. Of a plan.
    Entry(DoseUnit),
}

/// A dose of a metric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dose {
    /// Gray.
    Gray(f64),
    /// Percent of the prescription.
    Percent(f64),
}

/// A volume of a metric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Volume {
    /// Percent of the structure.
    Percent(f64),
    /// cm3.
    Cc(f64),
}

/// Unit of a dose that is limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DoseUnit {
    /// `[Gy]`
    Gray,
    /// `[%]` of the prescription.
    Percent,
}

/// Unit of a volume that is limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeUnit {
    /// `[%]` of the structure.
    Percent,
    /// `[cc]`
    Cc,
}

/// A text is no metric.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "`{0}` is not a quantity of a plan; write one like `V75Gy[%]`, `V95%[%]`, `D95%[Gy]`, `D0.03cc[Gy]`, `Mean[Gy]`, `Paddick`, \
     `HI`, `R50`, `D2cm[%]` or `Entry[%]`"
)]
pub struct MetricError(pub String);

/// What a metric is taken of.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// Histogram of the structure with volumes in cm3; nothing for a whole plan.
    pub dvh: Option<&'a Dvh>,
    /// Prescription that percents of dose are of, gray.
    pub prescribed_gy: f64,
    /// Paddick's index of the structure.
    pub conformity: Option<f64>,
    /// How the dose of the plan falls off.
    pub fall_off: Option<&'a FallOff>,
}

impl Metric {
    /// Whether it is of a whole plan.
    pub fn is_of_plan(self) -> bool {
        matches!(self, Self::R50 | Self::Beyond2cm(_) | Self::Entry(_))
    }

    /// Its value, in its unit; nothing where the subject has no such quantity.
    pub fn value(self, of: Subject<'_>) -> Option<f64> {
        let in_unit = |gray: f64, unit| match unit {
            DoseUnit::Gray => Some(gray),
            DoseUnit::Percent => (of.prescribed_gy > 0.0).then(|| 100.0 * gray / of.prescribed_gy),
        };
        match self {
            Self::VolumeAt(dose, unit) => {
                let gray = match dose {
                    Dose::Gray(gray) => gray,
                    Dose::Percent(percent) if of.prescribed_gy > 0.0 => 0.01 * percent * of.prescribed_gy,
                    Dose::Percent(_) => return None,
                };
                let fraction = of.dvh?.volume_at(gray);
                Some(match unit {
                    VolumeUnit::Percent => 100.0 * fraction,
                    VolumeUnit::Cc => fraction * of.dvh?.volume(),
                })
            }
            Self::DoseAt(Volume::Percent(percent), unit) => in_unit(of.dvh?.dose_at(percent), unit),
            Self::DoseAt(Volume::Cc(cc), unit) => in_unit(of.dvh?.dose_at_volume(cc), unit),
            Self::Mean(unit) => in_unit(of.dvh?.mean(), unit),
            Self::Paddick => of.conformity,
            Self::Homogeneity => Some(of.dvh?.homogeneity()).filter(|h| h.is_finite()),
            Self::R50 => Some(of.fall_off?.r50),
            Self::Beyond2cm(unit) => in_unit(of.fall_off?.d2cm_gy?, unit),
            Self::Entry(unit) => in_unit(of.fall_off?.first_cm_gy?, unit),
        }
    }
}

impl FromStr for Metric {
    type Err = MetricError;

    fn from_str(text: &str) -> Result<Self, MetricError> {
        let text = text.trim();
        parse(text).ok_or_else(|| MetricError(text.to_owned()))
    }
}

fn parse(text: &str) -> Option<Metric> {
    let (name, unit) = match text.strip_suffix(']') {
        Some(rest) => rest.split_once('[').map(|(name, unit)| (name, Some(unit)))?,
        None => (text, None),
    };
    let dose_unit = || match unit {
        Some("Gy") => Some(DoseUnit::Gray),
        Some("%") => Some(DoseUnit::Percent),
        _ => None,
    };
    match name {
        "Paddick" => return unit.is_none().then_some(Metric::Paddick),
        "HI" => return unit.is_none().then_some(Metric::Homogeneity),
        "R50" => return unit.is_none().then_some(Metric::R50),
        "D2cm" => return dose_unit().map(Metric::Beyond2cm),
        "Entry" => return dose_unit().map(Metric::Entry),
        "Mean" => return dose_unit().map(Metric::Mean),
        _ => {}
    }
    if let Some(of) = name.strip_prefix('V') {
        let dose = number(of, "Gy").map(Dose::Gray).or_else(|| number(of, "%").map(Dose::Percent))?;
        let unit = match unit? {
            "%" => VolumeUnit::Percent,
            "cc" => VolumeUnit::Cc,
            _ => return None,
        };
        return Some(Metric::VolumeAt(dose, unit));
    }
    let of = name.strip_prefix('D')?;
    let percent = number(of, "%").filter(|p| *p <= 100.0).map(Volume::Percent);
    let volume = percent.or_else(|| number(of, "cc").map(Volume::Cc))?;
    dose_unit().map(|unit| Metric::DoseAt(volume, unit))
}

/// A number that is not negative, with this unit directly behind it.
fn number(text: &str, unit: &str) -> Option<f64> {
    let number = text.strip_suffix(unit)?;
    let plain = number.chars().all(|c| c.is_ascii_digit() || c == '.');
    number.parse().ok().filter(|n: &f64| plain && n.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 voxels of 0.1 cm3 with 1 to 100 Gy, prescribed 50 Gy.
    fn value(text: &str) -> Option<f64> {
        let doses: Vec<f64> = (1..=100).map(f64::from).collect();
        let dvh = Dvh::weighted(&doses, &[0.1; 100]).unwrap();
        let fall_off = FallOff { r50: 4.5, d2cm_gy: Some(40.0), first_cm_gy: None };
        let subject = Subject {
            dvh: Some(&dvh),
            prescribed_gy: 50.0,
            conformity: Some(0.8),
            fall_off: Some(&fall_off),
        };
        text.parse::<Metric>().unwrap().value(subject)
    }

    #[test]
    fn a_metric_is_the_number_that_its_name_says() {
        let near = |text: &str, expected: f64| {
            let found = value(text).unwrap();
            assert!((found - expected).abs() < 1e-9, "{text}: {found}");
        };
        near("V76Gy[%]", 25.0);
        near("V76Gy[cc]", 2.5);
        near("V100%[%]", 51.0);
        near("D0%[Gy]", 100.0);
        near("D100%[%]", 2.0);
        near("Mean[Gy]", 50.5);
        near("Mean[%]", 101.0);
        near("Paddick", 0.8);
        near("R50", 4.5);
        near("D2cm[%]", 80.0);
        assert_eq!((value("Entry[Gy]"), value("D10cc[Gy]")), (None, Some(1.0)));
    }

    #[test]
    fn what_is_no_metric_is_refused_with_examples() {
        for text in [
            "",
            "V",
            "V75",
            "V75Gy",
            "V75Gy[Gy]",
            "D95%",
            "D95%[cc]",
            "D101%[Gy]",
            "D-1%[Gy]",
            "Mean",
            "R50[%]",
            "V1e3Gy[%]",
            "D2cm",
            "VinfGy[%]",
            "V75 Gy[%]",
            "D95%[Gy",
            "PaddickX",
        ] {
            let fault = text.parse::<Metric>().unwrap_err().to_string();
            assert!(fault.contains("`V75Gy[%]`"), "{text}: {fault}");
        }
    }
}
