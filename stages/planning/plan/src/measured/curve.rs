//! Curves and readings of a water tank, with the checks that hold for every file.

use serde::Serialize;

use super::error::{MeasuredError, MeasuredFault};

/// Deepest place, mm.
const DEEPEST_MM: f64 = 400.0;
/// Highest place above the surface, mm: scans begin in air.
const ABOVE_MM: f64 = 50.0;
/// Farthest place from the axis, mm.
const FARTHEST_MM: f64 = 400.0;
/// Fewest points of a curve.
const POINTS: usize = 12;
/// Depth that a depth dose must reach, mm.
const REACH_MM: f64 = 150.0;
/// Where the maximum of a depth dose may be, mm.
const MAXIMUM_MM: [f64; 2] = [2.0, 60.0];
/// Farthest that the middle of a profile may be from the axis, mm.
const OFF_CENTRE_MM: f64 = 3.0;
/// Energies of photon beams, MV.
const ENERGIES_MV: [f64; 2] = [1.0, 50.0];

/// A field on a water tank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Setup {
    /// Sides on the isocentre plane along x and y of IEC 61217 (collimator at 0 degrees), mm.
    pub field_mm: [f64; 2],
    /// From the source to the surface, mm.
    pub ssd_mm: f64,
}

/// The axis of a profile, of IEC 61217 with the collimator at 0 degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Across {
    /// Crossplane.
    X,
    /// Inplane.
    Y,
}

/// What a curve runs along.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Kind {
    /// Along the axis of the beam.
    DepthDose,
    /// Across it.
    Profile {
        /// The axis.
        across: Across,
        /// Depth below the surface, mm.
        depth_mm: f64,
    },
}

/// A measured value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Depth of a depth dose, or distance from the axis of a profile, mm.
    pub at_mm: f64,
    /// Relative dose: only ratios within a curve count.
    pub value: f64,
    /// Line of the file.
    #[serde(skip)]
    pub line: usize,
}

/// A depth dose or a profile: relative, by rising place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// What it runs along.
    #[serde(flatten)]
    pub kind: Kind,
    /// Field and distance.
    pub setup: Setup,
    /// Its points, by rising place.
    pub points: Vec<CurvePoint>,
    /// Name of the file.
    pub file: String,
    /// Line where it begins.
    pub line: usize,
}

/// A dose at one place on the axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// Field and distance.
    pub setup: Setup,
    /// Depth below the surface, mm.
    pub depth_mm: f64,
    /// An output factor, or a dose in Gy per monitor unit.
    pub value: f64,
    /// Name of the file.
    pub file: String,
    /// Line of the file.
    pub line: usize,
}

/// All that was measured of a beam.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Depth doses and profiles.
    pub curves: Vec<Curve>,
    /// Output factors: dose per monitor unit, relative to a field of 100 x 100 mm at the same distance and depth.
    pub outputs: Vec<Reading>,
    /// Dose in Gy per monitor unit.
    pub calibrations: Vec<Reading>,
    /// Nominal energy in MV, and the file that has it.
    pub energy_mv: Option<(f64, String)>,
}

impl Measured {
    /// States the nominal energy, MV, for files that do not. A file that is added later must agree.
    ///
    /// # Errors
    /// It is not the energy of a photon beam, or another one than that of a file.
    pub fn state_energy(&mut self, energy_mv: f64, option: &str) -> Result<(), MeasuredError> {
        self.set_energy(energy_mv, option, 1)
    }

    /// Adds what another file has.
    ///
    /// # Errors
    /// The files are of different energies.
    pub fn add(&mut self, other: Self) -> Result<(), MeasuredError> {
        if let Some((energy_mv, file)) = other.energy_mv {
            self.set_energy(energy_mv, &file, 1)?;
        }
        self.curves.extend(other.curves);
        self.outputs.extend(other.outputs);
        self.calibrations.extend(other.calibrations);
        Ok(())
    }

