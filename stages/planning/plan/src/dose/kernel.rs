//! What one bixel does to the dose at its side: its fluence, blurred by the penumbra, folded with the kernels.

use super::machine::Machine;

/// Distance between samples, mm. It is fixed: a kernel's value at its pole belongs to a cell of this size.
pub(super) const STEP_MM: f64 = 0.5;
/// The penumbra's Gaussian ends at this many standard deviations.
const GAUSS_SIGMAS: f64 = 5.0;

/// Lateral dose of a bixel by component, over one quadrant around its centre.
///
/// Each component is the convolution of a square of fluence 1, a Gaussian (the penumbra), and the machine's radial
/// kernel (Bortfeld 1993 (9)). It has the symmetry of the square.
#[derive(Clone, Debug)]
pub(crate) struct BixelKernel {
    /// `side * side` places, x fastest; the fourth number is 0.
    places: Vec<[f32; 4]>,
    side: usize,
    /// Coordinate of the first place, in places. It is 0, or -1/2 where the samples lie beside the centre.
    first: f32,
    per_mm: f32,
}

impl BixelKernel {
    /// The kernel of a square of `width_mm`, as far as `reach_mm` from its centre along each axis.
    pub fn new(machine: &Machine, ssd_mm: f64, width_mm: f64, reach_mm: f64) -> Self {
        let edge = edge_profile(width_mm, machine.file().penumbra_fwhm_at_iso_mm);
        let half = edge.len() / 2;
        // With an even number of samples they lie half a step beside the centre; the first place is then the mirrored one.
        let even = edge.len().is_multiple_of(2);
        let first = if even { 1 } else { 0 };
        let side = (reach_mm / STEP_MM).ceil() as usize + 2;
        let reach = side + half + 1;

        let mut places = vec![[0.0; 4]; side * side];
        for (component, kernel) in machine.kernels_at(ssd_mm).into_iter().enumerate() {
            let radial = |x: usize, z: usize| {
                let distance_mm = STEP_MM * libm::hypot(x as f64, z as f64);
                STEP_MM * STEP_MM * at_distance(&machine.file().kernel_pos_mm, kernel, distance_mm)
            };
            // One axis after the other; the kernel is even along both, so its positive half is enough.
            let (mut row, mut folded) = (vec![0.0; reach], vec![0.0; side]);
            let mut along_x = vec![0.0; reach * side];
            for z in 0..reach {
                row.iter_mut().enumerate().for_each(|(x, value)| *value = radial(x, z));
                fold(&row, &edge, first, &mut folded);
                folded.iter().enumerate().for_each(|(x, value)| along_x[x * reach + z] = *value);
            }
            for (x, column) in along_x.chunks_exact(reach).enumerate() {
                fold(column, &edge, first, &mut folded);
                for (z, value) in folded.iter().enumerate() {
                    places[z * side + x][component] = *value as f32;
                }
            }
        }
        Self { places, side, first: if even { -0.5 } else { 0.0 }, per_mm: (1.0 / STEP_MM) as f32 }
    }

    /// Where the samples lie beside multiples of the step around the bixel's centre, mm.
    pub fn phase_mm(&self) -> f64 {
        -f64::from(self.first) * STEP_MM
    }

    /// The components at a distance from the bixel's centre on the isocentre plane, mm: linear between the samples.
    /// Beyond the reach, it is the value at the reach.
    #[inline]
    pub fn at(&self, x_mm: f32, z_mm: f32) -> [f32; 4] {
        let last = (self.side - 2) as f32;
        let place = |mm: f32| {
            let place = mm.abs() * self.per_mm - self.first;
            let whole = place.min(last) as usize;
            (whole, (place - whole as f32).min(1.0))
        };
        let ((x, right), (z, back)) = (place(x_mm), place(z_mm));
        let start = z * self.side + x;
        let (front, behind) =
            (&self.places[start..start + 2], &self.places[start + self.side..start + self.side + 2]);
        let weights =
            [(1.0 - right) * (1.0 - back), right * (1.0 - back), (1.0 - right) * back, right * back];
        std::array::from_fn(|c| {
            (front[0][c] * weights[0] + front[1][c] * weights[1])
                + (behind[0][c] * weights[2] + behind[1][c] * weights[3])
        })
    }
}

