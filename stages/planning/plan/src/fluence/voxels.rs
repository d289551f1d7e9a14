//! Structures on the dose grid.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

/// Voxels of the dose grid, rising, whose centres lie in a voxel of the mask, which is on the grid of the image.
pub fn voxels_on(dose: &Grid, image: &Grid, mask: &Mask) -> Vec<u32> {
    let place = |mm: f64, axis: usize| {
        let step = ((mm - image.origin_mm[axis]) / image.spacing_mm[axis]).round();
        (step >= 0.0 && step < image.counts[axis] as f64).then_some(step as usize)
    };
    let inside = |voxel: &u32| {
        let [x, y, z] = dose.centre_mm(dose.voxel(*voxel as usize));
        let (Some(x), Some(y), Some(z)) = (place(x, 0), place(y, 1), place(z, 2)) else { return false };
        mask.contains(image.index([x, y, z]))
    };
    (0..dose.len() as u32).filter(inside).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_takes_what_lies_at_its_centre_and_nothing_beyond_the_image() {
        let image = Grid { counts: [4, 4, 1], spacing_mm: [1.0, 1.0, 1.0], origin_mm: [0.5, 0.5, 0.0] };
        let dose = Grid { counts: [3, 2, 1], spacing_mm: [2.0, 2.0, 1.0], origin_mm: [0.6, 0.6, 0.0] };
        let left = Mask::from_fn(16, |i| i % 4 < 2);
        assert_eq!(voxels_on(&dose, &image, &left), [0, 3]);
        assert_eq!(voxels_on(&dose, &image, &Mask::from_fn(16, |_| true)), [0, 1, 3, 4]);
    }
}