    /// States the nominal energy.
    pub(super) fn set_energy(
        &mut self,
        energy_mv: f64,
        file: &str,
        line: usize,
    ) -> Result<(), MeasuredError> {
        let at = |fault| MeasuredError { file: file.to_owned(), line, fault };
        in_range("the energy", energy_mv, ENERGIES_MV).map_err(at)?;
        match &self.energy_mv {
            None => self.energy_mv = Some((energy_mv, file.to_owned())),
            Some((expected, _)) if (expected - energy_mv).abs() < 1e-6 => {}
            Some((expected, other)) => {
                return Err(at(MeasuredFault::Energies {
                    found: energy_mv,
                    expected: *expected,
                    other: other.clone(),
                }));
            }
        }
        Ok(())
    }
}

pub(super) fn in_range(what: &'static str, value: f64, [least, most]: [f64; 2]) -> Result<(), MeasuredFault> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(MeasuredFault::Range { what, value, least, most })
    }
}

impl Setup {
    pub(super) fn check(&self) -> Result<(), MeasuredFault> {
        for side in self.field_mm {
            in_range("the side of the field", side, [5.0, 400.0])?;
        }
        in_range("the distance from the source to the surface", self.ssd_mm, [500.0, 3000.0])
    }
}

impl Reading {
    /// A reading whose numbers are possible.
    pub(super) fn check(self) -> Result<Self, MeasuredError> {
        let fault = self
            .setup
            .check()
            .and_then(|()| in_range("the depth", self.depth_mm, [0.0, DEEPEST_MM]))
            .and_then(|()| in_range("the value", self.value, [1e-9, 1e6]));
        match fault {
            Ok(()) => Ok(self),
            Err(fault) => Err(MeasuredError { file: self.file, line: self.line, fault }),
        }
    }
}

impl Curve {
    /// A curve from its points in the order of the file: sorted, and checked for the shape that its kind must have. Points
    /// above the surface are left out.
    pub(super) fn new(
        kind: Kind,
        setup: Setup,
        mut points: Vec<CurvePoint>,
        file: &str,
        line: usize,
    ) -> Result<Self, MeasuredError> {
        let at = |(line, fault)| MeasuredError { file: file.to_owned(), line, fault };
        setup.check().map_err(|fault| at((line, fault)))?;
        sort(&mut points).map_err(at)?;
        let range = match kind {
            Kind::DepthDose => [-ABOVE_MM, DEEPEST_MM],
            Kind::Profile { depth_mm, .. } => {
                in_range("the depth", depth_mm, [0.0, DEEPEST_MM]).map_err(|fault| at((line, fault)))?;
                [-FARTHEST_MM, FARTHEST_MM]
            }
        };
        for point in &points {
            in_range("the place", point.at_mm, range)
                .and_then(|()| in_range("the dose", point.value, [0.0, 1e12]))
                .map_err(|fault| at((point.line, fault)))?;
        }
        if kind == Kind::DepthDose {
            points.retain(|point| point.at_mm >= 0.0);
        }
        let curve = Self { kind, setup, points, file: file.to_owned(), line };
        curve.shape().map_err(|fault| at((line, fault)))?;
        Ok(curve)
    }

    /// Whether the points can be what their kind says.
    fn shape(&self) -> Result<(), MeasuredFault> {
        let found = self.points.len();
        if found < POINTS {
            return Err(MeasuredFault::Few { found, least: POINTS });
        }
        match self.kind {
            Kind::DepthDose => {
                let last = self.points[found - 1].at_mm;
                if last < REACH_MM {
                    return Err(MeasuredFault::Short {
                        what: "the depth dose",
                        found: last,
                        least: REACH_MM,
                    });
                }
                let [least, most] = MAXIMUM_MM;
                let at = self.greatest().at_mm;
                if !(least..=most).contains(&at) {
                    let what = "the depth of the maximum";
                    return Err(MeasuredFault::Shape { what, found: at, least, most });
                }
                Ok(())
            }
            Kind::Profile { .. } => {
                let [left, right] = self.edges()?;
                let expected = self.width_mm();
                let (least, most) = (0.93 * expected - 2.0, 1.07 * expected + 2.0);
                if !(least..=most).contains(&(right - left)) {
                    let what = "the width at half of the dose on the axis";
                    return Err(MeasuredFault::Shape { what, found: right - left, least, most });
                }
                let centre = 0.5 * (left + right);
                if centre.abs() > OFF_CENTRE_MM {
                    let (what, most) = ("the middle of the profile", OFF_CENTRE_MM);
                    return Err(MeasuredFault::Shape { what, found: centre, least: -most, most });
                }
                Ok(())
            }
        }
    }