/// Fluence across a bixel, blurred by the penumbra. Its middle is the bixel's.
fn edge_profile(width_mm: f64, fwhm_mm: f64) -> Vec<f64> {
    // Cells that the bixel covers; it may cover but a part of the outermost two.
    let cells = (width_mm / STEP_MM).ceil().max(2.0);
    let outermost = 0.5 * (width_mm / STEP_MM - (cells - 2.0));
    let cells = cells as isize;
    let covered = |cell: isize| if cell == 0 || cell == cells - 1 { outermost } else { 1.0 };

    let sigma_mm = fwhm_mm / libm::sqrt(8.0 * core::f64::consts::LN_2);
    let reach = (GAUSS_SIGMAS * sigma_mm / STEP_MM).ceil() as isize;
    let sampled = |offset: isize| {
        let x = offset as f64 * STEP_MM / sigma_mm;
        STEP_MM / (sigma_mm * libm::sqrt(core::f64::consts::TAU)) * libm::exp(-0.5 * x * x)
    };
    // Samples of a Gaussian that is narrower than the step do not sum to 1.
    let total: f64 = (-reach..=reach).map(sampled).sum();
    let is_narrow = (total - 1.0).abs() > 1e-5;
    let gauss = |offset: isize| if is_narrow { sampled(offset) / total } else { sampled(offset) };
    let blurred = |at: isize| -> f64 {
        (0..cells)
            .filter(|cell| (at - cell).abs() <= reach)
            .map(|cell| covered(cell) * gauss(at - cell))
            .sum()
    };
    (-reach..cells + reach).map(blurred).collect()
}

/// The convolution of an even sequence, given from its middle on, with the edge profile, at each place from `-first` on.
/// With an odd profile places count from the middle; with an even one from half a step before it.
fn fold(even: &[f64], edge: &[f64], first: isize, out: &mut [f64]) {
    let behind = edge.len() as isize - 1;
    let low = (edge.len() / 2) as isize - first - behind;
    let mirrored: Vec<f64> = (low..low + out.len() as isize + behind)
        .map(|at| even.get(at.unsigned_abs()).copied().unwrap_or(0.0))
        .collect();
    // All places at once for each number of the profile: every sum keeps its order.
    out.fill(0.0);
    for (i, weight) in edge.iter().enumerate() {
        let seen = &mirrored[edge.len() - 1 - i..];
        out.iter_mut().zip(seen).for_each(|(sum, value)| *sum += weight * value);
    }
}

