//! What can be wrong with measured data, and why no machine is fitted.

use thiserror::Error;

use crate::dose::{DoseError, MachineError};

/// A fault of a file, with its place.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{file}, line {line}: {fault}")]
pub struct MeasuredError {
    /// Name of the file.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub fault: MeasuredFault,
}

/// What is wrong in a file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeasuredFault {
    /// No reader knows the file.
    #[error(
        "this is not a file of measured doses: it must be a CSV table with the columns kind, field_x_mm, field_y_mm, ssd_mm, \
         depth_mm, off_mm, value, a W2CAD file (`$STOM`) or a PTW file (`BEGIN_SCAN_DATA`)"
    )]
    UnknownForm,
    /// It is not text.
    #[error("byte {byte} is not UTF-8 text: export the measurement as plain text")]
    NotText {
        /// The first such byte.
        byte: usize,
    },
    /// It is larger than any export of a water tank.
    #[error("the file has {bytes} bytes (allowed: {most}): give one export at a time")]
    Large {
        /// Its bytes.
        bytes: usize,
        /// The most.
        most: usize,
    },
    /// A field is not a number.
    #[error("{what} is `{text}`, which is not a finite number: correct it, or remove the line")]
    NotANumber {
        /// Name of the field.
        what: &'static str,
        /// Its text.
        text: String,
    },
    /// A number has a comma.
    #[error("{what} is `{text}`: numbers need a decimal point, not a comma; export with a point")]
    DecimalComma {
        /// Name of the field.
        what: &'static str,
        /// Its text.
        text: String,
    },
    /// A number is out of its range.
    #[error("{what} is {value} (allowed: {least} to {most}): check the unit, which is mm for lengths")]
    Range {
        /// Name of the quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The least.
        least: f64,
        /// The most.
        most: f64,
    },
    /// A line has another number of fields than the header.
    #[error(
        "the line has {found} fields, and the header {expected}: a decimal comma or a missing value makes such lines"
    )]
    Fields {
        /// Of the line.
        found: usize,
        /// Of the header.
        expected: usize,
    },
    /// A column is missing, unknown or there twice.
    #[error(
        "column `{column}` is {state} (columns: kind, field_x_mm, field_y_mm, ssd_mm, depth_mm, off_mm, value; energy_mv may be added)"
    )]
    Column {
        /// Name of the column.
        column: String,
        /// What is wrong with it.
        state: &'static str,
    },
    /// A word is not one of a list.
    #[error("{what} is `{text}` (allowed: {allowed})")]
    Word {
        /// Name of the field.
        what: &'static str,
        /// Its text.
        text: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// A block lacks an entry.
    #[error("the curve has no `{what}`: export it once more with all its settings")]
    Missing {
        /// Name of the entry.
        what: &'static str,
    },
    /// An entry or a mark is where none may be.
    #[error(
        "`{text}` is not allowed here: the block of a curve is open or closed at the wrong place, or the file is cut"
    )]
    Order {
        /// The line's text.
        text: String,
    },
    /// An entry of a block contradicts another one.
    #[error("{what} is {found}, but the header of the curve says {expected}: the export contradicts itself")]
    Contradiction {
        /// Name of the quantity.
        what: &'static str,
        /// In the data.
        found: f64,
        /// In the header.
        expected: f64,
    },
    /// The beam or the scan is of a kind that the fit cannot take.
    #[error("{what} is {found}: the fit takes {takes} only; remove this curve")]
    NotTaken {
        /// Name of the quantity.
        what: &'static str,
        /// What it is.
        found: String,
        /// What the fit takes.
        takes: &'static str,
    },
    /// Two points of a curve have one place.
    #[error("the curve has two values at {at} mm: remove one of them")]
    Duplicate {
        /// The place, mm.
        at: f64,
    },
    /// The places of a curve neither rise nor fall.
    #[error(
        "{at} mm comes after {before} mm, against the direction of the curve: sort the curve by its position"
    )]
    Unsorted {
        /// The place, mm.
        at: f64,
        /// The place before, mm.
        before: f64,
    },
    /// A curve begins twice.
    #[error("the curve began before at line {first}: put all its points together")]
    Interrupted {
        /// Line where it began first.
        first: usize,
    },
    /// A curve has too few points.
    #[error("the curve has {found} points (at least {least})")]
    Few {
        /// Its points.
        found: usize,
        /// The least.
        least: usize,
    },
    /// A curve does not go as far as it must.
    #[error(
        "{what} ends at {found:.1} mm (at least {least} mm): measure farther, or check the unit, which is mm"
    )]
    Short {
        /// Name of the curve's part.
        what: &'static str,
        /// Where it ends, mm.
        found: f64,
        /// Where it must end, mm.
        least: f64,
    },
    /// A curve does not have the shape that its kind must have.
    #[error(
        "{what} is {found:.1} mm (allowed: {least:.1} to {most:.1} mm): check the kind of the curve, its field and its unit"
    )]
    Shape {
        /// Name of the feature.
        what: &'static str,
        /// Where it is, mm.
        found: f64,
        /// The least, mm.
        least: f64,
        /// The most, mm.
        most: f64,
    },
    /// Files are of different energies.
    #[error("the energy is {found} MV, and {expected} MV in {other}: fit one energy at a time")]
    Energies {
        /// Of this file.
        found: f64,
        /// Of the other file.
        expected: f64,
        /// The other file.
        other: String,
    },
    /// A file has no curve.
    #[error("the file has no curve and no reading")]
    Empty,
}

