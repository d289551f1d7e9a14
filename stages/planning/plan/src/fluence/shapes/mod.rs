//! The shapes of objectives, one to a file, and the one table that registers them.
//!
//! A file holds the text form of a shape (`Spec`), the shape in gray, its cost, and what it adds to a problem. A further
//! shape is a further file and a further line of the table below; the tests of every shape then hold for it, too. The names
//! in a table of objectives are those of the variants in lower case. `texts` are text forms that another shape serves.

use serde::{Deserialize, Serialize};

use super::aim::Aim;
use super::dvh::DvhTerm;
use super::goals::GoalsError;
use super::problem::{Side, Term};
use super::region::RegionTerm;
use super::rows::Csr;
use super::text::Dose;
use crate::metrics::Dvh;

/// Makes the enums of text forms and of shapes from the table.
macro_rules! table {
    (
        shapes { $($file:ident => $name:ident,)* }
        texts { $($text_file:ident => $text_name:ident,)* }
    ) => {
        $(mod $file; pub use $file::$name;)*
        $(mod $text_file;)*

        /// An objective as a table of objectives writes it: `{"overdose": {"dose": "35 Gy", "weight": 20}}`.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum ObjectiveSpec {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($file::Spec),)*
            $(#[doc = concat!("See `", stringify!($text_file), "`.")] $text_name($text_file::Spec),)*
        }

        /// One objective of a structure of volume `v`; sums are over its voxels, each by its volume. Doses are in gray; an
        /// objective costs nothing where it is fulfilled.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum Objective {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name),)*
        }

        $(impl From<$name> for Objective {
            fn from(shape: $name) -> Self {
                Self::$name(shape)
            }
        })*

        impl Objective {
            /// Its weight.
            pub fn weight(&self) -> f64 {
                match self { $(Self::$name(shape) => shape.weight,)* }
            }

            /// The same with its weight times `factor`.
            #[must_use]
            pub fn scaled(mut self, factor: f64) -> Self {
                match &mut self { $(Self::$name(shape) => shape.weight *= factor,)* }
                self
            }

            fn shape(&self) -> &dyn Shape {
                match self { $(Self::$name(shape) => shape,)* }
            }
        }

        impl ObjectiveSpec {
            /// The text forms of every shape, by its name: at least one of each.
            pub const EXAMPLES: &[(&'static str, &[&'static str])] = &[
                $((stringify!($file), $file::EXAMPLES),)*
                $((stringify!($text_file), $text_file::EXAMPLES),)*
            ];

            fn spec(&self) -> &dyn Spec {
                match self {
                    $(Self::$name(spec) => spec,)*
                    $(Self::$text_name(spec) => spec,)*
                }
            }
        }
    };
}

table! {
    shapes {
        overdose => Overdose,
        fall_off => FallOff,
        underdose => Underdose,
        mean_dose => MeanDose,
        homogeneity => Homogeneity,
        dvh_at_most => DvhAtMost,
        dvh_at_least => DvhAtLeast,
        mean_at_least => MeanAtLeast,
        dvh_point => DvhPoint,
        geud => Geud,
    }
    texts {
        entry => Entry,
    }
}

/// What a file says of its shape.
trait Shape {
    /// Refuses numbers out of their range; the weight is checked for all shapes alike.
    fn check(&self) -> Result<(), BadNumber>;
    /// Its cost at these doses.
    fn cost(&self, at: &Doses<'_>) -> f64;
    /// Adds its terms on a region to a problem: they give its slope and curvature.
    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>);
    /// What the dose is like where it is fulfilled.
    fn aim(&self) -> Aim;
    /// The dose above which it costs, Gy, if it limits the dose of the structure: what the structure tolerates.
    fn tolerated_gy(&self) -> Option<f64>;
    /// What a dose gives of the one quantity that it bounds; nothing where it bounds no single quantity.
    fn measure(&self, dvh: &Dvh) -> Option<Measured>;
    /// Whether it needs the distance of each voxel to the targets.
    fn needs_distances(&self) -> bool {
        false
    }
}

/// What a file says of the text form of its shape.
trait Spec {
    /// The doses that it names.
    fn doses(&self) -> Vec<Dose>;
    /// The shape, with these doses in gray.
    fn resolve(&self, gray: &dyn Fn(Dose) -> f64) -> Objective;
    /// The part of the structure that it holds for.
    fn part(&self) -> StructurePart {
        StructurePart::Own
    }
}

