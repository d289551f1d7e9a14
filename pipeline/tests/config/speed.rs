//! How long a check takes. Printed, not asserted: the machine may be shared.

use std::fmt::Write;
use std::time::Instant;

use stillpoint_pipeline::config::check;

use crate::disk::Disk;
use crate::kinds::registry;

/// A pipeline of this many operators.
pub fn chain(operators: usize) -> String {
    let mut text = String::from(
        "stillpoint: 1\nname: chain\noperators:\n  rig: { use: rig.three_bladders, every: 33 ms }\n  \
         fused_0: { use: estimate.fuse, inputs: { a: rig.truth, b: rig.truth } }\n",
    );
    for i in 1..operators - 1 {
        let _ = writeln!(
            text,
            "  fused_{i}: {{ use: estimate.fuse, inputs: {{ a: fused_{p}.pose, b: rig.truth, hint: {{ from: rig.truth, \
             delay: 3 ms }} }}, latency: 2 ms }}",
            p = i - 1
        );
    }
    text
}

#[test]
fn a_hundred_operators_are_checked() {
    let text = chain(100);
    let registry = registry();
    let start = Instant::now();
    let graph = check(&text, "chain.yaml", &[], &registry, &Disk).ok().unwrap();
    println!("checked {} operators in {:.2} ms", graph.operators.len(), start.elapsed().as_secs_f64() * 1e3);
    assert_eq!(graph.operators.len(), 100);
}
