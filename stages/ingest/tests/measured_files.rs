//! PCD files written by others. They are looked for in `$STILLPOINT_DATA`, else in `../shared/data` beside the workspace.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use stillpoint_ingest::pcd::read;

#[test]
fn files_of_other_writers_are_read_with_their_valid_points() {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("STILLPOINT_DATA").map_or(beside, PathBuf::from).join("perception/real");
    if !root.is_dir() {
        eprintln!("skipped: no perception data; STILLPOINT_DATA names the folder that holds `perception`");
        return;
    }
    // Width, height and, where every point is known to be valid, their number.
    for (name, width, height, all_valid) in [
        ("table_scene_mug_stereo_textured.pcd", 640, 480, false),
        ("milk_cartoon_all_small_clorox.pcd", 640, 480, false),
        ("mOSD_learn0.pcd", 640, 480, false),
        ("mOSD_test60.pcd", 640, 480, false),
        ("person.pcd", 640, 480, false),
        ("object_template_0.pcd", 1397, 1, true),
        ("object_template_1.pcd", 1552, 1, true),
    ] {
        let cloud = read(&std::fs::read(root.join(name)).unwrap()).unwrap();
        let valid = cloud.points.iter().filter(|p| p[0].is_finite()).count();
        assert_eq!((cloud.width, cloud.height), (width, height), "{name}");
        assert_eq!(valid == width * height, all_valid, "{name}: {valid} valid points");
        assert!(valid > width * height / 4, "{name}: {valid} valid points");
    }
}
