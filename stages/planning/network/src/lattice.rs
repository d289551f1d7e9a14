//! How well the bixels of a beam fit a target: their places are multiples of their width, and the target's edge is where it is.
//!
//! A bixel that the target fills in half gives too much beside it or too little within. How much of that a plan has differs
//! from angle to angle, and geometry alone decides it.

/// Cells along the width of a bixel in which the silhouette of a target is drawn.
const CELLS: i64 = 5;
/// Farthest place of a bixel from the axis, in widths: a field is never so large.
const FARTHEST: f64 = 100.0;

/// A box on the isocentre plane: its middle and half of its size, across the couch and along it, mm.
pub type Boxed = ([f64; 2], [f64; 2]);

/// How much of each bixel the silhouette of a target fills.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    width_mm: f64,
    /// The bixel of the first entry, by its place in widths, and how many there are: across the couch, and along it.
    first: [i64; 2],
    counts: [usize; 2],
    /// From 0 to 1, those across the couch one behind the other.
    filled: Vec<f64>,
}

impl Lattice {
    /// Of a silhouette that is made of boxes.
    pub fn of(boxes: &[Boxed], width_mm: f64) -> Self {
        let cell_mm = width_mm / CELLS as f64;
        // A bixel reaches half a width to both sides of its place; cells are counted from the edge of the middle one.
        let cell = |mm: f64| {
            let far = FARTHEST * CELLS as f64;
            ((mm + 0.5 * width_mm) / cell_mm).clamp(-far, far)
        };
        // Cells whose middle is in the box.
        let from =
            |(middle, half): &Boxed, axis: usize| (cell(middle[axis] - half[axis]) - 0.5).ceil() as i64;
        let to = |(middle, half): &Boxed, axis: usize| (cell(middle[axis] + half[axis]) - 0.5).floor() as i64;
        let first =
            [0, 1].map(|axis| boxes.iter().map(|b| from(b, axis).div_euclid(CELLS)).min().unwrap_or(0));
        let last = [0, 1].map(|axis| boxes.iter().map(|b| to(b, axis).div_euclid(CELLS)).max().unwrap_or(-1));
        let counts = [0, 1].map(|axis| usize::try_from(last[axis] - first[axis] + 1).unwrap_or(0));
        let row = counts[0] * CELLS as usize;
        let mut drawn = vec![false; row * counts[1] * CELLS as usize];
        let place = |cell: i64, axis: usize| (cell - first[axis] * CELLS).max(0) as usize;
        for each in boxes {
            let (begin, end) = (place(from(each, 0), 0), place(to(each, 0) + 1, 0));
            for z in from(each, 1)..=to(each, 1) {
                let line = row * place(z, 1);
                drawn[line + begin..(line + end).max(line + begin)].fill(true);
            }
        }
        let mut filled = vec![0.0; counts[0] * counts[1]];
        let part = 1.0 / (CELLS * CELLS) as f64;
        for (cell, _) in drawn.iter().enumerate().filter(|(_, drawn)| **drawn) {
            let [x, z] = [cell % row, cell / row].map(|cell| cell / CELLS as usize);
            filled[x + counts[0] * z] += part;
        }
        Self { width_mm, first, counts, filled }
    }

    /// Area of the silhouette, bixels.
    pub fn area(&self) -> f64 {
        self.filled.iter().sum()
    }

    /// How much of the silhouette lies in bixels that it fills in part, beside its area: 0 where its edges are those of
    /// bixels.
    pub fn misfit(&self) -> f64 {
        self.filled.iter().map(|c| 4.0 * c * (1.0 - c)).sum::<f64>() / self.area().max(1e-9)
    }

    /// How much larger the bixels that it touches are than the silhouette, as a part of it.
    pub fn touched(&self) -> f64 {
        self.filled.iter().filter(|c| **c > 0.0).count() as f64 / self.area().max(1e-9) - 1.0
    }

    /// How much larger the bixels that it fills more than in half are than the silhouette, as a part of it.
    pub fn rounded(&self) -> f64 {
        self.filled.iter().filter(|c| **c > 0.5).count() as f64 / self.area().max(1e-9) - 1.0
    }

    /// How much of the bixel at this place on the isocentre plane (mm) the silhouette fills.
    pub fn at(&self, place_mm: [f64; 2]) -> f64 {
        let [x, z] = [0, 1].map(|axis| {
            let bixel = (place_mm[axis] / self.width_mm + 0.5).floor() - self.first[axis] as f64;
            (bixel >= 0.0 && bixel < self.counts[axis] as f64).then_some(bixel as usize)
        });
        x.zip(z).and_then(|(x, z)| self.filled.get(x + self.counts[0] * z).copied()).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(middle: f64, half: f64) -> Lattice {
        Lattice::of(&[([middle, 0.0], [half, half])], 10.0)
    }

    #[test]
    fn a_target_whose_edges_are_those_of_bixels_fits() {
        // Bixels at -10, 0 and 10 reach from -15 to 15.
        let fits = square(0.0, 15.0);
        assert!((fits.area() - 9.0).abs() < 1e-9, "{}", fits.area());
        assert!(fits.misfit() < 1e-9 && fits.touched() < 1e-9 && fits.rounded().abs() < 1e-9);
        assert!((fits.at([14.9, -14.9]) - 1.0).abs() < 1e-9 && fits.at([15.1, 0.0]) == 0.0);
        // Moved by four of ten: three bixels to the left are filled to six tenths, three to the right to four tenths.
        let off = square(4.0, 15.0);
        assert!((off.area() - 9.0).abs() < 1e-9);
        assert!((off.misfit() - 6.0 * 4.0 * 0.24 / 9.0).abs() < 1e-9, "{}", off.misfit());
        assert!((off.touched() - 3.0 / 9.0).abs() < 1e-9 && off.rounded().abs() < 1e-9);
        assert!((off.at([-10.0, 0.0]) - 0.6).abs() < 1e-9 && (off.at([20.0, 0.0]) - 0.4).abs() < 1e-9);
    }

    #[test]
    fn boxes_that_overlap_count_once_and_a_mirrored_target_fits_as_well() {
        let of = |sign: f64| {
            let boxes = [([3.0, 0.0], [6.0, 5.0]), ([7.0, 2.0], [6.0, 5.0])];
            Lattice::of(&boxes.map(|([x, z], half)| ([sign * x, z], half)), 10.0)
        };
        let (one, other) = (of(1.0), of(-1.0));
        assert!(one.area() < 2.0 * 1.2, "{}", one.area());
        assert!((one.misfit() - other.misfit()).abs() < 1e-9 && (one.area() - other.area()).abs() < 1e-9);
    }
}