/// The part of a structure that an objective holds for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StructurePart {
    /// Points that no structure of a higher priority has.
    Own,
    /// All points outside the targets.
    OutsideTargets,
    /// All points outside the targets and within so many millimetres of the skin.
    Skin(f64),
}

/// A number of an objective is out of its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadNumber {
    what: &'static str,
    value: f64,
    range: &'static str,
}

impl BadNumber {
    /// Refuses a value that does not fit.
    fn unless(fits: bool, what: &'static str, value: f64, range: &'static str) -> Result<(), Self> {
        if fits { Ok(()) } else { Err(Self { what, value, range }) }
    }

    fn unless_dose(gray: f64) -> Result<(), Self> {
        Self::unless(gray.is_finite() && gray >= 0.0, "a dose", gray, "a finite number of gray, not negative")
    }

    fn unless_volume(volume: f64) -> Result<(), Self> {
        Self::unless((0.0..=1.0).contains(&volume), "a volume", volume, "a fraction between 0 and 1")
    }
}

/// Doses of the points of a structure.
#[derive(Clone, Copy, Debug)]
struct Doses<'a> {
    /// Dose (Gy) and volume of each.
    points: &'a [(f64, f64)],
    /// One for each where an objective asks for it.
    to_target_mm: &'a [f64],
}

impl Doses<'_> {
    fn whole(&self) -> f64 {
        self.points.iter().map(|(_, volume)| volume).sum()
    }

    fn mean(&self) -> f64 {
        self.points.iter().map(|(d, volume)| volume * d).sum::<f64>() / self.whole()
    }

    /// `sum v off(d)^2`.
    fn squares(&self, off: impl Fn(f64) -> f64) -> f64 {
        self.points.iter().map(|(d, volume)| volume * off(*d) * off(*d)).sum()
    }
}

/// Rows of a structure with their volumes.
#[derive(Clone, Copy, Debug)]
pub struct Region<'a> {
    /// Rows of the matrix.
    pub rows: &'a [u32],
    /// One for each row.
    pub volumes: &'a [f64],
    /// One for each row where an objective asks for it.
    pub to_target_mm: &'a [f64],
}

impl<'a> Region<'a> {
    fn whole(&self) -> f64 {
        self.volumes.iter().sum()
    }

    /// Rows with their volumes.
    fn both(self) -> impl Iterator<Item = (u32, f64)> + 'a {
        self.rows.iter().copied().zip(self.volumes.iter().copied())
    }

    /// Rows with their parts of the whole volume.
    fn shares(self) -> Vec<(u32, f64)> {
        let whole = self.whole();
        self.both().map(|(row, v)| (row, v / whole)).collect()
    }
}

/// What objectives add to a problem.
pub struct Parts<'a> {
    /// The matrix, which may get rows and columns.
    pub matrix: &'a mut Csr,
    /// Columns that are bixels.
    pub bixels: usize,
    pub terms: Vec<Term>,
    pub dvh: Vec<DvhTerm>,
    /// Costs of all rows of a region together.
    pub regions: Vec<RegionTerm>,
    /// Of each row behind those of voxels, the rows that it averages, with their shares.
    pub averages: Vec<Vec<(u32, f64)>>,
}

impl Parts<'_> {
    /// A term for each voxel: `weight / v sum max(0, +-(d - goal))^2`.
    fn add_each(&mut self, region: Region<'_>, side: Side, goal: f64, weight: f64) {
        let whole = region.whole();
        self.terms.extend(region.both().map(|(row, v)| Term { row, side, goal, weight: weight * v / whole }));
    }

    /// A term for the mean over the region: one more row.
    fn add_mean(&mut self, region: Region<'_>, side: Side, goal: f64, weight: f64) {
        let shares = region.shares();
        let (columns, means) = mean_row(self.matrix, &shares, self.bixels);
        let row = self.matrix.rows() as u32;
        self.matrix.push_row(&columns, &means);
        self.averages.push(shares);
        self.terms.push(Term { row, side, goal, weight });
    }

    /// The cost of a DVH point.
    fn add_dvh(&mut self, region: Region<'_>, side: Side, dose: f64, volume: f64, weight: f64) {
        let whole = region.whole();
        let (rows, volume, weight) = (region.both().collect(), volume * whole, weight / whole);
        self.dvh.push(DvhTerm { rows, volume, side, dose, weight });
    }
}

