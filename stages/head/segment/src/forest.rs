//! Sets of nodes that hang together, as trees of parents.

/// The root of a node's tree, with the path to it halved. A root is its own parent.
pub(crate) fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        parents[node as usize] = parents[parents[node as usize] as usize];
        node = parents[node as usize];
    }
    node
}

/// Joins the trees of two nodes; the lesser root is that of both.
pub(crate) fn unite(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}