/// Why no machine is fitted.
#[derive(Debug, Error)]
pub enum FitError {
    /// There is nothing to fit a spectrum to.
    #[error("there is no depth dose: a spectrum needs at least one, best in fields of 40 to 200 mm")]
    NoDepthDose,
    /// There is not enough to fit a spectrum to.
    #[error(
        "the depth dose of {curve} has {found} points from {from_mm:.0} mm on, where the fit begins (at least {least})"
    )]
    Few {
        /// The curve.
        curve: String,
        /// Its points there.
        found: usize,
        /// Where the fit begins, mm.
        from_mm: f64,
        /// The least.
        least: usize,
    },
    /// The machine to start from has another energy.
    #[error(
        "the measured beam has {found} MV and the machine to start from {start} MV: give a machine of that energy with \
         --start; `tools/research/kernels` makes its kernels"
    )]
    Energy {
        /// Of the data.
        found: f64,
        /// Of the machine.
        start: f64,
    },
    /// The spectrum that fits is too far from the kernels of the machine.
    #[error(
        "the mean energy that fits is {found:.2} MeV, and the kernels of the machine to start from serve {least:.2} to {most:.2} \
         MeV: give a machine with kernels of such a spectrum with --start (`tools/research/kernels` makes them), and check \
         the energy and the units of the data"
    )]
    Kernels {
        /// Mean energy at the surface, MeV.
        found: f64,
        /// The least, MeV.
        least: f64,
        /// The most, MeV.
        most: f64,
    },
    /// No file and no option states the energy.
    #[error(
        "no file states the energy of the beam: give its nominal energy with --energy, such as --energy 6MV"
    )]
    NoEnergy,
    /// A reading is in the build-up.
    #[error(
        "{file}, line {line}: the {what} is {found} mm deep, in the build-up, which is not modelled (at least {least:.1} mm, from \
         where depth doses count): state it at 100 mm"
    )]
    Shallow {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// What kind of reading it is.
        what: &'static str,
        /// Its depth, mm.
        found: f64,
        /// The least depth, mm.
        least: f64,
    },
    /// Monitor units have no place in the machine file.
    #[error(
        "the calibration cannot be stored: the machine to start from has no `collimator`, which holds the monitor units; add \
         one, or leave the calibration out"
    )]
    NoCollimator,
    /// Readings of the calibration contradict each other.
    #[error(
        "the calibrations of {file} contradict each other: {at_first} monitor units per weight by line {first}, and {at_second} \
         by line {second} (allowed: 2 % apart); check setups and units (Gy per monitor unit)"
    )]
    Calibrations {
        /// The file of the second.
        file: String,
        /// Line of the first reading.
        first: usize,
        /// Its monitor units.
        at_first: f64,
        /// Line of the second reading.
        second: usize,
        /// Its monitor units.
        at_second: f64,
    },
    /// A calibration is far from what such machines give.
    #[error(
        "{file}, line {line}: the calibration gives {found:.3} Gy per 100 monitor units at the reference point (allowed: 0.1 to \
         10): check that it is in Gy per monitor unit"
    )]
    CalibrationUnit {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// What it gives.
        found: f64,
    },
    /// Output factors have nothing to refer to.
    #[error(
        "{file}, line {line}: output factors refer to a field of 100 x 100 mm of the same distance and depth, and there is no \
         such reading: add it"
    )]
    NoReference {
        /// The file.
        file: String,
        /// The first such reading.
        line: usize,
    },
    /// The machine has no such geometry.
    #[error("{file}, line {line}: {fault}")]
    Geometry {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// What is wrong.
        fault: MeasuredFault,
    },
    /// The dose cannot be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// What was fitted is not a machine.
    #[error(transparent)]
    Machine(#[from] MachineError),
}
