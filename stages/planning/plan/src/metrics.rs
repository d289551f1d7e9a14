//! What a dose does to a structure: dose-volume histogram, dose at a volume, volume at a dose, indices.
//!
//! Doses are in gray; volumes in any one unit; fractions are of the structure's volume.

use thiserror::Error;

/// The dose-volume histogram of a structure, exact: every voxel is a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Dvh {
    /// Rising.
    dose: Vec<f64>,
    /// Volume of the voxels before each, in that order; that of all of them at the end.
    below: Vec<f64>,
}

/// Why doses make no histogram.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DvhError {
    /// There is no voxel.
    #[error("a structure without voxels has no dose-volume histogram")]
    Empty,
    /// Doses and volumes do not pair.
    #[error("{doses} doses and {volumes} volumes do not pair")]
    Length {
        /// Number of doses.
        doses: usize,
        /// Number of volumes.
        volumes: usize,
    },
    /// A dose is not finite, or a volume not positive.
    #[error(
        "voxel {at} has dose {dose} Gy and volume {volume}; a dose is finite, a volume finite and positive"
    )]
    Voxel {
        /// Place in the lists.
        at: usize,
        /// Its dose.
        dose: f64,
        /// Its volume.
        volume: f64,
    },
}

impl Dvh {
    /// Of voxels of equal volume.
    pub fn new(doses: &[f64]) -> Result<Self, DvhError> {
        Self::weighted(doses, &vec![1.0; doses.len()])
    }

    /// Of voxels of these volumes.
    pub fn weighted(doses: &[f64], volumes: &[f64]) -> Result<Self, DvhError> {
        if doses.len() != volumes.len() {
            return Err(DvhError::Length { doses: doses.len(), volumes: volumes.len() });
        }
        if doses.is_empty() {
            return Err(DvhError::Empty);
        }
        let good = |(dose, volume): &(f64, f64)| dose.is_finite() && volume.is_finite() && *volume > 0.0;
        let mut voxels: Vec<(f64, f64)> = doses.iter().copied().zip(volumes.iter().copied()).collect();
        if let Some(at) = voxels.iter().position(|voxel| !good(voxel)) {
            return Err(DvhError::Voxel { at, dose: voxels[at].0, volume: voxels[at].1 });
        }
        voxels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = Vec::with_capacity(voxels.len() + 1);
        let mut sum = 0.0;
        below.push(sum);
        for (_, volume) in &voxels {
            sum += volume;
            below.push(sum);
        }
        Ok(Self { dose: voxels.into_iter().map(|(dose, _)| dose).collect(), below })
    }

    /// The same with a volume more that has no dose.
    #[must_use]
    pub fn with_undosed(mut self, volume: f64) -> Self {
        // Doses between voxels are linear in volume, so both ends of this volume are voxels of no dose, too.
        const END: f64 = 1e-6;
        let place = self.dose.partition_point(|dose| *dose < 0.0);
        let before = self.below[place];
        self.below[place + 1..].iter_mut().for_each(|below| *below += volume);
        self.dose.splice(place..place, [0.0; 3]);
        let ends = [END, 1.0 - END, 1.0].map(|part| before + part * volume);
        self.below.splice(place + 1..place + 1, ends);
        self
    }

    /// Volume below the middle of a voxel.
    fn middle(&self, voxel: usize) -> f64 {
        0.5 * (self.below[voxel] + self.below[voxel + 1])
    }

