//! Slices of a case with its structures, as radiologists look at them: the patient's left on the right.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Case;

use super::canvas::{INK, LETTER, Picture};

/// Names of the colours of structures, in their order, and what they are.
pub const COLOURS: [(&str, [u8; 3]); 10] = [
    ("white", [235, 235, 235]),
    ("red", [255, 70, 60]),
    ("orange", [255, 160, 40]),
    ("yellow", [250, 230, 60]),
    ("green", [90, 220, 90]),
    ("cyan", [70, 220, 230]),
    ("magenta", [240, 100, 240]),
    ("blue", [110, 150, 255]),
    ("brown", [190, 130, 80]),
    ("pink", [255, 180, 190]),
];
/// Soft tissue and bone are both seen in this window.
const DARKEST_HU: f64 = -250.0;
const BRIGHTEST_HU: f64 = 450.0;
/// Width of the larger side.
const LARGEST: f64 = 720.0;

/// A plane through the isocentre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// Across the patient, seen from the feet.
    Axial,
    /// From side to side, seen from the front.
    Coronal,
    /// From front to back, seen from the left.
    Sagittal,
}

impl Plane {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Axial, Self::Coronal, Self::Sagittal];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axial => "axial",
            Self::Coronal => "coronal",
            Self::Sagittal => "sagittal",
        }
    }

    /// Axes of the volume along the picture's width and height, and across it.
    pub fn axes(self) -> [usize; 3] {
        match self {
            Self::Axial => [0, 1, 2],
            Self::Coronal => [0, 2, 1],
            Self::Sagittal => [1, 2, 0],
        }
    }

    /// What is at the left, right, top and bottom.
    pub fn sides(self) -> [char; 4] {
        match self {
            Self::Axial => ['R', 'L', 'A', 'P'],
            Self::Coronal => ['R', 'L', 'H', 'F'],
            Self::Sagittal => ['A', 'P', 'H', 'F'],
        }
    }
}

/// Where the pixels of a picture are in a volume.
pub(super) struct Frame {
    pub axes: [usize; 3],
    pub mm_per_pixel: f64,
    /// The slice.
    across: usize,
    grid: Grid,
}

impl Frame {
    fn new(case: &Case, plane: Plane) -> Self {
        let grid = *case.grid();
        let axes @ [u, v, across] = plane.axes();
        let size_mm = |axis: usize| grid.counts[axis] as f64 * grid.spacing_mm[axis];
        let iso = (case.isocentre_mm()[across] - grid.origin_mm[across]) / grid.spacing_mm[across];
        Self {
            axes,
            mm_per_pixel: size_mm(u).max(size_mm(v)) / LARGEST,
            across: ((iso + 0.5) as usize).min(grid.counts[across] - 1),
            grid,
        }
    }

    /// Width and height of the picture.
    fn size(&self) -> [usize; 2] {
        [self.axes[0], self.axes[1]].map(|axis| {
            let mm = self.grid.counts[axis] as f64 * self.grid.spacing_mm[axis];
            ((mm / self.mm_per_pixel).round() as usize).max(1)
        })
    }

    /// Voxel coordinates along the picture's axes of a pixel's middle; the head is up.
    fn voxels(&self, x: usize, y: usize) -> [f64; 2] {
        let [u, v, _] = self.axes;
        let place = |pixel: usize, axis: usize| {
            (pixel as f64 + 0.5) * self.mm_per_pixel / self.grid.spacing_mm[axis] - 0.5
        };
        let down = place(y, v);
        let along = if v == 2 { self.grid.counts[v] as f64 - 1.0 - down } else { down };
        [place(x, u), along]
    }

    /// Where a pixel's middle is, mm.
    pub fn place_mm(&self, x: usize, y: usize) -> [f64; 3] {
        let [along_u, along_v] = self.voxels(x, y);
        let mut place = [0.0; 3];
        place[self.axes[0]] = along_u;
        place[self.axes[1]] = along_v;
        place[self.axes[2]] = self.across as f64;
        std::array::from_fn(|axis| self.grid.origin_mm[axis] + place[axis] * self.grid.spacing_mm[axis])
    }

