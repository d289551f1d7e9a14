//! What a machine can do while its gantry turns, and how long an arc takes.

use serde::{Deserialize, Serialize};

use super::machine::{MachineError, in_range};

/// How fast gantry, leaves and dose may be in an arc: the section `arc` of a machine file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArcLimits {
    /// Fastest turn of the gantry, degrees a second.
    pub gantry_deg_per_s: f64,
    /// Slowest turn of the gantry while the beam is on, degrees a second.
    pub least_gantry_deg_per_s: f64,
    /// Fastest leaf, mm a second on the isocentre plane.
    pub leaf_mm_per_s: f64,
    /// Most that a leaf travels while the gantry turns by a degree, mm.
    pub leaf_mm_per_deg: f64,
    /// Highest dose rate, monitor units a minute.
    pub mu_per_min: f64,
    /// Lowest dose rate, monitor units a minute, where the beam cannot pause within an arc.
    #[serde(default)]
    pub least_mu_per_min: f64,
    /// Least distance between the tips of a pair, mm.
    #[serde(default)]
    pub least_gap_mm: f64,
}

/// A stretch of an arc between two control points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// What the gantry turns by, degrees.
    pub degrees: f64,
    /// Longest way of a tip, mm.
    pub travel_mm: f64,
    /// Monitor units.
    pub units: f64,
}

/// The longest way of a tip from these places to those, mm.
pub fn farthest_mm(from: &[[f64; 2]], to: &[[f64; 2]]) -> f64 {
    let both = from.iter().zip(to).flat_map(|(a, b)| [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()]);
    both.fold(0.0, f64::max)
}

impl ArcLimits {
    /// Those of a generic machine: a turn in a minute, leaves of 25 mm/s, 600 monitor units a minute.
    pub const fn generic() -> Self {
        Self {
            gantry_deg_per_s: 6.0,
            least_gantry_deg_per_s: 0.5,
            leaf_mm_per_s: 25.0,
            leaf_mm_per_deg: 5.0,
            mu_per_min: 600.0,
            least_mu_per_min: 0.0,
            least_gap_mm: 0.0,
        }
    }

    /// Seconds that a stretch takes: as fast as gantry, leaves and dose rate allow.
    pub fn seconds(&self, stretch: &Stretch) -> f64 {
        let by_gantry = stretch.degrees / self.gantry_deg_per_s;
        let by_leaves = stretch.travel_mm / self.leaf_mm_per_s;
        let by_dose = 60.0 * stretch.units / self.mu_per_min;
        by_gantry.max(by_leaves).max(by_dose)
    }

    /// Fewest and most monitor units that can be given while the gantry turns by so much: the fewest at its fastest, the most at its slowest.
    pub fn units(&self, degrees: f64) -> [f64; 2] {
        [
            self.least_mu_per_min / 60.0 * degrees / self.gantry_deg_per_s,
            self.mu_per_min / 60.0 * degrees / self.least_gantry_deg_per_s,
        ]
    }

    /// Longest way of a tip while the gantry turns by so much, in whole micrometres, mm.
    pub fn travel_mm(&self, degrees: f64) -> f64 {
        libm::floor(1e3 * self.leaf_mm_per_deg * degrees + 1e-6) / 1e3
    }

    /// Refuses numbers of no machine.
    ///
    /// # Errors
    /// The name of the number that is out of range.
    pub fn check(&self) -> Result<(), MachineError> {
        let fastest = self.gantry_deg_per_s;
        in_range("arc.gantry_deg_per_s", fastest, 0.1..=100.0, "from 0.1 to 100 degrees a second")?;
        let slowest = self.least_gantry_deg_per_s;
        let must = "above 0 and at most `gantry_deg_per_s`";
        in_range("arc.least_gantry_deg_per_s", slowest, 1e-3..=fastest, must)?;
        in_range("arc.leaf_mm_per_s", self.leaf_mm_per_s, 1.0..=1000.0, "from 1 to 1000 mm a second")?;
        in_range("arc.leaf_mm_per_deg", self.leaf_mm_per_deg, 0.1..=100.0, "from 0.1 to 100 mm a degree")?;
        in_range(
            "arc.mu_per_min",
            self.mu_per_min,
            1.0..=10_000.0,
            "from 1 to 10000 monitor units a minute",
        )?;
        let must = "from 0 to a tenth of `mu_per_min`";
        in_range("arc.least_mu_per_min", self.least_mu_per_min, 0.0..=0.1 * self.mu_per_min, must)?;
        in_range("arc.least_gap_mm", self.least_gap_mm, 0.0..=20.0, "from 0 to 20 mm")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slowest_of_gantry_leaves_and_dose_gives_the_time() {
        let limits = ArcLimits::generic();
        let seconds = |degrees, travel_mm, units| limits.seconds(&Stretch { degrees, travel_mm, units });
        assert!((seconds(4.0, 0.0, 0.0) - 4.0 / 6.0).abs() < 1e-12);
        assert!((seconds(4.0, 20.0, 0.0) - 0.8).abs() < 1e-12);
        assert!((seconds(4.0, 20.0, 12.0) - 1.2).abs() < 1e-12);
        assert_eq!((limits.units(4.0), limits.travel_mm(4.0)), ([0.0, 80.0], 20.0));
        assert_eq!(limits.travel_mm(3.977_777_777), 19.888);
    }

    #[test]
    fn numbers_of_no_machine_are_refused_by_name() {
        assert!(ArcLimits::generic().check().is_ok());
        let wrong = [
            ArcLimits { gantry_deg_per_s: f64::NAN, ..ArcLimits::generic() },
            ArcLimits { least_gantry_deg_per_s: 7.0, ..ArcLimits::generic() },
            ArcLimits { leaf_mm_per_deg: 0.0, ..ArcLimits::generic() },
            ArcLimits { least_mu_per_min: 100.0, ..ArcLimits::generic() },
            ArcLimits { least_gap_mm: -1.0, ..ArcLimits::generic() },
        ];
        for limits in wrong {
            assert!(limits.check().unwrap_err().to_string().starts_with("`arc."), "{limits:?}");
        }
    }
}
