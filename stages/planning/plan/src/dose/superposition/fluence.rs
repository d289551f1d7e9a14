//! Fluence on the isocentre plane: squares of bixels, blurred by the penumbra, as means over what a voxel covers.

/// Distance between places of the map, mm.
const STEP_MM: f64 = 0.5;
/// The penumbra's Gaussian ends at this many standard deviations.
const GAUSS_SIGMAS: f64 = 4.0;

/// Shape of all bixels of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BixelShape {
    pub width_mm: f64,
    /// Standard deviation of the penumbra, mm.
    pub sigma_mm: f64,
}

impl BixelShape {
    /// A bixel whose penumbra has this full width at half maximum.
    pub fn new(width_mm: f64, penumbra_fwhm_mm: f64) -> Self {
        Self { width_mm, sigma_mm: penumbra_fwhm_mm / libm::sqrt(8.0 * core::f64::consts::LN_2) }
    }

    /// Distance from the centre beyond which there is no fluence, mm.
    pub fn reach_mm(&self) -> f64 {
        0.5 * self.width_mm + GAUSS_SIGMAS * self.sigma_mm
    }

    /// Mean of the fluence across a bixel between two places beside its centre, mm.
    pub fn mean(&self, low_mm: f64, high_mm: f64) -> f64 {
        let (half, sigma) = (0.5 * self.width_mm, self.sigma_mm);
        // The integral of the normal distribution function.
        let integral = |t: f64| {
            let density = libm::exp(-0.5 * t * t) / libm::sqrt(core::f64::consts::TAU);
            t * 0.5 * libm::erfc(-t * core::f64::consts::FRAC_1_SQRT_2) + density
        };
        let upto = |x: f64| sigma * (integral((x + half) / sigma) - integral((x - half) / sigma));
        (upto(high_mm) - upto(low_mm)) / (high_mm - low_mm)
    }
}

/// The rectangle of the isocentre plane that has fluence, mm: low and high, of x and z.
pub(super) fn bounds(bixels_mm: impl Iterator<Item = [f64; 2]> + Clone, shape: &BixelShape) -> [[f64; 2]; 2] {
    [0, 1].map(|axis| {
        let places = bixels_mm.clone().map(|bixel| bixel[axis]);
        let low = places.clone().fold(f64::INFINITY, f64::min);
        let high = places.fold(f64::NEG_INFINITY, f64::max);
        [low - shape.reach_mm(), high + shape.reach_mm()]
    })
}

/// The fluence of weighted bixels.
#[derive(Clone, Debug)]
pub(super) struct FluenceMap {
    /// Fluence between the map's first corner and each other corner, fluence times mm2; x fastest.
    integral: Vec<f64>,
    counts: [usize; 2],
    first_mm: [f64; 2],
}

impl FluenceMap {
    /// Of bixels with their weights.
    pub fn new(bixels: &[([f64; 2], f32)], shape: &BixelShape) -> Self {
        let bounds = bounds(bixels.iter().map(|(bixel, _)| *bixel), shape);
        let first_mm = bounds.map(|[low, _]| STEP_MM * (low / STEP_MM).floor());
        let cells =
            [0, 1].map(|axis| ((bounds[axis][1] - first_mm[axis]) / STEP_MM).ceil().max(1.0) as usize);
        let mut fluence = vec![0.0; cells[0] * cells[1]];
        for (bixel, weight) in bixels {
            let profile = |axis: usize| {
                let low = ((bixel[axis] - shape.reach_mm() - first_mm[axis]) / STEP_MM).max(0.0) as usize;
                let high = ((bixel[axis] + shape.reach_mm() - first_mm[axis]) / STEP_MM).ceil() as usize;
                let mean = |cell: usize| {
                    let at = first_mm[axis] + cell as f64 * STEP_MM - bixel[axis];
                    shape.mean(at, at + STEP_MM)
                };
                (low, (low..high.min(cells[axis])).map(mean).collect::<Vec<f64>>())
            };
            let ((x0, across), (z0, along)) = (profile(0), profile(1));
            for (z, part) in along.iter().enumerate() {
                let start = (z0 + z) * cells[0] + x0;
                let part = part * f64::from(*weight);
                let row = &mut fluence[start..start + across.len()];
                row.iter_mut().zip(&across).for_each(|(sum, value)| *sum += part * value);
            }
        }
        let counts = cells.map(|count| count + 1);
        let mut integral = vec![0.0; counts[0] * counts[1]];
        for z in 0..cells[1] {
            let mut row = 0.0;
            for x in 0..cells[0] {
                row += fluence[z * cells[0] + x] * STEP_MM * STEP_MM;
                let place = (z + 1) * counts[0] + x + 1;
                integral[place] = integral[place - counts[0]] + row;
            }
        }
        Self { integral, counts, first_mm }
    }

    /// Mean over a square around a place, mm.
    pub fn mean(&self, at_mm: [f64; 2], side_mm: f64) -> f64 {
        let place = |axis: usize, mm: f64| {
            let place = (mm - self.first_mm[axis]) / STEP_MM;
            let place = place.clamp(0.0, (self.counts[axis] - 1) as f64);
            let whole = (place as usize).min(self.counts[axis] - 2);
            (whole, place - whole as f64)
        };
        let half = 0.5 * side_mm;
        let [x, z] = [0, 1].map(|axis| [place(axis, at_mm[axis] - half), place(axis, at_mm[axis] + half)]);
        let upto = |(x, right): (usize, f64), (z, back): (usize, f64)| {
            let start = z * self.counts[0] + x;
            let [a, b] = [self.integral[start], self.integral[start + 1]];
            let [c, d] = [self.integral[start + self.counts[0]], self.integral[start + self.counts[0] + 1]];
            (a + right * (b - a)) * (1.0 - back) + (c + right * (d - c)) * back
        };
        let sum = upto(x[1], z[1]) - upto(x[0], z[1]) - upto(x[1], z[0]) + upto(x[0], z[0]);
        (sum / (side_mm * side_mm)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_bixels_make_an_even_field_and_its_edge_is_the_error_function() {
        let shape = BixelShape::new(10.0, 5.0);
        let bixels: Vec<([f64; 2], f32)> = (-3..=3)
            .flat_map(|x| (-3..=3).map(move |z| ([f64::from(10 * x), f64::from(10 * z)], 2.0)))
            .collect();
        let map = FluenceMap::new(&bixels, &shape);
        for at in [[0.0, 0.0], [5.0, -5.0], [12.3, 20.1]] {
            assert!((map.mean(at, 2.5) - 2.0).abs() < 1e-3, "{at:?}");
        }
        for x in [30.0, 33.0, 35.0, 36.5, 40.0] {
            let expected = 1.0 - libm::erf((x - 35.0) / (shape.sigma_mm * core::f64::consts::SQRT_2));
            let found = map.mean([x, 0.0], 0.2);
            // Within a cell of half a millimetre the fluence is even, and here it falls by 0.3 a millimetre.
            assert!((found - expected).abs() < 1e-2, "{x}: {found} {expected}");
        }
        assert_eq!(map.mean([80.0, 0.0], 2.5), 0.0);
    }
}