    /// The pixel, with its parts, where a place (mm) is seen.
    pub fn pixel(&self, place_mm: [f64; 3]) -> [f64; 2] {
        [self.axes[0], self.axes[1]].map(|axis| {
            let spacing = self.grid.spacing_mm[axis];
            let place = (place_mm[axis] - self.grid.origin_mm[axis]) / spacing;
            let along = if axis == 2 { self.grid.counts[axis] as f64 - 1.0 - place } else { place };
            (along + 0.5) * spacing / self.mm_per_pixel
        })
    }

    fn voxel(&self, along_u: usize, along_v: usize) -> [usize; 3] {
        let mut voxel = [0; 3];
        voxel[self.axes[0]] = along_u.min(self.grid.counts[self.axes[0]] - 1);
        voxel[self.axes[1]] = along_v.min(self.grid.counts[self.axes[1]] - 1);
        voxel[self.axes[2]] = self.across;
        voxel
    }

    fn nearest(&self, x: usize, y: usize) -> [usize; 3] {
        let [u, v] = self.voxels(x, y).map(|p| (p + 0.5).max(0.0) as usize);
        self.voxel(u, v)
    }
}

/// The slice of a case in a plane through its isocentre, with the outlines of its structures and a cross at the isocentre.
pub fn draw(case: &Case, plane: Plane) -> Picture {
    let (mut picture, frame) = tissue(case, plane);
    outlines(case, &frame, &mut picture);
    marks(case, plane, &frame, &mut picture);
    picture
}

/// The image alone.
pub(super) fn tissue(case: &Case, plane: Plane) -> (Picture, Frame) {
    let frame = Frame::new(case, plane);
    let [width, height] = frame.size();
    let mut picture = Picture::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let part = (hounsfield(case, &frame, x, y) - DARKEST_HU) / (BRIGHTEST_HU - DARKEST_HU);
            picture.paint(x, y, [(255.0 * part.clamp(0.0, 1.0)) as u8; 3]);
        }
    }
    (picture, frame)
}

/// The outlines of the structures.
pub(super) fn outlines(case: &Case, frame: &Frame, picture: &mut Picture) {
    let [width, height] = frame.size();
    for (place, structure) in case.structures().iter().enumerate() {
        let inside = |x: usize, y: usize| structure.mask.contains(case.grid().index(frame.nearest(x, y)));
        for y in 0..height {
            for x in 0..width {
                let edge = || {
                    let (left, up) = (x.saturating_sub(1), y.saturating_sub(1));
                    !(inside(left, y) && inside(x, up) && inside(x + 1, y) && inside(x, y + 1))
                };
                if inside(x, y) && edge() {
                    picture.paint(x, y, COLOURS[place % COLOURS.len()].1);
                }
            }
        }
    }
}

/// The sides of the patient, and a cross at the isocentre.
pub(super) fn marks(case: &Case, plane: Plane, frame: &Frame, picture: &mut Picture) {
    let [x, y] = frame.pixel(case.isocentre_mm()).map(|p| p as usize);
    for i in 0..13 {
        picture.paint((x + i).saturating_sub(6), y, INK);
        picture.paint(x, (y + i).saturating_sub(6), INK);
    }
    let [width, height] = frame.size();
    let [left, right, top, bottom] = plane.sides().map(String::from);
    let [wide, high] = LETTER;
    picture.text(&left, 6, (height / 2).saturating_sub(high / 2));
    picture.text(&right, width.saturating_sub(wide + 6), (height / 2).saturating_sub(high / 2));
    picture.text(&top, (width / 2).saturating_sub(wide / 2), 6);
    picture.text(&bottom, (width / 2).saturating_sub(wide / 2), height.saturating_sub(high + 6));
}

/// Hounsfield units between the voxels.
fn hounsfield(case: &Case, frame: &Frame, x: usize, y: usize) -> f64 {
    let place = frame.voxels(x, y).map(|p| p.max(0.0));
    let low = place.map(|p| p as usize);
    let [a, b] = [place[0] - low[0] as f64, place[1] - low[1] as f64];
    let hu =
        |du: usize, dv: usize| f64::from(case.hu()[case.grid().index(frame.voxel(low[0] + du, low[1] + dv))]);
    (1.0 - b) * ((1.0 - a) * hu(0, 0) + a * hu(1, 0)) + b * ((1.0 - a) * hu(0, 1) + a * hu(1, 1))
}
