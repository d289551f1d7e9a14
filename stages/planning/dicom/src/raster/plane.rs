//! The contours of one plane as one region.

use super::contour::{Contour, ContourKind, Outline};
use super::spans::{Spans, even_odd, subtract, unite};

/// How the contours of a plane combine.
pub(super) struct Plane<'a> {
    /// All that hold area, those that count once first.
    outlines: Vec<Outline<'a>>,
    /// For each that counts, in the order of rising height: the outlines that it is a hole in, and whether it is in none.
    nested: Vec<Nested>,
    /// Contours that repeat another.
    pub repeated: usize,
    /// Whether the contours are combined by exclusive or.
    pub exclusive: bool,
}

struct Nested {
    outline: usize,
    holes: Vec<usize>,
    is_outermost: bool,
}

impl<'a> Plane<'a> {
    pub fn of(contours: &[&'a Contour]) -> Self {
        let exclusive = contours.iter().any(|c| c.kind == ContourKind::Xor);
        let mut all: Vec<Outline<'a>> = contours.iter().filter_map(|c| Outline::of(c)).collect();
        all.sort_by(|a, b| a.low[0].total_cmp(&b.low[0]));
        let (mut once, mut duplicates): (Vec<Outline<'a>>, Vec<Outline<'a>>) = (Vec::new(), Vec::new());
        for outline in all {
            // Sorted by their left ends, identical contours are near each other.
            let near = once.iter().rev().take_while(|o| o.low[0] >= outline.low[0] - 1.0);
            let known = near.into_iter().any(|o| o.is_same(&outline));
            if known { duplicates.push(outline) } else { once.push(outline) }
        }
        let nested = if exclusive { Vec::new() } else { nest(&once) };
        let repeated = duplicates.len();
        once.extend(duplicates);
        Self { outlines: once, nested, repeated, exclusive }
    }

    /// The rectangle around all contours.
    pub fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let around = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
            [[a[0][0].min(b[0][0]), a[0][1].min(b[0][1])], [a[1][0].max(b[1][0]), a[1][1].max(b[1][1])]]
        };
        self.outlines.iter().map(|o| [o.low, o.high]).reduce(around)
    }

    /// Calls `row` with each row that the region meets: `count` rows from `first_mm`, `step_mm` apart.
    pub fn region(&self, first_mm: f64, step_mm: f64, count: usize, mut row: impl FnMut(usize, &[[f64; 2]])) {
        self.rows(first_mm, step_mm, count, |place, region| row(place, &region.spans));
    }

    /// As [`Plane::region`], with what else the contours could mean.
    pub fn rows(&self, first_mm: f64, step_mm: f64, count: usize, mut row: impl FnMut(usize, &Row)) {
        let crossings: Vec<_> =
            self.outlines.iter().map(|o| Crossings::of(o, first_mm, step_mm, count)).collect();
        for place in 0..count {
            let met: Vec<usize> =
                (0..crossings.len()).filter(|&i| !crossings[i].at(place).is_empty()).collect();
            if met.is_empty() {
                continue;
            }
            let exclusive = even_odd(met.iter().flat_map(|&i| crossings[i].at(place)).copied().collect());
            if self.exclusive {
                row(place, &Row { spans: exclusive.clone(), exclusive, shared_mm: 0.0 });
                continue;
            }
            let mut parts: Vec<Spans> = vec![Vec::new(); self.nested.len()];
            let mut outermost: Spans = Vec::new();
            for (i, nested) in self.nested.iter().enumerate() {
                let own = even_odd(crossings[nested.outline].at(place).to_vec());
                let holes: Spans =
                    nested.holes.iter().flat_map(|&hole| parts[hole].iter().copied()).collect();
                parts[i] = subtract(&own, &unite(holes));
                if nested.is_outermost {
                    outermost.extend(&parts[i]);
                }
            }
            let apart: f64 = super::spans::length(&outermost);
            let spans = unite(outermost);
            let shared_mm = apart - super::spans::length(&spans);
            row(place, &Row { spans, exclusive, shared_mm });
        }
    }
}

/// One row of a plane.
pub(super) struct Row {
    /// What is inside.
    pub spans: Spans,
    /// What were inside if all contours were combined by exclusive or.
    pub exclusive: Spans,
    /// Length that more than one outermost contour holds.
    pub shared_mm: f64,
}

/// Which outlines are holes in which: the outlines in an order in which holes come first.
fn nest(outlines: &[Outline<'_>]) -> Vec<Nested> {
    let extent = |i: usize| {
        let o = &outlines[i];
        (o.high[0] - o.low[0]) * (o.high[1] - o.low[1])
    };
    let mut order: Vec<usize> = (0..outlines.len()).collect();
    order.sort_by(|&a, &b| extent(a).total_cmp(&extent(b)).then(a.cmp(&b)));
    // For each outline the places in the order of those that it lies in, which all come later.
    let around: Vec<Vec<usize>> = (0..order.len())
        .map(|inner| {
            let within = |outer: &usize| outlines[order[inner]].is_within(&outlines[order[*outer]]);
            (inner + 1..order.len()).filter(within).collect()
        })
        .collect();
    let mut nested: Vec<Nested> = order
        .iter()
        .zip(&around)
        .map(|(&outline, around)| Nested { outline, holes: Vec::new(), is_outermost: around.is_empty() })
        .collect();
    for (inner, outers) in around.iter().enumerate() {
        for &outer in outers {
            // A contour is a hole in the next one around it; what lies farther out has that one as its hole.
            if !outers.iter().any(|&between| around[between].contains(&outer)) {
                nested[outer].holes.push(inner);
            }
        }
    }
    nested
}

/// Where the edges of an outline cross the rows.
struct Crossings {
    first: usize,
    rows: Vec<Vec<f64>>,
}

impl Crossings {
    fn of(outline: &Outline<'_>, first_mm: f64, step_mm: f64, count: usize) -> Self {
        let y_mm = |row: usize| first_mm + row as f64 * step_mm;
        let place = |y: f64| ((y - first_mm) / step_mm).clamp(0.0, count as f64);
        let first = (libm::floor(place(outline.low[1])) as usize).saturating_sub(1);
        let last = (libm::ceil(place(outline.high[1])) as usize + 1).min(count);
        let mut rows = vec![Vec::new(); last.saturating_sub(first)];
        for [[x0, y0], [x1, y1]] in outline.edges() {
            let (low, high) = (y0.min(y1), y0.max(y1));
            let from = (libm::floor(place(low)) as usize).saturating_sub(1).max(first);
            for row in from..last {
                let y = y_mm(row);
                if y > high {
                    break;
                }
                // Each edge has its lower end and not its upper: a corner is crossed once.
                if (y0 <= y) != (y1 <= y) {
                    rows[row - first].push(x0 + (y - y0) / (y1 - y0) * (x1 - x0));
                }
            }
        }
        Self { first, rows }
    }

    fn at(&self, row: usize) -> &[f64] {
        row.checked_sub(self.first).and_then(|row| self.rows.get(row)).map_or(&[], Vec::as_slice)
    }
}
