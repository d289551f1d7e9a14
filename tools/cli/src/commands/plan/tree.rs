//! The tree of a search as SVG: which sets were reached from which, how many solves each took, and the way to the best.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use stillpoint_plan::beams::{BeamSet, Directions, Progress};

/// Rows of a drawing at most, but for the way to the best set.
const ROWS: usize = 40;
/// Steps to the right at most: deeper sets stand below each other.
const DEEPEST: usize = 10;
/// Height of a row, a step to the right, and where cost and bar begin, pixels.
const ROW: usize = 20;
const STEP: usize = 20;
const COST: usize = 560;
const BAR: usize = 580;
const WIDTH: usize = 960;

/// A set of as many beams as the plan has.
struct Node {
    /// Its solve, from 0.
    solve: usize,
    /// The node from which it was reached.
    parent: Option<usize>,
    /// Solves that were made from it or from a set below it, smaller sets included.
    below: usize,
}

/// The drawing; none where no set was solved from another one.
pub fn drawing(directions: &Directions, beams: usize, history: &[Progress]) -> Option<String> {
    let nodes = nodes(beams, history);
    let best = (0..nodes.len()).min_by(|a, b| {
        let cost = |node: &usize| history[nodes[*node].solve].cost;
        cost(a).total_cmp(&cost(b))
    })?;
    if nodes.iter().all(|node| node.below == 0) {
        return None;
    }
    let path: BTreeSet<usize> = std::iter::successors(Some(best), |node| nodes[*node].parent).collect();
    let shown = shown(&nodes, &path);
    let mut rows = Vec::new();
    for root in shown.iter().filter(|node| nodes[**node].parent.is_none()) {
        list(&nodes, &shown, *root, 0, &mut rows);
    }
    let most = nodes.iter().map(|node| node.below).max().unwrap_or(1);
    let mut svg = String::new();
    for (place, (node, depth)) in rows.iter().enumerate() {
        let (y, x) = (ROW * (place + 2), 8 + STEP * depth.min(&DEEPEST));
        let Node { solve, parent, below } = &nodes[*node];
        let text = match parent {
            Some(parent) => {
                exchanged(directions, &history[nodes[*parent].solve].beams, &history[*solve].beams)
            }
            None => degrees(directions, history[*solve].beams.beams()),
        };
        let weight = if path.contains(node) { "bold" } else { "normal" };
        let mark = if *node == best { ", the best" } else { "" };
        let width = (WIDTH - BAR - 90) * below / most;
        let _ = write!(
            svg,
            "<text x=\"{x}\" y=\"{y}\" font-weight=\"{weight}\">{text}</text>\
             <text x=\"{COST}\" y=\"{y}\" text-anchor=\"end\" font-weight=\"{weight}\">{:.2}</text>\
             <rect x=\"{BAR}\" y=\"{}\" width=\"{width}\" height=\"12\" fill=\"#0072B2\"/>\
             <text x=\"{}\" y=\"{y}\">{below}{mark}</text>",
            history[*solve].cost,
            y - 11,
            BAR + width + 6
        );
    }
    let left_out = nodes.iter().filter(|node| node.below > 0).count();
    let left_out = left_out - rows.iter().filter(|(node, _)| nodes[*node].below > 0).count();
    let mut height = ROW * (rows.len() + 2);
    if left_out > 0 {
        let _ = write!(svg, "<text x=\"8\" y=\"{height}\">and {left_out} sets with fewer solves</text>");
        height += ROW;
    }
    Some(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         role=\"img\" aria-label=\"tree of the search\" font-family=\"sans-serif\" font-size=\"13\" fill=\"#000000\">\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#FFFFFF\"/>\
         <text x=\"8\" y=\"{ROW}\">beams, degrees</text>\
         <text x=\"{COST}\" y=\"{ROW}\" text-anchor=\"end\">objective</text>\
         <text x=\"{BAR}\" y=\"{ROW}\">solves below</text>{svg}</svg>\n"
    ))
}

/// The sets of a whole plan, in the order of their solves.
fn nodes(beams: usize, history: &[Progress]) -> Vec<Node> {
    let at: BTreeMap<&BeamSet, usize> = history.iter().enumerate().map(|(i, p)| (&p.beams, i)).collect();
    let is_whole = |solve: usize| history[solve].beams.beams().len() == beams;
    let from = |solve: usize| {
        // Only what was solved before: a search never goes in circles.
        history[solve].from.as_ref().and_then(|from| at.get(from).copied()).filter(|from| *from < solve)
    };
    let whole_above =
        |solve: usize| std::iter::successors(from(solve), |above| from(*above)).find(|at| is_whole(*at));
    let mut nodes: Vec<Node> = Vec::new();
    let mut of_solve: BTreeMap<usize, usize> = BTreeMap::new();
    for solve in 0..history.len() {
        let parent = whole_above(solve).and_then(|above| of_solve.get(&above).copied());
        let mut above = parent;
        while let Some(node) = above {
            nodes[node].below += 1;
            above = nodes[node].parent;
        }
        if is_whole(solve) {
            of_solve.insert(solve, nodes.len());
            nodes.push(Node { solve, parent, below: 0 });
        }
    }
    nodes
}

