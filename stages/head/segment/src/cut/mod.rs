//! Minimum cut of a graph with two terminals, by augmenting paths between two search trees (Boykov and Kolmogorov, 2004).
//!
//! The trees grow from the nodes that tend to either terminal until they meet. After each augmentation they are
//! repaired instead of grown again. Here most nodes tend to one terminal, so paths are short and little is searched
//! twice. Capacities are whole numbers, so the cut is exact and the same on every machine. Libraries build a new graph
//! for each cut; this code keeps its buffers from frame to frame.
//!
//! - `graph`: nodes, edges, and what can still flow.
//! - `trees`: the two trees over it.

mod graph;
#[cfg(test)]
mod tests;
mod trees;

pub use graph::Lean;
pub use trees::MinCut;
