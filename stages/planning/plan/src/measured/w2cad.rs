//! W2CAD: the ASCII form in which measurements go to Eclipse and in which many water tanks export.
//!
//! `$STOM` opens a curve and `$ENOM` closes it, `%NAME value` are its settings, and `<x y z dose>` its points: x and y of IEC
//! 61217 and the depth, mm. Lines with `#` are comments.

use super::curve::{Across, Curve, CurvePoint, Kind, Measured, Setup};
use super::error::{MeasuredError, MeasuredFault};
use super::number::number;

/// Farthest that a place may be from the line of its curve, mm.
const OFF_LINE_MM: f64 = 1.0;

/// A curve that is being read.
#[derive(Default)]
struct Block {
    line: usize,
    beam: Option<String>,
    kind: Option<String>,
    axis: Option<String>,
    field_mm: Option<[f64; 2]>,
    ssd_mm: Option<f64>,
    depth_mm: Option<f64>,
    points: Option<f64>,
    /// Places with their doses and lines.
    places: Vec<([f64; 3], f64, usize)>,
}

pub(super) fn read(name: &str, text: &str) -> Result<Measured, MeasuredError> {
    let at = |line: usize| move |fault| MeasuredError { file: name.to_owned(), line, fault };
    let order = |text: &str| MeasuredFault::Order { text: text.chars().take(40).collect() };
    let mut measured = Measured::default();
    let mut open: Option<Block> = None;
    let mut expected: Option<f64> = None;
    let mut last = 1;
    for (line, text) in text.lines().enumerate().map(|(i, text)| (i + 1, text.trim())) {
        last = line;
        let Some(mark) = text.chars().next() else { continue };
        let rest = text[mark.len_utf8()..].trim();
        match mark {
            '#' => {}
            '$' => {
                let mut words = rest.split_whitespace();
                match (words.next(), open.take()) {
                    (Some("NUMS"), None) => {
                        expected = Some(number("NUMS", words.next().unwrap_or_default()).map_err(at(line))?);
                    }
                    (Some("STOM"), None) => open = Some(Block { line, ..Block::default() }),
                    (Some("ENOM"), Some(block)) => measured.curves.push(block.curve(name)?),
                    (Some("ENOF"), None) => {}
                    _ => return Err(at(line)(order(text))),
                }
            }
            '%' => {
                let block = open.as_mut().ok_or_else(|| at(line)(order(text)))?;
                block.setting(rest).map_err(at(line))?;
            }
            '<' => {
                let block = open.as_mut().ok_or_else(|| at(line)(order(text)))?;
                let place = place(rest).map_err(at(line))?;
                block.places.push((place.0, place.1, line));
            }
            _ => return Err(at(line)(order(text))),
        }
    }
    if let Some(block) = open {
        return Err(at(block.line)(MeasuredFault::Missing { what: "$ENOM" }));
    }
    let found = measured.curves.len() as f64;
    match expected {
        Some(expected) if expected != found => {
            Err(at(last)(MeasuredFault::Contradiction { what: "the number of curves", found, expected }))
        }
        _ => Ok(measured),
    }
}

/// `x y z dose>`
fn place(text: &str) -> Result<([f64; 3], f64), MeasuredFault> {
    let inside = text.strip_suffix('>').ok_or(MeasuredFault::Missing { what: ">" })?;
    let fields: Vec<&str> = inside.split_whitespace().collect();
    let &[x, y, z, dose] = fields.as_slice() else {
        return Err(MeasuredFault::Fields { found: fields.len(), expected: 4 });
    };
    Ok(([number("x", x)?, number("y", y)?, number("z", z)?], number("the dose", dose)?))
}

