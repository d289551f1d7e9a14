//! The distance to a forehead: the dissertation's measurement with one degree of freedom (4.2.2), from a face found in
//! an image and the points that the pixels of its forehead show.

/// A face found in an image, in pixels; it may reach beyond the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceArea {
    /// First column.
    pub left: f64,
    /// First row.
    pub top: f64,
    /// Columns.
    pub width: f64,
    /// Rows.
    pub height: f64,
}

/// Which way the top of the head points in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeadTop {
    /// Up.
    Up,
    /// To the right.
    Right,
    /// Down.
    Down,
    /// To the left.
    Left,
}

/// What the pixels of a forehead say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forehead {
    /// Mean place across, and median distance along the optical axis, m.
    pub position: [f64; 3],
    /// Variance of that median, m2: from the median deviation of the points. It has the slope of the forehead in it.
    pub variance: f64,
    /// Points.
    pub count: usize,
}

/// Part of a face's box, from its top and between its sides, that is forehead: over the brows, under the hair.
const DOWN: [f64; 2] = [0.12, 0.28];
const ACROSS: [f64; 2] = [0.35, 0.65];
/// Points that a median needs.
const LEAST: usize = 12;
/// Standard deviation of normal errors over the median of their absolute values, and of their median over the mean's.
const NORMAL_OVER_MEDIAN: f64 = 1.4826;
const MEDIAN_OVER_MEAN: f64 = 1.2533;

impl FaceArea {
    /// The part of it that is forehead.
    #[must_use]
    pub fn forehead(&self, top: HeadTop) -> Self {
        let reversed = |[from, to]: [f64; 2]| [1.0 - to, 1.0 - from];
        let (u, v) = match top {
            HeadTop::Up => (ACROSS, DOWN),
            HeadTop::Right => (reversed(DOWN), ACROSS),
            HeadTop::Down => (ACROSS, reversed(DOWN)),
            HeadTop::Left => (DOWN, ACROSS),
        };
        Self {
            left: self.left + u[0] * self.width,
            top: self.top + v[0] * self.height,
            width: (u[1] - u[0]) * self.width,
            height: (v[1] - v[0]) * self.height,
        }
    }

    /// The whole pixels of an image of `columns` x `rows` that it holds: first and last but one column, the same of
    /// rows.
    fn pixels(&self, columns: usize, rows: usize) -> [usize; 4] {
        // A cast takes what is below 0 to 0.
        let within = |at: f64, most: usize| (at.round() as usize).min(most);
        [
            within(self.left, columns),
            within(self.left + self.width, columns),
            within(self.top, rows),
            within(self.top + self.height, rows),
        ]
    }
}

/// Measures foreheads, with room for the points of one.
#[derive(Debug, Clone, Default)]
pub struct ForeheadFinder {
    depths: Vec<f32>,
}

impl ForeheadFinder {
    /// What the points of a camera's grid of rows of `width` (m, in the camera's frame) say of the forehead of a face
    /// in its image. `None` where fewer than 12 of its pixels, or fewer than a quarter, were measured.
    pub fn find(
        &mut self,
        points: &[[f32; 3]],
        width: usize,
        face: &FaceArea,
        top: HeadTop,
    ) -> Option<Forehead> {
        let rows = points.len().checked_div(width)?;
        let [left, right, first, last] = face.forehead(top).pixels(width, rows);
        let inside =
            (first..last).flat_map(|v| points.get(v * width + left..v * width + right).unwrap_or(&[]));
        let measured = inside.filter(|p| p.iter().all(|c| c.is_finite()));
        self.depths.clear();
        let mut across = [0.0; 2];
        for p in measured {
            self.depths.push(p[2]);
            across[0] += f64::from(p[0]);
            across[1] += f64::from(p[1]);
        }
        let count = self.depths.len();
        let pixels = right.saturating_sub(left) * last.saturating_sub(first);
        if count < LEAST || count * 4 < pixels {
            return None;
        }
        let middle = median(&mut self.depths);
        self.depths.iter_mut().for_each(|z| *z = (*z - middle).abs());
        let deviation = NORMAL_OVER_MEDIAN * f64::from(median(&mut self.depths));
        let n = count as f64;
        Some(Forehead {
            position: [across[0] / n, across[1] / n, f64::from(middle)],
            variance: (MEDIAN_OVER_MEAN * deviation).powi(2) / n,
            count,
        })
    }
}

/// The middle one of some numbers, the upper of two.
fn median(numbers: &mut [f32]) -> f32 {
    let middle = numbers.len() / 2;
    *numbers.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACE: FaceArea = FaceArea { left: 20.0, top: 10.0, width: 60.0, height: 50.0 };

    /// 100 x 80 pixels 0.8 m away; those of one part of [`FACE`] are nearer.
    fn grid(top: HeadTop, nearer: f32) -> Vec<[f32; 3]> {
        let part = FACE.forehead(top);
        let point = |i: usize| {
            let (u, v) = ((i % 100) as f64 + 0.5, (i / 100) as f64 + 0.5);
            let inside =
                u > part.left && u < part.left + part.width && v > part.top && v < part.top + part.height;
            [u as f32 * 1e-3, v as f32 * 1e-3, if inside { 0.8 - nearer } else { 0.8 }]
        };
        (0..8000).map(point).collect()
    }

    #[test]
    fn the_forehead_is_at_the_end_where_the_top_of_the_head_is() {
        for (top, at) in [
            (HeadTop::Up, [0.05, 0.02]),
            (HeadTop::Down, [0.05, 0.05]),
            (HeadTop::Left, [0.032, 0.035]),
            (HeadTop::Right, [0.068, 0.035]),
        ] {
            let found = ForeheadFinder::default().find(&grid(top, 0.1), 100, &FACE, top).unwrap();
            assert!((found.position[2] - 0.7).abs() < 1e-6, "{top:?} {found:?}");
            assert!((0..2).all(|i| (found.position[i] - at[i]).abs() < 1.5e-3), "{top:?} {found:?}");
        }
    }

    #[test]
    fn what_was_not_measured_or_flies_does_not_move_the_median() {
        let mut points = grid(HeadTop::Up, 0.1);
        for (i, p) in points.iter_mut().enumerate() {
            match i % 7 {
                0 | 3 => *p = [f32::NAN; 3],
                5 => p[2] = 3.0,
                1 => p[2] += 0.002,
                2 => p[2] -= 0.002,
                _ => {}
            }
        }
        let found = ForeheadFinder::default().find(&points, 100, &FACE, HeadTop::Up).unwrap();
        assert!((found.position[2] - 0.7).abs() < 2.1e-3, "{found:?}");
        assert!(found.variance > 0.0 && found.variance.sqrt() < 1e-3, "{found:?}");
    }

    #[test]
    fn a_face_beyond_the_image_or_without_points_has_no_distance() {
        let mut finder = ForeheadFinder::default();
        let points = grid(HeadTop::Up, 0.1);
        for face in [
            FaceArea { left: 200.0, ..FACE },
            FaceArea { top: -90.0, ..FACE },
            FaceArea { width: 2.0, ..FACE },
            FaceArea { left: f64::NAN, ..FACE },
        ] {
            assert_eq!(finder.find(&points, 100, &face, HeadTop::Up), None, "{face:?}");
        }
        assert_eq!(finder.find(&[[f32::NAN; 3]; 8000], 100, &FACE, HeadTop::Up), None);
        assert_eq!(finder.find(&points, 0, &FACE, HeadTop::Up), None);
    }
}
