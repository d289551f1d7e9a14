//! PCD files written by others.

#![allow(clippy::unwrap_used)]

use stillpoint_ingest::pcd::read;
use stillpoint_testing::reference;

#[test]
fn files_of_other_writers_are_read_with_their_valid_points() {
    let Some(root) = reference::folder("perception/real") else { return };
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
