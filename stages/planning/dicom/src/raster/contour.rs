//! One contour, and how two of them lie to each other.

/// Points are on a line, and contours identical, if they are this close, mm.
const SAME_MM: f64 = 0.01;

/// How a contour combines with the others of its plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ContourKind {
    /// `CLOSED_PLANAR`: united with others, or a hole in the one that it lies in.
    #[default]
    Closed,
    /// `CLOSEDPLANAR_XOR`: combined with all others by exclusive or.
    Xor,
}

/// A closed polygon across the patient.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Its plane, mm.
    pub z_mm: f64,
    /// Its corners, mm; the last is joined to the first.
    pub xy_mm: Vec<[f64; 2]>,
    /// How it combines with others.
    pub kind: ContourKind,
}

/// The corners of a contour with the rectangle around them.
#[derive(Clone, Copy)]
pub(super) struct Outline<'a> {
    pub corners: &'a [[f64; 2]],
    pub low: [f64; 2],
    pub high: [f64; 2],
}

impl<'a> Outline<'a> {
    /// `None` where the corners hold no area.
    pub fn of(contour: &'a Contour) -> Option<Self> {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for corner in &contour.xy_mm {
            for axis in 0..2 {
                low[axis] = low[axis].min(corner[axis]);
                high[axis] = high[axis].max(corner[axis]);
            }
        }
        let area = contour.xy_mm.len() > 2 && low[0] < high[0] && low[1] < high[1];
        area.then_some(Self { corners: &contour.xy_mm, low, high })
    }

    pub fn edges(&self) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
        let after = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(after).map(|(&a, &b)| [a, b])
    }

    /// Whether both have the same border: no corner of one is off the border of the other.
    pub fn is_same(&self, other: &Self) -> bool {
        let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|axis| (a[axis] - b[axis]).abs() <= SAME_MM);
        near(self.low, other.low)
            && near(self.high, other.high)
            && self.corners.iter().all(|&p| other.borders(p))
            && other.corners.iter().all(|&p| self.borders(p))
    }

    /// Whether this lies wholly inside the other; borders may touch.
    pub fn is_within(&self, other: &Self) -> bool {
        let nested = (0..2).all(|axis| {
            self.low[axis] >= other.low[axis] - SAME_MM && self.high[axis] <= other.high[axis] + SAME_MM
        });
        if !nested {
            return false;
        }
        let near = |[a, b]: [[f64; 2]; 2]| {
            (0..2)
                .all(|i| a[i].min(b[i]) <= self.high[i] + SAME_MM && a[i].max(b[i]) >= self.low[i] - SAME_MM)
        };
        // No border of the other is near: one point tells for all.
        if !other.edges().any(near) {
            return self.corners.first().is_some_and(|&p| other.contains(p));
        }
        let middle = |[a, b]: [[f64; 2]; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
        self.corners.iter().all(|&p| other.contains(p) || other.borders(p))
            && self.edges().map(middle).all(|p| other.contains(p) || other.borders(p))
            && !other.corners.iter().any(|&p| self.contains(p) && !self.borders(p))
            && !self.edges().any(|edge| other.edges().any(|border| cross(edge, border)))
    }

    /// Whether a point is inside, by the even-odd rule.
    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let right = |[[x0, y0], [x1, y1]]: [[f64; 2]; 2]| {
            (y0 <= y) != (y1 <= y) && x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        };
        self.edges().filter(|&edge| right(edge)).count() % 2 == 1
    }

    /// Whether a point is on the border.
    fn borders(&self, [x, y]: [f64; 2]) -> bool {
        self.edges().any(|[[x0, y0], [x1, y1]]| {
            let [dx, dy, px, py] = [x1 - x0, y1 - y0, x - x0, y - y0];
            let square = dx * dx + dy * dy;
            let along = if square > 0.0 { ((px * dx + py * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
            let [ex, ey] = [px - along * dx, py - along * dy];
            ex * ex + ey * ey <= SAME_MM * SAME_MM
        })
    }
}

/// Whether two edges cross, each with both of its ends clearly off the other's line.
fn cross([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let apart = (0..2).any(|i| a[i].max(b[i]) < c[i].min(d[i]) || c[i].max(d[i]) < a[i].min(b[i]));
    if apart {
        return false;
    }
    // Distance of a point from the line through two others; positive on its left.
    let off = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        let [dx, dy] = [q[0] - p[0], q[1] - p[1]];
        (dx * (r[1] - p[1]) - dy * (r[0] - p[0])) / libm::hypot(dx, dy)
    };
    let opposite = |s: f64, t: f64| s.abs() > SAME_MM && t.abs() > SAME_MM && (s > 0.0) != (t > 0.0);
    opposite(off(a, b, c), off(a, b, d)) && opposite(off(c, d, a), off(c, d, b))
}
