//! How much water the beam has passed: radiological depth.

use super::frame::BeamFrame;
use super::siddon::segments;
use stillpoint_patient::Grid;

/// Density above which a line has met the skin.
const SKIN_DENSITY: f32 = 0.05;

/// Radiological depths (mm of water) of voxels, in their order.
///
/// Lines from the source cross a plane behind the volume on a square lattice, 1/sqrt(2) of the least voxel spacing
/// apart; each voxel takes the depth on the line nearest to its centre, in the middle of what that line crosses of the
/// voxel. The nearest line always crosses it: it passes the centre by less than half a spacing. Siddon 1985 traces it.
pub(crate) fn depths_mm(grid: &Grid, density: &[f32], frame: &BeamFrame, voxels: &[LitVoxel]) -> Vec<f64> {
    let spacing_mm =
        grid.spacing_mm.into_iter().fold(f64::INFINITY, f64::min) * std::f64::consts::FRAC_1_SQRT_2;
    let plane_mm = farthest_mm(grid, frame) + grid.spacing_mm.into_iter().fold(0.0, f64::max);
    let line = |voxel: &LitVoxel| {
        let [x, y, z] = voxel.beam_mm;
        [z, x].map(|mm| (mm * plane_mm / (y * spacing_mm) - 0.5).ceil() as i32)
    };
    let mut by_line: Vec<([i32; 2], usize)> = voxels.iter().map(line).zip(0..).collect();
    by_line.sort_unstable();

    const NONE: (u32, u32) = (u32::MAX, 0);
    let mut taker = vec![NONE; grid.len()];
    let mut depths = vec![0.0; voxels.len()];
    let source = frame.source_mm();
    for (number, takers) in by_line.chunk_by(|a, b| a.0 == b.0).enumerate() {
        for &(_, place) in takers {
            taker[voxels[place].row as usize] = (number as u32, place as u32);
        }
        let [z, x] = takers[0].0.map(|step| f64::from(step) * spacing_mm);
        let end = frame.patient_from_beam([x, plane_mm, z]);
        let length_mm = distance(source, end);
        let (mut water, mut left) = (0.0, takers.len());
        for segment in segments(grid, source, end) {
            let of_voxel = (segment.end - segment.begin) * length_mm * f64::from(density[segment.voxel]);
            let (line, place) = taker[segment.voxel];
            if line == number as u32 {
                depths[place as usize] = water + 0.5 * of_voxel;
                left -= 1;
                if left == 0 {
                    break;
                }
            }
            water += of_voxel;
        }
    }
    depths
}

/// A voxel near a beam.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LitVoxel {
    /// Its place in the dose grid.
    pub row: u32,
    /// Its centre in the beam's frame, mm.
    pub beam_mm: [f64; 3],
}

/// Distance from the source to the skin along the line through a place of the isocentre plane, mm; `None` where it
/// meets none.
pub(crate) fn skin_distance_mm(
    grid: &Grid,
    density: &[f32],
    frame: &BeamFrame,
    [x, z]: [f64; 2],
) -> Option<f64> {
    let (source, beyond) =
        (frame.source_mm(), frame.patient_from_beam([2.0 * x, 2.0 * frame.sad_mm(), 2.0 * z]));
    let skin = segments(grid, source, beyond).find(|segment| density[segment.voxel] > SKIN_DENSITY)?;
    Some(skin.begin * distance(source, beyond))
}

/// How far from the source the farthest voxel centre lies along the beam's axis, mm.
fn farthest_mm(grid: &Grid, frame: &BeamFrame) -> f64 {
    corners(grid).map(|corner| frame.beam_from_patient(corner)[1]).fold(f64::NEG_INFINITY, f64::max)
}

/// Centres of the eight corner voxels, mm.
pub(crate) fn corners(grid: &Grid) -> impl Iterator<Item = [f64; 3]> {
    (0..8).map(|corner| {
        grid.centre_mm(std::array::from_fn(
            |axis| if corner >> axis & 1 == 0 { 0 } else { grid.counts[axis] - 1 },
        ))
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    libm::sqrt((0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum())
}
