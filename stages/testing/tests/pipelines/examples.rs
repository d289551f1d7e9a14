//! `examples/`: each one checks and runs on the data beside it.

use stillpoint_pipeline::files::DiskFiles;
use stillpoint_samples::{Pose, Track};
use stillpoint_testing::{Run, run};

use crate::{from_root, registry};

fn example(name: &str, ms: u64) -> Run {
    let path = from_root("examples").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    let run =
        run(&text, &registry(), &DiskFiles::beside(&path), ms).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(run.failed(), [] as [&str; 0], "{name}");
    run
}

#[test]
fn every_example_checks_and_runs() {
    let mut seen = 0;
    for entry in std::fs::read_dir(from_root("examples")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.ends_with(".yaml") {
            example(&name, 200);
            seen += 1;
        }
    }
    assert!(seen >= 2);
}

#[test]
fn a_folder_of_depth_images_becomes_a_track() {
    let run = example("own-recording.yaml", 1000);
    let tracks = run.samples::<Track>("filter.state");
    assert_eq!(tracks.len(), 6);
    // The head of the rig lies on its pad: its face is 100 to 250 mm over the couch.
    let height = tracks[5].first().unwrap().position[2];
    assert!(height > 0.1 && height < 0.25, "{height} m");
}

#[test]
fn the_same_clouds_from_files_and_from_a_recording_have_the_same_positions() {
    let run = example("own-cloud.yaml", 3000);
    let positions = |topic: &str| -> Vec<[f64; 3]> {
        run.samples::<Pose>(topic).iter().map(|p| p.first().unwrap().position).collect()
    };
    let (files, bag) = (positions("files_head.position"), positions("bag_head.position"));
    assert_eq!((files.len(), bag.len()), (2, 3));
    for (a, b) in files.iter().zip(&bag) {
        // Each operator has random numbers of its own, so the planes differ a little.
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 2e-3), "{a:?} {b:?}");
    }
}

#[test]
fn the_data_of_the_examples_stays_small() {
    fn size(path: &std::path::Path) -> u64 {
        let entries = std::fs::read_dir(path).unwrap().map(|e| e.unwrap());
        entries.map(|e| if e.path().is_dir() { size(&e.path()) } else { e.metadata().unwrap().len() }).sum()
    }
    let bytes = size(&from_root("examples/data"));
    assert!(bytes < 2_000_000, "{bytes} bytes");
}