    /// `D_p`: the dose that the hottest `percent` of the volume gets at least.
    ///
    /// Between voxels it is linear in volume, the coldest at 100 % and the hottest at 0 %; percent is held in 0..=100.
    pub fn dose_at(&self, percent: f64) -> f64 {
        // The end itself, not what rounding makes of it.
        if percent <= 0.0 {
            return self.max();
        }
        let cold = 1.0 - percent.clamp(0.0, 100.0) / 100.0;
        let last = self.dose.len() - 1;
        let (first, end) = (self.middle(0), self.middle(last));
        let target = first + cold * (end - first);
        let (mut low, mut high) = (0, last);
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if self.middle(middle) <= target { low = middle } else { high = middle }
        }
        let gap = self.middle(high) - self.middle(low);
        if gap <= 0.0 || target >= self.middle(high) {
            return self.dose[high];
        }
        let part = ((target - self.middle(low)) / gap).clamp(0.0, 1.0);
        (self.dose[low] + part * (self.dose[high] - self.dose[low])).min(self.dose[high])
    }

    /// The dose that the hottest `volume` gets at least, in the unit of the voxels' volumes: D0.03cc for 0.03 where that is
    /// cm3. Of a structure that is smaller it is the least dose.
    pub fn dose_at_volume(&self, volume: f64) -> f64 {
        self.dose_at(100.0 * volume / self.volume())
    }

    /// `V_d`: the fraction of the volume that gets at least `dose`.
    pub fn volume_at(&self, dose: f64) -> f64 {
        let first = self.dose.partition_point(|d| *d < dose);
        (self.volume() - self.below[first]) / self.volume()
    }

    /// Volume-weighted mean.
    pub fn mean(&self) -> f64 {
        let volumes = self.below.windows(2).map(|pair| pair[1] - pair[0]);
        self.dose.iter().zip(volumes).map(|(d, v)| d * v).sum::<f64>() / self.volume()
    }

    /// Generalised equivalent uniform dose `(1/v sum d^a)^(1/a)` (Niemierko 1999); the geometric mean for `a = 0`.
    ///
    /// It is 0 where `a` is not above 0 and a voxel has no dose.
    pub fn geud(&self, a: f64) -> f64 {
        let shares = self.below.windows(2).map(|pair| (pair[1] - pair[0]) / self.volume());
        let ruling = if a > 0.0 { self.max() } else { self.min() };
        if ruling <= 0.0 {
            return 0.0;
        }
        let ratios = self.dose.iter().map(|d| d.max(0.0) / ruling);
        if a == 0.0 {
            return ruling * libm::exp(ratios.zip(shares).map(|(d, s)| s * libm::log(d)).sum());
        }
        let sum: f64 = ratios.zip(shares).map(|(d, s)| s * libm::pow(d, a)).sum();
        ruling * libm::pow(sum, 1.0 / a)
    }

    /// Smallest dose.
    pub fn min(&self) -> f64 {
        self.dose[0]
    }

    /// Largest dose.
    pub fn max(&self) -> f64 {
        self.dose[self.dose.len() - 1]
    }

    /// The volume, in the unit given.
    pub fn volume(&self) -> f64 {
        self.below[self.dose.len()]
    }

    /// `(D_2 - D_98) / D_50`: 0 where the dose is even; infinite or not a number where half the volume gets none.
    pub fn homogeneity(&self) -> f64 {
        (self.dose_at(2.0) - self.dose_at(98.0)) / self.dose_at(50.0)
    }

    /// The cumulative curve: for `steps + 1` doses from 0 to `up_to` the fraction that gets at least each.
    pub fn curve(&self, up_to: f64, steps: usize) -> Vec<(f64, f64)> {
        (0..=steps)
            .map(|i| {
                let dose = up_to * i as f64 / steps.max(1) as f64;
                (dose, self.volume_at(dose))
            })
            .collect()
    }
}

