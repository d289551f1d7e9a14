//! The operators of a session and who feeds whom, as a drawing.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::escape::escape;
use super::wiring::Wiring;

/// Height of a box, and the room between two.
const HIGH: f64 = 30.0;
const BETWEEN: f64 = 14.0;
const ACROSS: f64 = 46.0;
/// Width of a letter, about, and the room beside a name.
const LETTER: f64 = 7.8;
const LATERAL: f64 = 20.0;
/// A drawing of more operators would not be read.
const MOST: usize = 120;

/// The drawing as SVG; `None` where there is nothing to draw, or too much.
pub fn svg(wiring: &Wiring) -> Option<String> {
    let stages = wiring.stages();
    if stages.is_empty() || stages.len() > MOST {
        return None;
    }
    let edges = edges(wiring);
    let columns = columns(stages.len(), &edges);
    let wide = |column: usize| {
        let names =
            stages.iter().zip(&columns).filter(|(_, c)| **c == column).map(|(s, _)| s.name.chars().count());
        names.max().unwrap_or(0) as f64 * LETTER + LATERAL
    };
    let count = columns.iter().max().map_or(0, |c| c + 1);
    let mut lefts = vec![1.0];
    (0..count).for_each(|c| lefts.push(lefts[c] + wide(c) + ACROSS));
    let rows = rows(&columns, &edges, count);
    let deepest = rows.iter().copied().fold(0.0, f64::max);
    let top = |stage: usize| 1.0 + rows[stage] * (HIGH + BETWEEN);
    let (width, height) = (lefts[count] - ACROSS + 2.0, 2.0 + deepest * (HIGH + BETWEEN) + HIGH + 26.0);
    let mut out = format!(
        "<svg width=\"{width:.0}\" height=\"{height:.0}\" viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" \
         font-family=\"sans-serif\" font-size=\"13\">"
    );
    for (from, to) in &edges {
        let (x1, y1) = (lefts[columns[*from]] + wide(columns[*from]), top(*from) + HIGH / 2.0);
        let (x2, y2) = (lefts[columns[*to]], top(*to) + HIGH / 2.0);
        let path = if columns[*to] > columns[*from] {
            let middle = (x2 - x1) / 2.0;
            format!("M{x1:.0} {y1:.0}C{:.0} {y1:.0} {:.0} {y2:.0} {x2:.0} {y2:.0}", x1 + middle, x2 - middle)
        } else {
            // Back: below everything.
            let low = height - 6.0;
            format!("M{x1:.0} {y1:.0}C{:.0} {low:.0} {:.0} {low:.0} {x2:.0} {y2:.0}", x1 + 40.0, x2 - 40.0)
        };
        let dashed = if columns[*to] > columns[*from] { "" } else { " stroke-dasharray=\"5 4\"" };
        let _ = write!(out, "<path d=\"{path}\" fill=\"none\" stroke=\"var(--quiet)\"{dashed}/>");
    }
    for (stage, s) in stages.iter().enumerate() {
        let (x, y, w) = (lefts[columns[stage]], top(stage), wide(columns[stage]));
        let _ = write!(
            out,
            "<rect x=\"{x:.0}\" y=\"{y:.0}\" width=\"{w:.0}\" height=\"{HIGH}\" rx=\"5\" fill=\"var(--wash)\" \
             stroke=\"var(--quiet)\"/><text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\" fill=\"var(--ink)\">{}</text>",
            x + w / 2.0,
            y + 20.0,
            escape(&s.name)
        );
    }
    out.push_str("</svg>");
    Some(out)
}

/// Pairs of operators of which the first feeds the second.
fn edges(wiring: &Wiring) -> BTreeSet<(usize, usize)> {
    let stages = wiring.stages();
    let place = |topic: &String| stages.iter().position(|s| s.outputs.contains(topic));
    let mut edges = BTreeSet::new();
    for (to, stage) in stages.iter().enumerate() {
        edges.extend(stage.inputs.iter().filter_map(place).map(|from| (from, to)));
    }
    edges
}

/// The column of each operator: one behind the last that feeds it. Operators stand upstream first, so an edge from a later
/// one goes back and does not count.
fn columns(count: usize, edges: &BTreeSet<(usize, usize)>) -> Vec<usize> {
    let mut columns = vec![0; count];
    for to in 0..count {
        let before = edges.iter().filter(|(from, t)| *t == to && *from < to);
        columns[to] = before.map(|(from, _)| columns[*from] + 1).max().unwrap_or(0);
    }
    columns
}

/// The row of each operator: as near as there is room to the middle of those that feed it.
fn rows(columns: &[usize], edges: &BTreeSet<(usize, usize)>, count: usize) -> Vec<f64> {
    let mut rows = vec![0.0; columns.len()];
    for column in 0..count {
        let mut requested: Vec<(f64, usize)> = (0..columns.len())
            .filter(|s| columns[*s] == column)
            .enumerate()
            .map(|(place, s)| {
                let from: Vec<f64> = edges
                    .iter()
                    .filter(|(f, t)| *t == s && columns[*f] < column)
                    .map(|(f, _)| rows[*f])
                    .collect();
                let middle = from.iter().sum::<f64>() / from.len().max(1) as f64;
                (if from.is_empty() { place as f64 } else { middle }, s)
            })
            .collect();
        requested.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut free = 0.0;
        for (row, stage) in requested {
            rows[stage] = f64::max(row, free);
            free = rows[stage] + 1.0;
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operators_stand_behind_those_that_feed_them_and_never_upon_each_other() {
        // Two cameras, a filter each, one fused track that goes back to the first camera.
        let edges = BTreeSet::from([(0, 2), (1, 3), (2, 4), (3, 4), (4, 0)]);
        let columns = columns(5, &edges);
        assert_eq!(columns, [0, 0, 1, 1, 2]);
        let rows = rows(&columns, &edges, 3);
        assert_eq!(rows, [0.0, 1.0, 0.0, 1.0, 0.5]);
    }
}