/// The nodes with the most solves below them, as many as there is room for, and the way to the best set. What stands above a
/// node has more solves than it, so that no row hangs in the air.
fn shown(nodes: &[Node], path: &BTreeSet<usize>) -> BTreeSet<usize> {
    let with = |least: usize| (0..nodes.len()).filter(move |node| nodes[*node].below >= least);
    let most = nodes.iter().map(|node| node.below).max().unwrap_or(0);
    let least = (1..=most).find(|least| with(*least).count() <= ROWS).unwrap_or(most + 1);
    with(least).chain(path.iter().copied()).collect()
}

fn list(nodes: &[Node], shown: &BTreeSet<usize>, node: usize, depth: usize, rows: &mut Vec<(usize, usize)>) {
    rows.push((node, depth));
    for child in shown.iter().filter(|child| nodes[**child].parent == Some(node)) {
        list(nodes, shown, *child, depth + 1, rows);
    }
}

/// The beams that left and those that came.
fn exchanged(directions: &Directions, from: &BeamSet, to: &BeamSet) -> String {
    let without = |set: &BeamSet, other: &BeamSet| -> Vec<u16> {
        set.beams().iter().copied().filter(|beam| !other.beams().contains(beam)).collect()
    };
    format!(
        "{} \u{2192} {}",
        degrees(directions, &without(from, to)),
        degrees(directions, &without(to, from))
    )
}

fn degrees(directions: &Directions, beams: &[u16]) -> String {
    let degrees: Vec<String> = directions.all(beams).iter().map(|angles| format!("{angles}\u{b0}")).collect();
    degrees.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_plan::beams::Ring;

    /// Solves of these sets, each from one of the sets before it.
    fn history(ring: Ring, solves: &[(&[u16], Option<usize>, f64)]) -> Vec<Progress> {
        let set = |place: usize| ring.set(solves[place].0).unwrap();
        let one = |place: usize| Progress {
            solves: place + 1,
            prices: 0,
            cost: solves[place].2,
            best: 0.0,
            beams: set(place),
            from: solves[place].1.map(set),
        };
        (0..solves.len()).map(one).collect()
    }

    #[test]
    fn a_tree_has_the_exchanges_the_solves_below_each_set_and_the_way_to_the_best() {
        let ring = Ring::new(90, 5).unwrap();
        let solves: [(&[u16], _, _); 7] = [
            (&[0, 20, 40], None, 9.0),
            (&[20, 40], Some(0), 12.0),
            (&[10, 20, 40], Some(1), 8.0),
            (&[50, 20, 40], Some(1), 10.0),
            (&[10, 20], Some(2), 11.0),
            (&[10, 20, 60], Some(4), 7.0),
            (&[70, 30, 80], None, 9.5),
        ];
        let history = history(ring, &solves);
        let nodes = nodes(3, &history);
        let reported: Vec<_> = nodes.iter().map(|node| (node.solve, node.parent, node.below)).collect();
        assert_eq!(reported, [(0, None, 5), (2, Some(0), 2), (3, Some(0), 0), (5, Some(1), 0), (6, None, 0)]);
        let svg = drawing(&ring.into(), 3, &history).unwrap();
        for text in [
            "bold\">0\u{b0} 80\u{b0} 160\u{b0}<",
            "bold\">0\u{b0} \u{2192} 40\u{b0}<",
            "bold\">160\u{b0} \u{2192} 240\u{b0}<",
            ">0, the best<",
        ] {
            assert!(svg.contains(text), "{text} in {svg}");
        }
        // What led nowhere has no row.
        assert!(!svg.contains("200\u{b0}") && !svg.contains("280\u{b0}"), "{svg}");
    }

    #[test]
    fn sets_of_which_none_was_solved_from_another_are_no_tree() {
        let ring = Ring::new(90, 5).unwrap();
        assert_eq!(
            drawing(&ring.into(), 2, &history(ring, &[(&[0, 20], None, 9.0), (&[5, 30], None, 8.0)])),
            None
        );
        assert_eq!(drawing(&ring.into(), 2, &[]), None);
    }

    #[test]
    fn a_long_search_has_the_rows_of_its_most_solves_and_the_best_set() {
        let ring = Ring::new(90, 1).unwrap();
        let sets: Vec<[u16; 2]> =
            (0..90).flat_map(|a| [[a, (a + 1) % 90], [a, (a + 2) % 90], [a, (a + 3) % 90]]).collect();
        // Every third set is a beginning, and the two behind it are solved from it; the last one is the best.
        let solves: Vec<(&[u16], Option<usize>, f64)> = sets
            .iter()
            .enumerate()
            .map(|(i, set)| (&set[..], (i % 3 > 0).then_some(i - i % 3), 1000.0 - i as f64))
            .collect();
        let svg = drawing(&ring.into(), 2, &history(ring, &solves)).unwrap();
        // Too many have as many solves below: only the way to the best is left.
        assert_eq!(svg.matches("<rect").count(), 1 + 2);
        assert!(svg.contains("and 89 sets with fewer solves") && svg.contains("the best"), "{svg}");
    }
}