    /// The point of the greatest dose; the first of several.
    pub fn greatest(&self) -> CurvePoint {
        let better =
            |best: CurvePoint, point: &CurvePoint| if point.value > best.value { *point } else { best };
        self.points.iter().fold(self.points[0], better)
    }

    /// Nominal width of a profile's field at its depth, for a source at 1000 mm from the isocentre, mm.
    fn width_mm(&self) -> f64 {
        let Kind::Profile { across, depth_mm } = self.kind else { return 0.0 };
        let side = self.setup.field_mm[if across == Across::X { 0 } else { 1 }];
        side * (self.setup.ssd_mm + depth_mm) / 1000.0
    }

    /// Dose on the axis of a profile: linear between its points.
    pub fn on_axis(&self) -> f64 {
        self.value_at(0.0).unwrap_or(0.0)
    }

    /// Linear between the points; `None` beyond them.
    pub fn value_at(&self, at_mm: f64) -> Option<f64> {
        let after = self.points.partition_point(|point| point.at_mm < at_mm);
        let b = self.points.get(after)?;
        if b.at_mm == at_mm {
            return Some(b.value);
        }
        let a = self.points.get(after.checked_sub(1)?)?;
        Some(a.value + (b.value - a.value) * (at_mm - a.at_mm) / (b.at_mm - a.at_mm))
    }

    /// Where a profile has half of the dose on the axis, left and right, mm.
    ///
    /// # Errors
    /// A side does not fall that far.
    pub fn edges(&self) -> Result<[f64; 2], MeasuredFault> {
        self.crossings(0.5)
    }

    /// Where a profile has a part of the dose on the axis, left and right, mm: the places nearest to the axis.
    pub(super) fn crossings(&self, part: f64) -> Result<[f64; 2], MeasuredFault> {
        let level = part * self.on_axis();
        let cross = |a: &CurvePoint, b: &CurvePoint| {
            (a.value > level && b.value <= level)
                .then(|| a.at_mm + (b.at_mm - a.at_mm) * (a.value - level) / (a.value - b.value))
        };
        let middle = self.points.partition_point(|point| point.at_mm < 0.0);
        let right =
            self.points[middle.saturating_sub(1)..].windows(2).find_map(|two| cross(&two[0], &two[1]));
        let left = self.points[..(middle + 1).min(self.points.len())]
            .windows(2)
            .rev()
            .find_map(|two| cross(&two[1], &two[0]));
        match (left, right) {
            (Some(left), Some(right)) => Ok([left, right]),
            _ => {
                let ends = [self.points[0].at_mm, self.points[self.points.len() - 1].at_mm];
                let found = if left.is_none() { -ends[0] } else { ends[1] };
                let what = "a side of the profile does not fall to half of the dose on the axis; it";
                Err(MeasuredFault::Short { what, found, least: 0.5 * self.width_mm() })
            }
        }
    }
}

impl std::fmt::Display for Curve {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.setup.field_mm;
        match self.kind {
            Kind::DepthDose => write!(f, "depth dose, {x} x {y} mm, surface at {} mm", self.setup.ssd_mm),
            Kind::Profile { across, depth_mm } => {
                let across = if across == Across::X { "x" } else { "y" };
                write!(
                    f,
                    "profile along {across}, {x} x {y} mm, {depth_mm} mm deep, surface at {} mm",
                    self.setup.ssd_mm
                )
            }
        }
    }
}

/// Brings points to rising places. Scans may fall, but not turn.
fn sort(points: &mut [CurvePoint]) -> Result<(), (usize, MeasuredFault)> {
    if points.first().zip(points.last()).is_some_and(|(first, last)| first.at_mm > last.at_mm) {
        points.reverse();
    }
    match points.windows(2).find(|two| two[0].at_mm >= two[1].at_mm) {
        None => Ok(()),
        Some(two) if two[0].at_mm == two[1].at_mm => {
            Err((two[0].line.max(two[1].line), MeasuredFault::Duplicate { at: two[0].at_mm }))
        }
        Some(two) => {
            let (first, second) = if two[0].line < two[1].line { (two[0], two[1]) } else { (two[1], two[0]) };
            Err((second.line, MeasuredFault::Unsorted { at: second.at_mm, before: first.at_mm }))
        }
    }
}