impl Block {
    fn setting(&mut self, text: &str) -> Result<(), MeasuredFault> {
        let (key, value) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let value = value.trim();
        let word = || Some(value.to_ascii_uppercase());
        match key.to_ascii_uppercase().as_str() {
            "BMTY" => self.beam = word(),
            "TYPE" => self.kind = word(),
            "AXIS" => self.axis = word(),
            "SSD" => self.ssd_mm = Some(number("SSD", value)?),
            "DPTH" => self.depth_mm = Some(number("DPTH", value)?),
            "PNTS" => self.points = Some(number("PNTS", value)?),
            "FLSZ" => {
                let (x, y) = value.split_once('*').ok_or(MeasuredFault::Word {
                    what: "FLSZ",
                    text: value.chars().take(40).collect(),
                    allowed: "two sides in mm with * between them",
                })?;
                self.field_mm = Some([number("FLSZ", x)?, number("FLSZ", y)?]);
            }
            "WDGL" | "WDGD" => {
                let (what, takes) = ("the wedge", "open fields");
                return Err(MeasuredFault::NotTaken { what, found: value.chars().take(40).collect(), takes });
            }
            // Version, date, detector and steps have no part in the fit.
            _ => {}
        }
        Ok(())
    }

    fn curve(self, name: &str) -> Result<Curve, MeasuredError> {
        let line = self.line;
        let at = |line: usize, fault| MeasuredError { file: name.to_owned(), line, fault };
        let (kind, setup) = self.settings().map_err(|fault| at(line, fault))?;
        let mut points = Vec::with_capacity(self.places.len());
        for (place, value, line) in &self.places {
            let (along, others) = match kind {
                Kind::DepthDose => (2, [(0, 0.0), (1, 0.0)]),
                Kind::Profile { across: Across::X, depth_mm } => (0, [(1, 0.0), (2, depth_mm)]),
                Kind::Profile { across: Across::Y, depth_mm } => (1, [(0, 0.0), (2, depth_mm)]),
            };
            for (axis, expected) in others {
                let found = place[axis];
                if (found - expected).abs() > OFF_LINE_MM {
                    let what = ["x of a point, mm,", "y of a point, mm,", "the depth of a point, mm,"][axis];
                    return Err(at(*line, MeasuredFault::Contradiction { what, found, expected }));
                }
            }
            points.push(CurvePoint { at_mm: place[along], value: *value, line: *line });
        }
        Curve::new(kind, setup, points, name, line)
    }

    fn settings(&self) -> Result<(Kind, Setup), MeasuredFault> {
        let missing = |what| MeasuredFault::Missing { what };
        if let Some(beam) = self.beam.as_deref().filter(|beam| *beam != "PHO") {
            let found = beam.chars().take(40).collect();
            return Err(MeasuredFault::NotTaken { what: "BMTY", found, takes: "photons (PHO)" });
        }
        self.beam.as_ref().ok_or(missing("%BMTY"))?;
        let found = self.places.len() as f64;
        if let Some(expected) = self.points.filter(|expected| *expected != found) {
            return Err(MeasuredFault::Contradiction { what: "the number of points", found, expected });
        }
        let field_mm = self.field_mm.ok_or(missing("%FLSZ"))?;
        let setup = Setup { field_mm, ssd_mm: self.ssd_mm.ok_or(missing("%SSD"))? };
        let axis = self.axis.as_deref().unwrap_or_default();
        let kind = match (self.kind.as_deref().ok_or(missing("%TYPE"))?, axis) {
            ("OPD", "" | "Z") => Kind::DepthDose,
            ("OPP", "X" | "Y") => Kind::Profile {
                across: if axis == "X" { Across::X } else { Across::Y },
                depth_mm: self.depth_mm.ok_or(missing("%DPTH"))?,
            },
            (kind, axis) => {
                let found = format!("{kind} along {axis}").chars().take(40).collect();
                let takes = "open depth doses (OPD along Z) and profiles (OPP along X or Y)";
                return Err(MeasuredFault::NotTaken { what: "the curve", found, takes });
            }
        };
        Ok((kind, setup))
    }
}