/// Paddick's conformity index `(TV and PIV)^2 / (TV PIV)` of the isodose `dose`: 1 where it is the target, 0 where they
/// do not meet. `target` is the histogram of the target, `body` that of everything, the target included.
pub fn paddick_conformity(target: &Dvh, body: &Dvh, dose: f64) -> f64 {
    let covered = target.volume_at(dose) * target.volume();
    let isodose = body.volume_at(dose) * body.volume();
    if isodose > 0.0 { covered * covered / (target.volume() * isodose) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn four_voxels_have_the_doses_and_volumes_counted_by_hand() {
        let dvh = Dvh::new(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!((dvh.min(), dvh.max(), dvh.mean()), (1.0, 4.0, 2.5));
        assert_eq!([0.0, 1.0, 2.5, 4.0, 4.1].map(|d| dvh.volume_at(d)), [1.0, 1.0, 0.5, 0.25, 0.0]);
        assert_eq!([100.0, 50.0, 0.0].map(|p| dvh.dose_at(p)), [1.0, 2.5, 4.0]);
    }

    #[test]
    fn a_volume_without_dose_is_the_coldest_part_and_nothing_lies_between() {
        let dvh = Dvh::weighted(&[40.0, 50.0], &[30.0, 30.0]).unwrap().with_undosed(40.0);
        assert_eq!((dvh.volume(), dvh.min(), dvh.max(), dvh.mean()), (100.0, 0.0, 50.0, 27.0));
        assert_eq!([98.0, 95.0, 61.0].map(|percent| dvh.dose_at(percent)), [0.0; 3]);
        assert_eq!((dvh.volume_at(1.0), dvh.volume_at(0.0)), (0.6, 1.0));
    }

    #[test]
    fn doses_that_are_no_histogram_are_refused() {
        assert_eq!(Dvh::new(&[]), Err(DvhError::Empty));
        assert_eq!(Dvh::weighted(&[1.0], &[]), Err(DvhError::Length { doses: 1, volumes: 0 }));
        assert!(matches!(Dvh::new(&[1.0, f64::NAN]), Err(DvhError::Voxel { at: 1, .. })));
        assert!(matches!(Dvh::weighted(&[1.0], &[0.0]), Err(DvhError::Voxel { at: 0, .. })));
    }

    #[test]
    fn an_isodose_that_is_the_target_is_conformal() {
        let target = Dvh::new(&[60.0; 8]).unwrap();
        let body = |outside: &[f64]| Dvh::new(&[&[60.0; 8], outside].concat()).unwrap();
        assert_eq!(paddick_conformity(&target, &body(&[0.0; 5]), 57.0), 1.0);
        assert_eq!(paddick_conformity(&target, &body(&[60.0; 8]), 57.0), 0.5);
        assert_eq!(paddick_conformity(&target, &body(&[0.0; 5]), 61.0), 0.0);
    }

    #[test]
    fn the_dose_of_a_small_volume_is_the_largest_that_all_of_it_gets() {
        // 100 voxels of 0.01 cm3 with 1 to 100 Gy.
        let doses: Vec<f64> = (1..=100).map(f64::from).collect();
        let dvh = Dvh::weighted(&doses, &[0.01; 100]).unwrap();
        assert!((dvh.dose_at_volume(0.03) - 97.03).abs() < 1e-9, "{}", dvh.dose_at_volume(0.03));
        assert_eq!((dvh.dose_at_volume(0.0), dvh.dose_at_volume(5.0)), (100.0, 1.0));
    }

    fn voxels() -> impl Strategy<Value = Vec<(f64, f64)>> {
        prop::collection::vec((0.0..80.0, 0.1..9.0), 1..60)
    }

    fn dvh(voxels: &[(f64, f64)]) -> Dvh {
        let (doses, volumes): (Vec<f64>, Vec<f64>) = voxels.iter().copied().unzip();
        Dvh::weighted(&doses, &volumes).unwrap()
    }

    proptest! {
        #[test]
        fn dose_falls_with_volume_and_stays_between_its_ends(voxels in voxels(), a in 0.0..100.0, b in 0.0..100.0) {
            let dvh = dvh(&voxels);
            let (low, high) = (f64::min(a, b), f64::max(a, b));
            prop_assert!(dvh.min() <= dvh.dose_at(high) && dvh.dose_at(high) <= dvh.dose_at(low));
            prop_assert!(dvh.dose_at(low) <= dvh.max() && (dvh.dose_at(0.0), dvh.dose_at(100.0)) == (dvh.max(), dvh.min()));
        }

        #[test]
        fn volume_falls_with_dose_and_the_order_of_voxels_is_nothing(mut voxels in voxels(), a in 0.0..90.0, b in 0.0..90.0) {
            let one = dvh(&voxels);
            prop_assert!(one.volume_at(f64::max(a, b)) <= one.volume_at(f64::min(a, b)));
            voxels.reverse();
            let other = dvh(&voxels);
            prop_assert!((one.volume_at(a) - other.volume_at(a)).abs() < 1e-12);
            prop_assert!((one.mean() - other.mean()).abs() < 1e-9);
        }

        #[test]
        fn a_voxel_of_twice_the_volume_counts_as_two(voxels in voxels(), dose in 0.0..80.0) {
            let twice: Vec<(f64, f64)> = voxels.iter().flat_map(|(d, v)| [(*d, v / 2.0), (*d, v / 2.0)]).collect();
            let (one, two) = (dvh(&voxels), dvh(&twice));
            prop_assert!((one.volume_at(dose) - two.volume_at(dose)).abs() < 1e-12);
            prop_assert!((one.mean() - two.mean()).abs() < 1e-9);
        }

        #[test]
        fn geud_rises_with_its_exponent_from_the_least_dose_by_the_mean_to_the_largest(voxels in voxels()) {
            let dvh = dvh(&voxels);
            prop_assert!((dvh.geud(1.0) - dvh.mean()).abs() < 1e-9);
            let all = [-200.0, -10.0, -1.0, 0.0, 0.5, 1.0, 2.0, 8.0, 200.0].map(|a| dvh.geud(a));
            prop_assert!(all.windows(2).all(|pair| pair[0] <= pair[1] + 1e-9), "{all:?}");
            prop_assert!(all[0] >= dvh.min() - 1e-9 && all[8] <= dvh.max() + 1e-9);
            let plain = voxels.iter().map(|(d, v)| v * d.powi(8)).sum::<f64>() / dvh.volume();
            prop_assert!((all[7] - plain.powf(1.0 / 8.0)).abs() < 1e-9 * (1.0 + all[7]));
        }

        #[test]
        fn mean_is_the_area_under_the_curve(voxels in voxels()) {
            let dvh = dvh(&voxels);
            let steps = 20_000;
            let curve = dvh.curve(80.0, steps);
            let area: f64 = curve[1..].iter().map(|(_, volume)| volume * 80.0 / steps as f64).sum();
            prop_assert!((area - dvh.mean()).abs() < 80.0 / steps as f64 + 1e-9, "{area} {}", dvh.mean());
        }

        #[test]
        fn conformity_lies_between_zero_and_one(inside in voxels(), outside in voxels(), dose in 0.0..80.0) {
            let body = [inside.clone(), outside].concat();
            let index = paddick_conformity(&dvh(&inside), &dvh(&body), dose);
            prop_assert!((0.0..=1.0 + 1e-12).contains(&index), "{index}");
        }
    }
}
