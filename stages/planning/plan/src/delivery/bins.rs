//! Motions in bins of six numbers.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};

use super::time::MotionAt;
use stillpoint_patient::couch::Motion;

/// Width of the bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinWidth {
    /// Along each axis, mm.
    pub shift_mm: f64,
    /// About each axis, rad.
    pub turn_rad: f64,
}

/// Motions that lie near to each other, as their mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Part of the whole time, from 0 to 1.
    pub share: f64,
    /// Mean place of the isocentre from the planned one, mm.
    pub shift_mm: [f64; 3],
    /// Mean turn about it: axis times angle, rad.
    pub turn_rad: [f64; 3],
}

impl Bin {
    /// As a motion of points of the patient frame.
    pub fn motion(&self, isocentre_mm: [f64; 3]) -> Motion {
        let (isocentre, shift) = (Vector3::from(isocentre_mm), Vector3::from(self.shift_mm));
        let rotation = Rotation3::from_scaled_axis(Vector3::from(self.turn_rad)).into_inner();
        Motion { rotation, shift_mm: isocentre + shift - rotation * isocentre }
    }
}

/// The bins of motions with these weights, in the order of their places; a bin is around zero. A bin's motion is the
/// weighted mean of what it holds, so that only the spread within a bin is lost. Nothing where no motion has a weight.
pub fn bins(motions: &[MotionAt], weights: &[u64], width: BinWidth) -> Vec<Bin> {
    let mut sums: BTreeMap<[i64; 6], (f64, [f64; 6])> = BTreeMap::new();
    let mut whole = 0.0;
    for (motion, weight) in motions.iter().zip(weights).filter(|(_, weight)| **weight > 0) {
        let ([x, y, z], [a, b, c]) = (motion.shift_mm, motion.turn_rad);
        let numbers = [x, y, z, a, b, c];
        let place = std::array::from_fn(|i| {
            let width = if i < 3 { width.shift_mm } else { width.turn_rad };
            libm::round(numbers[i] / width) as i64
        });
        let weight = *weight as f64;
        let (sum, mean) = sums.entry(place).or_default();
        *sum += weight;
        whole += weight;
        mean.iter_mut().zip(numbers).for_each(|(mean, number)| *mean += weight * number);
    }
    let bin = |(sum, numbers): (f64, [f64; 6])| {
        let [x, y, z, a, b, c] = numbers.map(|number| number / sum);
        Bin { share: sum / whole, shift_mm: [x, y, z], turn_rad: [a, b, c] }
    };
    sums.into_values().map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: BinWidth = BinWidth { shift_mm: 1.0, turn_rad: 0.01 };

    fn at(x: f64, turn: f64) -> MotionAt {
        MotionAt { time_ns: 0, shift_mm: [x, 0.0, 0.0], turn_rad: [0.0, 0.0, turn] }
    }

    #[test]
    fn near_motions_are_one_bin_at_their_weighted_mean() {
        let motions = [at(0.1, 0.001), at(0.4, 0.001), at(0.6, 0.001), at(0.4, 0.02), at(90.0, 0.0)];
        let found = bins(&motions, &[30, 10, 20, 40, 0], WIDTH);
        let shares: Vec<f64> = found.iter().map(|b| b.share).collect();
        assert_eq!(shares, [0.4, 0.4, 0.2], "a motion without weight has no bin");
        assert!((found[0].shift_mm[0] - 0.175).abs() < 1e-12 && (found[1].turn_rad[2] - 0.02).abs() < 1e-12);
        assert!(bins(&motions, &[0; 5], WIDTH).is_empty());
    }

    #[test]
    fn a_bin_turns_about_the_isocentre_and_then_shifts() {
        let bin =
            Bin { share: 1.0, shift_mm: [1.0, 2.0, 3.0], turn_rad: [0.0, 0.0, std::f64::consts::FRAC_PI_2] };
        let isocentre = Vector3::new(10.0, 20.0, 30.0);
        let motion = bin.motion(isocentre.into());
        let moved = |offset: Vector3<f64>| motion.apply(isocentre + offset) - isocentre;
        assert!((moved(Vector3::zeros()) - Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
        assert!((moved(Vector3::x()) - Vector3::new(1.0, 3.0, 3.0)).norm() < 1e-12);
    }
}
