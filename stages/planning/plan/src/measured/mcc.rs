//! The text form of PTW's MEPHYSTO (`mcc`).
//!
//! `BEGIN_SCAN n` opens a curve, `NAME=value` are its settings, and the lines between `BEGIN_DATA` and `END_DATA` its points:
//! the place in mm, the corrected value, and often that of the reference detector, which is not read further.

use std::collections::BTreeMap;

use super::curve::{Across, Curve, CurvePoint, Kind, Measured, Setup};
use super::error::{MeasuredError, MeasuredFault};
use super::number::number;

/// Settings that must be zero, if they are there.
const ZERO: [(&str, &str); 6] = [
    ("WEDGE_ANGLE", "open fields"),
    ("COLL_OFFSET_INPLANE", "centred fields"),
    ("COLL_OFFSET_CROSSPLANE", "centred fields"),
    ("SCAN_OFFAXIS_INPLANE", "scans through the axis"),
    ("SCAN_OFFAXIS_CROSSPLANE", "scans through the axis"),
    ("BLOCK", "open fields"),
];

/// Where a line is.
enum Place {
    Outside,
    Settings,
    Data,
    AfterData,
}

/// A curve that is being read.
#[derive(Default)]
struct Block<'a> {
    line: usize,
    /// By name: the value and its line.
    settings: BTreeMap<&'a str, (&'a str, usize)>,
    points: Vec<CurvePoint>,
}

pub(super) fn read(name: &str, text: &str) -> Result<Measured, MeasuredError> {
    let at = |line: usize| move |fault| MeasuredError { file: name.to_owned(), line, fault };
    let mut measured = Measured::default();
    let mut block = Block::default();
    let mut place = Place::Outside;
    for (line, text) in text.lines().enumerate().map(|(i, text)| (i + 1, text.trim())) {
        let is_scan = |mark: &str| text.strip_prefix(mark).is_some_and(|rest| rest.starts_with([' ', '\t']));
        place = match place {
            // The file's own settings are outside of the curves.
            Place::Outside if is_scan("BEGIN_SCAN") => {
                block = Block { line, ..Block::default() };
                Place::Settings
            }
            Place::Outside if !text.starts_with("END_SCAN ") && !text.starts_with("BEGIN_DATA") => {
                Place::Outside
            }
            Place::Settings if text == "BEGIN_DATA" => Place::Data,
            Place::Settings if text.is_empty() => Place::Settings,
            Place::Settings => {
                let (key, value) = text.split_once('=').ok_or_else(|| {
                    at(line)(MeasuredFault::Order { text: text.chars().take(40).collect() })
                })?;
                block.settings.insert(key.trim(), (value.trim(), line));
                Place::Settings
            }
            Place::Data if text == "END_DATA" => Place::AfterData,
            Place::Data if text.is_empty() => Place::Data,
            Place::Data => {
                block.points.push(point(text, line).map_err(at(line))?);
                Place::Data
            }
            Place::AfterData if is_scan("END_SCAN") => {
                let block = std::mem::take(&mut block);
                if let Some((energy_mv, line)) = block.number("ENERGY", name)? {
                    measured.set_energy(energy_mv, name, line)?;
                }
                measured.curves.push(block.curve(name)?);
                Place::Outside
            }
            Place::AfterData if text.is_empty() => Place::AfterData,
            Place::Outside | Place::AfterData => {
                return Err(at(line)(MeasuredFault::Order { text: text.chars().take(40).collect() }));
            }
        };
    }
    match place {
        Place::Outside => Ok(measured),
        Place::Settings => Err(at(block.line)(MeasuredFault::Missing { what: "BEGIN_DATA" })),
        Place::Data => Err(at(block.line)(MeasuredFault::Missing { what: "END_DATA" })),
        Place::AfterData => Err(at(block.line)(MeasuredFault::Missing { what: "END_SCAN" })),
    }
}

/// Place, value and perhaps that of the reference.
fn point(text: &str, line: usize) -> Result<CurvePoint, MeasuredFault> {
    let fields: Vec<&str> = text.split_whitespace().collect();
    let (&[at, value] | &[at, value, _]) = fields.as_slice() else {
        return Err(MeasuredFault::Fields { found: fields.len(), expected: 3 });
    };
    if let Some(reference) = fields.get(2) {
        number("the value of the reference", reference)?;
    }
    Ok(CurvePoint { at_mm: number("the place", at)?, value: number("the value", value)?, line })
}

impl Block<'_> {
    /// A setting that is a number, with its line.
    fn number(&self, key: &'static str, file: &str) -> Result<Option<(f64, usize)>, MeasuredError> {
        let Some((value, line)) = self.settings.get(key) else { return Ok(None) };
        let value = number(key, value).map_err(|fault| MeasuredError {
            file: file.to_owned(),
            line: *line,
            fault,
        })?;
        Ok(Some((value, *line)))
    }

    fn curve(self, name: &str) -> Result<Curve, MeasuredError> {
        let at = |line: usize, fault| MeasuredError { file: name.to_owned(), line, fault };
        let required = |key: &'static str| {
            let value = self.number(key, name)?;
            value.ok_or_else(|| at(self.line, MeasuredFault::Missing { what: key }))
        };
        let not_taken = |what, found: &str, line, takes| {
            at(line, MeasuredFault::NotTaken { what, found: found.chars().take(40).collect(), takes })
        };
        for (key, allowed, takes) in [
            ("MODALITY", "X", "photons (X)"),
            ("MEAS_MEDIUM", "WATER", "scans in water"),
            ("SCAN_DIAGONAL", "NOT_DIAGONAL", "scans along x and y"),
            ("FIELD_TYPE", "RECTANGULAR", "rectangular fields"),
        ] {
            if let Some((found, line)) = self.settings.get(key).filter(|(found, _)| *found != allowed) {
                return Err(not_taken(key, found, *line, takes));
            }
        }
        for (key, takes) in ZERO {
            if let Some((value, line)) = self.number(key, name)?
                && value != 0.0
            {
                return Err(not_taken(key, &value.to_string(), line, takes));
            }
        }
        let (crossplane, inplane) = (required("FIELD_CROSSPLANE")?.0, required("FIELD_INPLANE")?.0);
        let setup = Setup { field_mm: [crossplane, inplane], ssd_mm: required("SSD")?.0 };
        // At quarter turns of the collimator the sides of a field change places.
        if let Some((turn, line)) = self.number("COLL_ANGLE", name)?
            && turn.rem_euclid(if crossplane == inplane { 90.0 } else { 180.0 }) != 0.0
        {
            let takes = "half turns of the collimator, and quarter turns with square fields,";
            return Err(not_taken("COLL_ANGLE", &turn.to_string(), line, takes));
        }
        let missing = || at(self.line, MeasuredFault::Missing { what: "SCAN_CURVETYPE" });
        let (kind, line) = *self.settings.get("SCAN_CURVETYPE").ok_or_else(missing)?;
        let profile = |across| Ok(Kind::Profile { across, depth_mm: required("SCAN_DEPTH")?.0 });
        let kind = match kind {
            "PDD" => Kind::DepthDose,
            "CROSSPLANE_PROFILE" => profile(Across::X)?,
            "INPLANE_PROFILE" => profile(Across::Y)?,
            other => {
                let takes = "PDD, CROSSPLANE_PROFILE and INPLANE_PROFILE";
                return Err(not_taken("SCAN_CURVETYPE", other, line, takes));
            }
        };
        Curve::new(kind, setup, self.points.clone(), name, self.line)
    }
}
