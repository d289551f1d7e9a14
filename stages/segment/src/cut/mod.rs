//! Minimum cut of a graph with two terminals, by augmenting paths between two search trees (Boykov and Kolmogorov, 2004).
//!
//! The trees grow from the nodes that lean to either terminal until they meet, and are mended after each augmentation
//! instead of grown anew: where most nodes lean one way or the other, as here, paths are short and little is searched twice.
//! Capacities are whole numbers, so the cut is exact and the same on every machine. Libraries for this build a graph anew
//! for each cut; this one keeps its buffers from frame to frame.
//!
//! - `graph`: nodes, edges, and what can still flow.
//! - `trees`: the two trees over it.

mod graph;
#[cfg(test)]
mod tests;
mod trees;

pub use graph::Lean;
pub use trees::MinCut;
