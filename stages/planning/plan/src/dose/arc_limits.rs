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

    /// Fewest and most monitor units that can be given while the gantry turns by so much: the fewest at its fastest, or while a
    /// leaf goes its longest way, if that takes more time; the most at its slowest.
    pub fn units(&self, degrees: f64) -> [f64; 2] {
        let quickest = Stretch { degrees, travel_mm: self.travel_mm(degrees), units: 0.0 };
        [
            self.least_mu_per_min / 60.0 * self.seconds(&quickest),
            self.mu_per_min / 60.0 * degrees / self.least_gantry_deg_per_s,
        ]
    }

    /// Longest way of a tip while the gantry turns by so much, in whole micrometres, mm. It is no longer than what a leaf does
    /// while the gantry turns at its slowest.
    pub fn travel_mm(&self, degrees: f64) -> f64 {
        let at_slowest = self.leaf_mm_per_s / self.least_gantry_deg_per_s;
        libm::floor(1e3 * self.leaf_mm_per_deg.min(at_slowest) * degrees + 1e-6) / 1e3
    }

    /// Least distance between the tips of a pair in whole micrometres, mm.
    pub fn whole_gap_mm(&self) -> f64 {
        libm::ceil(1e3 * self.least_gap_mm - 1e-6) / 1e3
    }

    /// The first limit that a stretch does not keep, in words.
    pub fn fault(&self, stretch: &Stretch) -> Option<String> {
        let Stretch { degrees, travel_mm, units } = *stretch;
        let seconds = self.seconds(stretch);
        let most_mm = self.leaf_mm_per_deg * degrees;
        let [turn, rate] = [degrees / seconds, 60.0 * units / seconds];
        let is_less = |a: f64, b: f64| a < b * (1.0 - 1e-6);
        if travel_mm > most_mm + 1e-6 {
            Some(format!("a leaf travels {travel_mm} mm in {degrees} degrees (allowed: {most_mm} mm)"))
        } else if is_less(turn, self.least_gantry_deg_per_s) {
            let least = self.least_gantry_deg_per_s;
            Some(format!("the gantry turns by {turn} degrees a second (at least: {least})"))
        } else if is_less(rate, self.least_mu_per_min) {
            Some(format!("{rate} monitor units a minute (at least: {})", self.least_mu_per_min))
        } else {
            None
        }
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
    fn the_longest_way_of_a_leaf_slows_neither_the_gantry_nor_the_dose_below_their_least() {
        let limits = ArcLimits { least_mu_per_min: 30.0, ..ArcLimits::generic() };
        // The leaves take 0.8 s, the gantry 0.67 s.
        let units = limits.units(4.0)[0];
        assert!((units - 0.4).abs() < 1e-12);
        let slow = ArcLimits { leaf_mm_per_s: 2.0, ..limits };
        assert_eq!(slow.travel_mm(4.0), 16.0);
        for limits in [limits, slow] {
            let [units, travel_mm] = [limits.units(4.0)[0], limits.travel_mm(4.0)];
            let fault = |travel_mm, units| limits.fault(&Stretch { degrees: 4.0, travel_mm, units });
            assert_eq!(fault(travel_mm, units), None, "{limits:?}");
            assert!(fault(travel_mm + 1e-3, 10.0 * units).is_some());
            assert!(fault(travel_mm, 0.99 * units).unwrap().contains("monitor units a minute"));
        }
        let late = Stretch { degrees: 4.0, travel_mm: 17.0, units: 80.0 };
        assert!(slow.fault(&late).unwrap().contains("the gantry turns by"));
        assert_eq!(ArcLimits { least_gap_mm: 0.5001, ..limits }.whole_gap_mm(), 0.501);
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
