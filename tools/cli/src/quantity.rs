//! Numbers with units on the command line.

use crate::exit::Failure;

/// Parses the value of `--name`, which has this unit and lies between bounds.
pub fn within(name: &str, given: &str, unit: &str, [least, most]: [f64; 2]) -> Result<f64, Failure> {
    let value = quantity(given, unit, &format!("--{name} {given}"))?;
    match (least..=most).contains(&value) {
        true => Ok(value),
        false => Err(Failure::wrong(format!("--{name} {given}: give {least} {unit} to {most} {unit}"))),
    }
}

/// Parses a number with this unit; `whole` is the argument that contains it, for the error.
pub fn quantity(part: &str, unit: &str, whole: &str) -> Result<f64, Failure> {
    let number = part.trim().strip_suffix(unit).and_then(|n| n.trim().parse::<f64>().ok());
    number
        .filter(|n| n.is_finite())
        .ok_or_else(|| Failure::wrong(format!("{whole:?}: {part:?} must be a number with its unit, {unit}")))
}

/// Parses a length in mm, with or without the unit.
pub fn millimetres(part: &str, whole: &str) -> Result<f64, Failure> {
    let part = part.trim();
    let with_unit = if part.ends_with("mm") { part.to_owned() } else { format!("{part}mm") };
    quantity(&with_unit, "mm", whole)
}