/// The mean of rows by their shares, as a sparse row; rounded to `f32` as every entry is.
fn mean_row(matrix: &Csr, shares: &[(u32, f64)], bixels: usize) -> (Vec<u32>, Vec<f32>) {
    let mut sums = vec![0.0_f64; bixels];
    for (row, share) in shares {
        let (columns, values) = matrix.row(*row as usize);
        for (c, v) in columns.iter().zip(values) {
            sums[*c as usize] += share * f64::from(*v);
        }
    }
    let columns: Vec<u32> = (0..bixels as u32).filter(|j| sums[*j as usize] != 0.0).collect();
    let means = columns.iter().map(|j| sums[*j as usize] as f32).collect();
    (columns, means)
}

/// On which side of a number a quantity is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// Not above it.
    AtMost,
    /// Not below it.
    AtLeast,
}

impl Bound {
    /// `<=` or `>=`.
    pub fn sign(self) -> &'static str {
        match self {
            Self::AtMost => "<=",
            Self::AtLeast => ">=",
        }
    }
}

/// The quantity that an objective bounds, as it truly is: not what the optimiser has in its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Its name: `D95%`, `V20Gy`, `mean`, `gEUD(8)`.
    pub quantity: String,
    /// `Gy`, or `%` of the structure.
    pub unit: String,
    /// Its value.
    pub value: f64,
    /// The side of the limit on which it should be.
    pub bound: Bound,
    /// The limit, in the same unit.
    pub limit: f64,
}

impl Measured {
    /// A dose.
    fn gray(quantity: String, value: f64, bound: Bound, limit: f64) -> Self {
        Self { quantity, unit: "Gy".to_owned(), value, bound, limit }
    }

    /// A fraction of the structure, in percent.
    fn fraction(quantity: String, value: f64, bound: Bound, limit: f64) -> Self {
        Self { quantity, unit: "%".to_owned(), value: 100.0 * value, bound, limit: 100.0 * limit }
    }

    /// Whether the value is on its side of the limit.
    pub fn met(&self) -> bool {
        match self.bound {
            Bound::AtMost => self.value <= self.limit,
            Bound::AtLeast => self.value >= self.limit,
        }
    }

    /// What it should be: `D95% >= 50 Gy`.
    pub fn requested(&self) -> String {
        format!("{} {} {} {}", self.quantity, self.bound.sign(), short(self.limit), self.unit)
    }
}

/// A number to three decimals, without zeros at its end.
fn short(number: f64) -> f64 {
    libm::round(1e3 * number) / 1e3
}

impl Objective {
    /// Refuses numbers out of their range; `name` is that of the structure.
    pub(super) fn check(&self, name: &str) -> Result<(), GoalsError> {
        let weight = self.weight();
        let weighs = weight.is_finite() && weight >= 0.0;
        let found = self.shape().check().and(BadNumber::unless(
            weighs,
            "a weight",
            weight,
            "finite and not negative",
        ));
        found.map_err(|BadNumber { what, value, range }| GoalsError::Number {
            name: name.to_owned(),
            what,
            value,
            range,
        })
    }

    /// Adds its terms on a region, and the rows and columns of the matrix that they need.
    pub(super) fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        self.shape().add(region, parts);
    }

    /// Its cost at points with a dose (Gy) and a volume each, and distances to the targets (mm) where it asks for them.
    pub(super) fn cost(&self, points: &[(f64, f64)], to_target_mm: &[f64]) -> f64 {
        self.shape().cost(&Doses { points, to_target_mm })
    }

    /// Whether it needs the distance of each voxel to the targets.
    pub fn needs_distances(&self) -> bool {
        self.shape().needs_distances()
    }

    /// What the dose of its structure is like where it is fulfilled.
    pub fn aim(&self) -> Aim {
        self.shape().aim()
    }

    /// The dose above which it costs, Gy, if it limits the dose of the structure.
    pub fn tolerated_gy(&self) -> Option<f64> {
        self.shape().tolerated_gy()
    }

    /// The quantity that it bounds, of this histogram; nothing where it bounds no single quantity.
    pub fn measure(&self, dvh: &Dvh) -> Option<Measured> {
        self.shape().measure(dvh)
    }
}

impl ObjectiveSpec {
    /// The doses that it names.
    pub fn doses(&self) -> Vec<Dose> {
        self.spec().doses()
    }

    /// The part of the structure that it holds for.
    pub fn part(&self) -> StructurePart {
        self.spec().part()
    }

    /// The objective for a structure of this prescription, where the highest of the case is `highest_gy`.
    pub fn resolve(&self, prescribed_gy: f64, highest_gy: f64) -> Objective {
        self.spec().resolve(&|dose| dose.gray(prescribed_gy, highest_gy))
    }
}

#[cfg(test)]
mod tests;