/// A radial kernel, linear between its positions and 0 beyond the last.
pub(super) fn at_distance(positions_mm: &[f64], values: &[f64], distance_mm: f64) -> f64 {
    let after = positions_mm.partition_point(|&position| position <= distance_mm);
    match (after.checked_sub(1), positions_mm.get(after)) {
        (Some(before), Some(&next)) => {
            let part = (distance_mm - positions_mm[before]) / (next - positions_mm[before]);
            values[before] + part * (values[after] - values[before])
        }
        (Some(before), None) if positions_mm[before] == distance_mm => values[before],
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fluence at a place across a bixel, by the error function.
    fn blurred_edge(x_mm: f64, width_mm: f64, fwhm_mm: f64) -> f64 {
        let scale = fwhm_mm / libm::sqrt(4.0 * core::f64::consts::LN_2);
        0.5 * (libm::erf((x_mm + 0.5 * width_mm) / scale) - libm::erf((x_mm - 0.5 * width_mm) / scale))
    }

    /// A machine whose first component does not spread at all: its lateral dose is the fluence.
    fn without_spread() -> Machine {
        let mut file = Machine::shipped().unwrap().file().clone();
        for kernel in &mut file.kernels_per_mm2[0] {
            kernel.fill(0.0);
            kernel[0] = 4.0;
        }
        Machine::new(file).unwrap()
    }

    #[test]
    fn a_penumbra_of_any_width_adds_and_takes_no_fluence() {
        for fwhm_mm in [0.1, 0.3, 0.5, 0.9, 1.0, 5.0, 20.0] {
            for width_mm in [5.0, 7.3, 10.0] {
                let total_mm = STEP_MM * edge_profile(width_mm, fwhm_mm).iter().sum::<f64>();
                assert!((total_mm - width_mm).abs() < 1e-4 * width_mm, "{fwhm_mm} {width_mm}: {total_mm}");
            }
        }
    }

    #[test]
    fn a_fold_is_the_convolution_of_the_whole_sequence_to_the_bit() {
        let number = |i: usize| libm::sin(1.7 * i as f64 + 0.3) + 1.1;
        for (count, width, first) in [(9, 5, 0), (9, 4, 1), (3, 8, 1), (20, 1, 0)] {
            let (even, edge): (Vec<f64>, Vec<f64>) =
                ((0..count).map(number).collect(), (0..width).map(|i| number(i + 50)).collect());
            let mut found = vec![f64::NAN; 12];
            fold(&even, &edge, first, &mut found);
            for (place, found) in found.into_iter().enumerate() {
                let mut expected = 0.0;
                for (i, weight) in edge.iter().enumerate() {
                    let at = place as isize - first + (width / 2) as isize - i as isize;
                    expected += weight * even.get(at.unsigned_abs()).copied().unwrap_or(0.0);
                }
                assert_eq!(found.to_bits(), expected.to_bits(), "{count} {width} {place}");
            }
        }
    }

    #[test]
    fn fluence_of_a_bixel_is_its_square_blurred_by_the_penumbra() {
        // Even, odd and broken numbers of cells.
        for width_mm in [10.0, 7.5, 5.0, 4.3] {
            let kernel = BixelKernel::new(&without_spread(), 900.0, width_mm, 20.0);
            for (x, z) in [(0.0, 0.0), (3.0, -1.0), (-5.0, 2.2), (6.1, 6.1), (11.0, 0.3)] {
                let expected = blurred_edge(x, width_mm, 5.0) * blurred_edge(z, width_mm, 5.0);
                let found = f64::from(kernel.at(x as f32, z as f32)[0]);
                assert!((found - expected).abs() < 0.004, "{width_mm} mm at {x}, {z}: {found}, {expected}");
            }
        }
    }

    #[test]
    fn lateral_dose_is_the_sum_of_the_kernel_over_the_fluence() {
        let machine = Machine::shipped().unwrap();
        let kernel = BixelKernel::new(&machine, 900.0, 5.0, 30.0);
        let radial = machine.kernels_at(900.0)[2];
        // Samples of fluence lie a quarter millimetre beside the half millimetres, so places between two are even mixes.
        for (x, z) in [(0.25, 0.25), (12.25, 3.75), (25.75, 19.25)] {
            let mut expected = 0.0;
            for i in -60..60 {
                for j in -60..60 {
                    let [a, b] = [i, j].map(|step| 0.5 * f64::from(step) + 0.25);
                    let fluence = blurred_edge(a, 5.0, 5.0) * blurred_edge(b, 5.0, 5.0);
                    let r = libm::hypot(x - a, z - b);
                    expected += 0.25 * fluence * at_distance(&machine.file().kernel_pos_mm, radial, r);
                }
            }
            let found = f64::from(kernel.at(x as f32, z as f32)[2]);
            assert!((found - expected).abs() < 0.005 * expected, "{x}, {z}: {found}, {expected}");
        }
    }
}
