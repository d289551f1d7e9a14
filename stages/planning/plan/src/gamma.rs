//! The gamma index of two doses (Low, Harms, Mutic, Purdy, Med. Phys. 25 (1998) 656): how far one is from the other in dose
//! and place at once, each over its tolerance.

use stillpoint_patient::Grid;

/// Steps of the search, as a part of the distance that is tolerated. Coarser ones miss the dose between them where it is
/// steep.
const STEP: f64 = 0.1;
/// How far the search goes, in the distance that is tolerated: all gamma beyond it counts as this.
const REACH: f64 = 1.5;

/// What is tolerated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Difference of dose, gray: global, the same everywhere.
    pub dose_gy: f64,
    /// Distance, mm.
    pub distance_mm: f64,
    /// Places with less of the reference's dose than this, gray, do not count.
    pub least_gy: f64,
}

/// Gamma at the voxels of the reference that count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gamma {
    /// Voxels that count.
    pub voxels: usize,
    /// Part of them with gamma up to 1.
    pub passed: f64,
    /// Mean of gamma; what lies beyond the search counts as its reach.
    pub mean: f64,
}

/// Compares a dose with a reference, each on its grid. `None` where no voxel counts.
pub fn gamma(
    (reference_grid, reference): (&Grid, &[f32]),
    (grid, dose): (&Grid, &[f32]),
    tolerance: &Tolerance,
) -> Option<Gamma> {
    let offsets = offsets(tolerance.distance_mm);
    let (mut voxels, mut passed, mut sum) = (0_usize, 0_usize, 0.0);
    for (voxel, expected) in
        reference.iter().enumerate().filter(|(_, gy)| f64::from(**gy) >= tolerance.least_gy)
    {
        let at = reference_grid.centre_mm(reference_grid.voxel(voxel));
        let mut least = REACH * REACH;
        // From the nearest place on: what is farther than the least found so far cannot be less.
        for ([x, y, z], distance) in &offsets {
            if *distance >= least {
                break;
            }
            let found = grid.value_at(dose, [at[0] + x, at[1] + y, at[2] + z]);
            let off = f64::from(found - expected) / tolerance.dose_gy;
            least = f64::min(least, off * off + distance);
        }
        voxels += 1;
        passed += usize::from(least <= 1.0);
        sum += least.sqrt();
    }
    let count = voxels as f64;
    (voxels > 0).then(|| Gamma { voxels, passed: passed as f64 / count, mean: sum / count })
}

/// Places about one, mm, with the square of their distance over the tolerated one, the nearest first.
fn offsets(distance_mm: f64) -> Vec<([f64; 3], f64)> {
    let most = (REACH / STEP).round() as i32;
    let mut all = Vec::new();
    for x in -most..=most {
        for y in -most..=most {
            for z in -most..=most {
                let square = STEP * STEP * f64::from(x * x + y * y + z * z);
                if square <= REACH * REACH {
                    all.push(([x, y, z].map(|i| f64::from(i) * STEP * distance_mm), square));
                }
            }
        }
    }
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { counts: [30, 12, 12], spacing_mm: [1.0; 3], origin_mm: [0.0; 3] };
    const TOLERANCE: Tolerance = Tolerance { dose_gy: 1.5, distance_mm: 3.0, least_gy: 5.0 };

    fn dose(of: impl Fn(f64) -> f64) -> Vec<f32> {
        (0..GRID.len()).map(|voxel| of(GRID.centre_mm(GRID.voxel(voxel))[0]) as f32).collect()
    }

    fn found(reference: &[f32], dose: &[f32]) -> Gamma {
        gamma((&GRID, reference), (&GRID, dose), &TOLERANCE).unwrap()
    }

    #[test]
    fn a_dose_is_itself_and_one_that_is_higher_everywhere_differs_by_dose_alone() {
        let flat = dose(|_| 50.0);
        assert_eq!(found(&flat, &flat), Gamma { voxels: GRID.len(), passed: 1.0, mean: 0.0 });
        let higher = found(&flat, &dose(|_| 50.75));
        assert!((higher.mean - 0.5).abs() < 1e-6 && higher.passed == 1.0, "{higher:?}");
        let beyond = found(&flat, &dose(|_| 51.6));
        assert!(beyond.passed == 0.0 && (beyond.mean - 1.6 / 1.5).abs() < 1e-5, "{beyond:?}");
    }

    #[test]
    fn a_steep_dose_that_is_moved_differs_by_the_distance() {
        // 7 Gy a millimetre: the way along the dose is far longer than that to the place.
        let steep = |moved: f64| dose(move |x| (7.0 * (x - 8.0 - moved)).clamp(0.0, 100.0));
        let near =
            gamma((&GRID, &steep(0.0)), (&GRID, &steep(1.5)), &Tolerance { least_gy: 15.0, ..TOLERANCE });
        assert!(near.unwrap().passed == 1.0, "{near:?}");
        let far =
            gamma((&GRID, &steep(0.0)), (&GRID, &steep(4.5)), &Tolerance { least_gy: 15.0, ..TOLERANCE });
        assert!(far.unwrap().passed < 0.6, "{far:?}");
        assert_eq!(gamma((&GRID, &dose(|_| 1.0)), (&GRID, &dose(|_| 1.0)), &TOLERANCE), None);
    }
}
