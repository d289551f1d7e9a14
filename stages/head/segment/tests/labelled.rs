//! Plane and prism on measured table-top scenes whose points are labelled (mOSD): 0 nothing, 1 to 9 a
//! piece of the table, more an object.

#![allow(clippy::unwrap_used, clippy::panic)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use stillpoint_segment::voxel::VoxelGrid;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Rule};

use stillpoint_testing::reference;

/// Labels from here on are objects.
const OBJECT: u32 = 10;

/// The labels of a binary_compressed file whose first field they are.
fn labels(file: &[u8], points: usize) -> Vec<u32> {
    let mark = b"DATA binary_compressed\n";
    let start = file.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    let packed_size = u32::from_le_bytes(file[start..start + 4].try_into().unwrap()) as usize;
    let packed = &file[start + 8..start + 8 + packed_size];
    let (mut bytes, mut at) = (Vec::<u8>::new(), 0);
    // LZF: runs as they are, and copies of what came before. The labels come first.
    while bytes.len() < 4 * points {
        let control = usize::from(packed[at]);
        at += 1;
        if control < 32 {
            bytes.extend_from_slice(&packed[at..=at + control]);
            at += control + 1;
        } else {
            let mut length = control >> 5;
            if length == 7 {
                length += usize::from(packed[at]);
                at += 1;
            }
            let from = bytes.len() - ((control & 31) << 8) - usize::from(packed[at]) - 1;
            at += 1;
            (from..from + length + 2).for_each(|i| bytes.push(bytes[i]));
        }
    }
    bytes[..4 * points].chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect()
}

/// Intersection over union of two sets of points.
fn iou(pairs: impl Iterator<Item = (bool, bool)>) -> f64 {
    let (mut both, mut either) = (0.0, 0.0);
    for (a, b) in pairs {
        both += f64::from(u8::from(a && b));
        either += f64::from(u8::from(a || b));
    }
    both / either
}

#[test]
fn table_and_objects_are_told_apart() {
    let Some(root) = reference::folder("perception/real") else { return };
    for name in ["mOSD_learn0", "mOSD_test60"] {
        let file = std::fs::read(root.join(format!("{name}.pcd"))).unwrap();
        let cloud = stillpoint_ingest::pcd::read(&file).unwrap();
        let labels = labels(&file, cloud.points.len());
        let params =
            FaceParams { range_max: 2.5, height_max: 0.5, rule: Rule::Largest, ..FaceParams::default() };
        let mut segmenter = FaceSegmenter::new(params).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let seen = segmenter.segment(Cloud { points: &cloud.points, width: 640 }, &mut rng);
        let plane = seen.plane.unwrap().plane;
        // As the reference counts: in voxels, each with the label of most of its points, and without those that have
        // none.
        let mut grid = VoxelGrid::new();
        grid.downsample(Cloud::unorganised(&cloud.points), params.leaf, params.range_max);
        let mut votes = vec![[0_u32; 3]; grid.centroids().len()];
        for (&voxel, &label) in grid.voxel_of_point().iter().zip(&labels) {
            if let Some(votes) = votes.get_mut(voxel as usize) {
                votes[usize::from(label > 0) + usize::from(label >= OBJECT)] += 1;
            }
        }
        let kind = |votes: &[u32; 3]| (0..3).max_by_key(|&kind| votes[kind]).unwrap();
        let voxels = || grid.centroids().iter().zip(votes.iter().map(kind)).filter(|(_, kind)| *kind > 0);
        let stands = |p: &[f32; 3]| {
            (params.height_min..=params.height_max).contains(&plane.height(*p)) && seen.hull.contains(*p)
        };
        let lies = |p: &[f32; 3]| plane.height(*p).abs() <= params.plane_tolerance;
        let table = iou(voxels().map(|(p, kind)| (lies(p), kind == 1)));
        let objects = iou(voxels().map(|(p, kind)| (stands(p), kind == 2)));
        eprintln!("{name}: table {table:.4}, objects {objects:.4}");
        assert!(table >= 0.97 && objects >= 0.90, "{name}: {table} {objects}");
    }
}
