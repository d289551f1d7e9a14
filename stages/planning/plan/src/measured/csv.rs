//! The table of stillpoint: one value to a line.
//!
//! ```text
//! kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value
//! depth_dose,100,100,1000,5,0,93.1
//! profile_x,100,100,900,100,-60,10.4
//! output,200,200,900,100,0,1.041
//! calibration,100,100,900,100,0,0.0083
//! ```

use super::curve::{Across, Curve, CurvePoint, Kind, Measured, Reading, Setup, in_range};
use super::error::{MeasuredError, MeasuredFault};
use super::number::number;

const COLUMNS: [&str; 7] = ["kind", "field_x_mm", "field_y_mm", "ssd_mm", "depth_mm", "off_mm", "value"];
/// A column that may be added.
const ENERGY: &str = "energy_mv";

/// Most curves of a table.
const MOST_CURVES: f64 = 1000.0;

/// What a line is part of.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Curve(Kind),
    Output,
    Calibration,
}

struct Row {
    part: Part,
    setup: Setup,
    depth_mm: f64,
    point: CurvePoint,
    energy_mv: Option<f64>,
}

/// The lines of one curve.
struct Group {
    kind: Kind,
    setup: Setup,
    points: Vec<CurvePoint>,
    line: usize,
}

pub(super) fn read(name: &str, text: &str) -> Result<Measured, MeasuredError> {
    let at = |line: usize| move |fault| MeasuredError { file: name.to_owned(), line, fault };
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (first, header) = lines.next().ok_or_else(|| at(1)(MeasuredFault::Empty))?;
    let separator = [';', '\t', ','].into_iter().find(|c| header.contains(*c)).unwrap_or(',');
    let columns = Columns::new(header, separator).map_err(at(first))?;

    let mut measured = Measured::default();
    let mut groups: Vec<Group> = Vec::new();
    let mut is_open = false;
    for (line, text) in lines {
        let row = columns.row(text, line).map_err(at(line))?;
        if let Some(energy_mv) = row.energy_mv {
            measured.set_energy(energy_mv, name, line)?;
        }
        match row.part {
            Part::Curve(kind) => {
                let is_same = |group: &Group| group.kind == kind && group.setup == row.setup;
                match groups.last_mut() {
                    Some(last) if is_open && is_same(last) => last.points.push(row.point),
                    _ => {
                        if let Some(first) = groups.iter().find(|group| is_same(group)) {
                            return Err(at(line)(MeasuredFault::Interrupted { first: first.line }));
                        }
                        groups.push(Group { kind, setup: row.setup, points: vec![row.point], line });
                        in_range("the number of curves", groups.len() as f64, [1.0, MOST_CURVES])
                            .map_err(at(line))?;
                    }
                }
                is_open = true;
            }
            Part::Output | Part::Calibration => {
                is_open = false;
                let reading = Reading {
                    setup: row.setup,
                    depth_mm: row.depth_mm,
                    value: row.point.value,
                    file: name.to_owned(),
                    line,
                }
                .check()?;
                let readings =
                    if row.part == Part::Output { &mut measured.outputs } else { &mut measured.calibrations };
                readings.push(reading);
            }
        }
    }
    for group in groups {
        measured.curves.push(Curve::new(group.kind, group.setup, group.points, name, group.line)?);
    }
    Ok(measured)
}

/// Where each column is.
struct Columns {
    separator: char,
    count: usize,
    places: [usize; COLUMNS.len()],
    energy: Option<usize>,
}

impl Columns {
    fn new(header: &str, separator: char) -> Result<Self, MeasuredFault> {
        let names: Vec<String> =
            header.split(separator).map(|name| name.trim().trim_matches('"').to_ascii_lowercase()).collect();
        let fault =
            |column: &str, state| MeasuredFault::Column { column: column.chars().take(40).collect(), state };
        if !names.iter().any(|name| name == "kind") {
            return Err(MeasuredFault::UnknownForm);
        }
        for (place, name) in names.iter().enumerate() {
            if !COLUMNS.contains(&name.as_str()) && name != ENERGY {
                return Err(fault(name, "not known"));
            }
            if names[..place].contains(name) {
                return Err(fault(name, "there twice"));
            }
        }
        let mut places = [0; COLUMNS.len()];
        for (place, column) in places.iter_mut().zip(COLUMNS) {
            *place = names.iter().position(|name| name == column).ok_or_else(|| fault(column, "missing"))?;
        }
        let energy = names.iter().position(|name| name == ENERGY);
        Ok(Self { separator, count: names.len(), places, energy })
    }

    fn row(&self, text: &str, line: usize) -> Result<Row, MeasuredFault> {
        let fields: Vec<&str> = text.split(self.separator).map(str::trim).collect();
        if fields.len() != self.count {
            return Err(MeasuredFault::Fields { found: fields.len(), expected: self.count });
        }
        let get = |column: usize| number(COLUMNS[column], fields[self.places[column]]);
        let (depth_mm, off_mm, value) = (get(4)?, get(5)?, get(6)?);
        let setup = Setup { field_mm: [get(1)?, get(2)?], ssd_mm: get(3)? };
        let profile = |across| (Part::Curve(Kind::Profile { across, depth_mm }), off_mm);
        let kind = fields[self.places[0]].trim_matches('"');
        let (part, at_mm) = match kind {
            "depth_dose" => (Part::Curve(Kind::DepthDose), depth_mm),
            "profile_x" => profile(Across::X),
            "profile_y" => profile(Across::Y),
            "output" => (Part::Output, off_mm),
            "calibration" => (Part::Calibration, off_mm),
            _ => {
                let allowed = "depth_dose, profile_x, profile_y, output, calibration";
                return Err(MeasuredFault::Word {
                    what: "kind",
                    text: kind.chars().take(40).collect(),
                    allowed,
                });
            }
        };
        let is_profile = matches!(part, Part::Curve(Kind::Profile { .. }));
        if !is_profile && off_mm != 0.0 {
            let takes = "places on the axis, with off_mm 0,";
            return Err(MeasuredFault::NotTaken { what: "off_mm", found: off_mm.to_string(), takes });
        }
        let energy_mv = match self.energy {
            Some(place) => Some(number(ENERGY, fields[place])?),
            None => None,
        };
        Ok(Row { part, setup, depth_mm, point: CurvePoint { at_mm, value, line }, energy_mv })
    }
}
