//! What live runs may take of shared memory.

use stillpoint_operator::files::DiskFiles;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::live::contracts;

use crate::{from_root, registry};

/// What Docker gives a container.
const SHARED: usize = 64 << 20;
/// Left for the transport's own files.
const ASIDE: usize = 2 << 20;

#[test]
fn each_pipeline_that_ships_fits_in_64_mb_of_shared_memory() {
    let listed = std::fs::read_dir(from_root("examples")).unwrap().map(|entry| entry.unwrap().path());
    let examples = listed.filter(|path| path.extension().is_some_and(|e| e == "yaml"));
    let mut seen = 0;
    for path in examples.chain([from_root("pipeline.yaml")]) {
        let text = std::fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy();
        let graph = check(&text, &name, &[], &registry(), &DiskFiles::next_to(&path)).unwrap();
        let needed: usize = contracts::all(&graph).iter().map(|c| c.pool_bytes()).sum();
        eprintln!("{name}: {:.1} MiB", needed as f64 / f64::from(1 << 20));
        assert!(needed + ASIDE <= SHARED, "{name} may take {} MiB", needed.div_ceil(1 << 20));
        seen += 1;
    }
    assert!(seen > 5);
}
