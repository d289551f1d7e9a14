//! Lines of one level through values on a lattice, by marching squares.

use std::collections::BTreeMap;

/// An edge of the lattice: the node that it begins at, and whether it runs along y.
type Edge = (usize, usize, bool);

/// Lines along which the values of a lattice of `[nx, ny]` nodes have this level, in units of the lattice. Lines that end at
/// the border are open; the others come back to where they begin.
pub fn isolines([nx, ny]: [usize; 2], value: impl Fn(usize, usize) -> f64, level: f64) -> Vec<Vec<[f64; 2]>> {
    let mut next: BTreeMap<Edge, Vec<Edge>> = BTreeMap::new();
    let mut join = |a: Edge, b: Edge| {
        next.entry(a).or_default().push(b);
        next.entry(b).or_default().push(a);
    };
    for y in 0..ny.saturating_sub(1) {
        for x in 0..nx.saturating_sub(1) {
            let corners = [value(x, y), value(x + 1, y), value(x + 1, y + 1), value(x, y + 1)];
            let above = corners.map(|v| v >= level);
            let edges: [Edge; 4] = [(x, y, false), (x + 1, y, true), (x, y + 1, false), (x, y, true)];
            let crossed: Vec<usize> = (0..4).filter(|k| above[*k] != above[(k + 1) % 4]).collect();
            match crossed[..] {
                [a, b] => join(edges[a], edges[b]),
                // Of a saddle the corners that the middle is like are joined.
                [_, _, _, _] => {
                    let middle = corners.iter().sum::<f64>() / 4.0 >= level;
                    let pairs = if middle == above[0] { [[0, 1], [2, 3]] } else { [[3, 0], [1, 2]] };
                    pairs.into_iter().for_each(|[a, b]| join(edges[a], edges[b]));
                }
                _ => {}
            }
        }
    }
    let place = |(x, y, along_y): Edge| {
        let (a, b) = (value(x, y), if along_y { value(x, y + 1) } else { value(x + 1, y) });
        let part = if b == a { 0.5 } else { ((level - a) / (b - a)).clamp(0.0, 1.0) };
        let (x, y) = (x as f64, y as f64);
        if along_y { [x, y + part] } else { [x + part, y] }
    };
    let mut lines = Vec::new();
    // Open lines first, each from an end.
    let ends: Vec<Edge> =
        next.iter().filter(|(_, others)| others.len() == 1).map(|(edge, _)| *edge).collect();
    let begins = ends.into_iter().chain(next.keys().copied().collect::<Vec<_>>());
    for begin in begins.collect::<Vec<_>>() {
        let mut line = Vec::new();
        let mut at = begin;
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            if let Some(back) = next.get_mut(&to) {
                back.iter().position(|edge| *edge == at).map(|place| back.swap_remove(place));
            }
            if line.is_empty() {
                line.push(place(at));
            }
            line.push(place(to));
            at = to;
        }
        if !line.is_empty() {
            lines.push(line);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_has_one_closed_line_at_its_radius() {
        let radius = |x: f64, y: f64| ((x - 10.2).powi(2) + (y - 9.7).powi(2)).sqrt();
        let lines = isolines([21, 20], |x, y| -radius(x as f64, y as f64), -6.0);
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].first(), lines[0].last());
        assert!(lines[0].len() > 30);
        for [x, y] in &lines[0] {
            assert!((radius(*x, *y) - 6.0).abs() < 0.05, "{x} {y}");
        }
    }

    #[test]
    fn a_slope_has_one_open_line_and_a_plain_none() {
        let lines = isolines([5, 4], |x, _| x as f64, 1.5);
        assert_eq!(lines.len(), 1);
        assert!(lines[0].len() == 4 && lines[0].iter().all(|[x, _]| *x == 1.5), "{lines:?}");
        assert!(isolines([5, 4], |_, _| 1.0, 2.0).is_empty() && isolines([0, 0], |_, _| 1.0, 0.5).is_empty());
    }

    #[test]
    fn a_saddle_is_two_lines() {
        let high = |x: usize, y: usize| if (x, y) == (1, 1) || (x, y) == (2, 2) { 1.0 } else { 0.0 };
        assert_eq!(isolines([4, 4], high, 0.6).len(), 2);
        assert_eq!(isolines([4, 4], high, 0.4).len(), 1);
    }
}
