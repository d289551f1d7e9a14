//! Relative electron density of a patient on the dose grid.

use super::machine::Machine;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

/// Density inside the external contour and 0 outside of it, linear between the centres of the image's voxels. Outside
/// of the image the density is 0.
pub(crate) fn on_grid(image: &Grid, hu: &[i16], external: &Mask, machine: &Machine, grid: &Grid) -> Vec<f32> {
    let mut density = vec![0.0_f32; image.len()];
    for voxel in external.indices() {
        density[voxel] = machine.density(f64::from(hu[voxel])) as f32;
    }
    let axes: [Vec<Option<(usize, usize, f64)>>; 3] = std::array::from_fn(|axis| {
        let last = image.counts[axis] - 1;
        let between = |place: f64| {
            let place = place.clamp(0.0, last as f64);
            let low = place as usize;
            (low, (low + 1).min(last), place - low as f64)
        };
        places(image, grid, axis).map(|place| place.map(between)).collect()
    });
    let mut out = vec![0.0; grid.len()];
    for (voxel, out) in out.iter_mut().enumerate() {
        let [x, y, z] = grid.voxel(voxel);
        let (Some((x0, x1, right)), Some((y0, y1, down)), Some((z0, z1, back))) =
            (axes[0][x], axes[1][y], axes[2][z])
        else {
            continue;
        };
        let at = |x, y, z| f64::from(density[image.index([x, y, z])]);
        let along_x = |y, z| at(x0, y, z) * (1.0 - right) + at(x1, y, z) * right;
        let along_y = |z| along_x(y0, z) * (1.0 - down) + along_x(y1, z) * down;
        *out = (along_y(z0) * (1.0 - back) + along_y(z1) * back) as f32;
    }
    out
}

/// Voxels of the dose grid whose centre lies in a voxel of the mask, in order.
pub(crate) fn voxels_inside(image: &Grid, mask: &Mask, grid: &Grid) -> Vec<u32> {
    let axes: [Vec<Option<usize>>; 3] = std::array::from_fn(|axis| {
        places(image, grid, axis).map(|place| place.map(|place| (place + 0.5).floor() as usize)).collect()
    });
    let inside = |voxel: &usize| {
        let [x, y, z] = grid.voxel(*voxel);
        match (axes[0][x], axes[1][y], axes[2][z]) {
            (Some(x), Some(y), Some(z)) => mask.contains(image.index([x, y, z])),
            _ => false,
        }
    };
    (0..grid.len()).filter(inside).map(|voxel| voxel as u32).collect()
}

/// Where the centres of the grid's voxels lie along an axis, counted in the image's voxels; `None` outside of the image.
fn places(image: &Grid, grid: &Grid, axis: usize) -> impl Iterator<Item = Option<f64>> {
    let (from, step) = (grid.origin_mm[axis] - image.origin_mm[axis], grid.spacing_mm[axis]);
    let (spacing, end) = (image.spacing_mm[axis], image.counts[axis] as f64 - 0.5);
    (0..grid.counts[axis])
        .map(move |i| Some((from + i as f64 * step) / spacing).filter(|p| (-0.5..end).contains(p)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dose_grid_takes_the_image_inside_the_contour_and_nothing_beyond_the_image() {
        let image = Grid { counts: [4, 1, 1], spacing_mm: [2.0; 3], origin_mm: [0.0; 3] };
        let external = Mask::from_fn(4, |voxel| voxel > 0);
        let grid = Grid { counts: [6, 1, 1], spacing_mm: [1.5; 3], origin_mm: [-1.5, 0.0, 0.0] };
        let machine = Machine::shipped().unwrap();
        // Centres at -1.5 (outside), 0, 1.5, 3, 4.5 and 6; densities 0, 1, 0.5, 0.8 at 0, 2, 4, 6.
        let density = on_grid(&image, &[0, 0, -500, -200], &external, &machine, &grid);
        let expected = [0.0, 0.0, 0.75, 0.75, 0.575, 0.8];
        assert!(density.iter().zip(expected).all(|(d, e)| (d - e).abs() < 1e-6), "{density:?}");
        assert_eq!(voxels_inside(&image, &external, &grid), [2, 3, 4, 5]);
    }
}
