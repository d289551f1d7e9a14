//! Slices of a case with its structures, as radiologists look at them: the patient's left on the right.

use std::io::Write;

use stillpoint_plan::case::Case;

use super::letters::letter;

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
const LETTER_SCALE: usize = 2;

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
    fn axes(self) -> [usize; 3] {
        match self {
            Self::Axial => [0, 1, 2],
            Self::Coronal => [0, 2, 1],
            Self::Sagittal => [1, 2, 0],
        }
    }

    /// What is at the left, right, top and bottom.
    fn sides(self) -> [char; 4] {
        match self {
            Self::Axial => ['R', 'L', 'A', 'P'],
            Self::Coronal => ['R', 'L', 'H', 'F'],
            Self::Sagittal => ['A', 'P', 'H', 'F'],
        }
    }
}

/// A picture in colours.
pub struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn paint(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[x + self.width * y] = colour;
        }
    }

    fn letter(&mut self, name: char, left: usize, top: usize) {
        for (row, bits) in letter(name).into_iter().enumerate() {
            for column in (0..5).filter(|c| bits >> (4 - c) & 1 == 1) {
                for i in 0..LETTER_SCALE * LETTER_SCALE {
                    let (x, y) = (i % LETTER_SCALE, i / LETTER_SCALE);
                    self.paint(
                        left + LETTER_SCALE * column + x,
                        top + LETTER_SCALE * row + y,
                        [255, 255, 160],
                    );
                }
            }
        }
    }

    /// Writes it as a PNG.
    pub fn write(&self, to: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(to, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(self.pixels.as_flattened())
    }
}

/// Where the pixels of a picture are in a volume.
struct Frame {
    axes: [usize; 3],
    mm_per_pixel: f64,
    /// The slice.
    across: usize,
    counts: [usize; 3],
    spacing_mm: [f64; 3],
}

impl Frame {
    /// Voxel coordinates along the picture's axes of a pixel's middle; the head is up.
    fn voxels(&self, x: usize, y: usize) -> [f64; 2] {
        let [u, v, _] = self.axes;
        let place = |pixel: usize, axis: usize| {
            (pixel as f64 + 0.5) * self.mm_per_pixel / self.spacing_mm[axis] - 0.5
        };
        let down = place(y, v);
        let along = if v == 2 { self.counts[v] as f64 - 1.0 - down } else { down };
        [place(x, u), along]
    }

    fn voxel(&self, along_u: usize, along_v: usize) -> [usize; 3] {
        let mut voxel = [0; 3];
        voxel[self.axes[0]] = along_u.min(self.counts[self.axes[0]] - 1);
        voxel[self.axes[1]] = along_v.min(self.counts[self.axes[1]] - 1);
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
    let grid = case.grid();
    let axes @ [u, v, across] = plane.axes();
    let size_mm = |axis: usize| grid.counts[axis] as f64 * grid.spacing_mm[axis];
    let mm_per_pixel = size_mm(u).max(size_mm(v)) / LARGEST;
    let iso =
        [0, 1, 2].map(|axis| (case.isocentre_mm()[axis] - grid.origin_mm[axis]) / grid.spacing_mm[axis]);
    let frame = Frame {
        axes,
        mm_per_pixel,
        across: ((iso[across] + 0.5) as usize).min(grid.counts[across] - 1),
        counts: grid.counts,
        spacing_mm: grid.spacing_mm,
    };
    let pixels = |axis: usize| ((size_mm(axis) / mm_per_pixel).round() as usize).max(1);
    let (width, height) = (pixels(u), pixels(v));
    let mut picture = Picture { width, height, pixels: vec![[0; 3]; width * height] };
    for y in 0..height {
        for x in 0..width {
            let part = (tissue(case, &frame, x, y) - DARKEST_HU) / (BRIGHTEST_HU - DARKEST_HU);
            picture.paint(x, y, [(255.0 * part.clamp(0.0, 1.0)) as u8; 3]);
        }
    }
    for (place, structure) in case.structures().iter().enumerate() {
        let inside = |x: usize, y: usize| structure.mask.contains(grid.index(frame.nearest(x, y)));
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
    cross(&mut picture, &frame, iso);
    let [left, right, top, bottom] = plane.sides();
    let (wide, high) = (5 * LETTER_SCALE, 7 * LETTER_SCALE);
    picture.letter(left, 6, (height / 2).saturating_sub(high / 2));
    picture.letter(right, width.saturating_sub(wide + 6), (height / 2).saturating_sub(high / 2));
    picture.letter(top, (width / 2).saturating_sub(wide / 2), 6);
    picture.letter(bottom, (width / 2).saturating_sub(wide / 2), height.saturating_sub(high + 6));
    picture
}

/// Hounsfield units between the voxels.
fn tissue(case: &Case, frame: &Frame, x: usize, y: usize) -> f64 {
    let place = frame.voxels(x, y).map(|p| p.max(0.0));
    let low = place.map(|p| p as usize);
    let [a, b] = [place[0] - low[0] as f64, place[1] - low[1] as f64];
    let hu =
        |du: usize, dv: usize| f64::from(case.hu()[case.grid().index(frame.voxel(low[0] + du, low[1] + dv))]);
    (1.0 - b) * ((1.0 - a) * hu(0, 0) + a * hu(1, 0)) + b * ((1.0 - a) * hu(0, 1) + a * hu(1, 1))
}

fn cross(picture: &mut Picture, frame: &Frame, iso: [f64; 3]) {
    let [u, v, _] = frame.axes;
    let along_v = if v == 2 { frame.counts[v] as f64 - 1.0 - iso[v] } else { iso[v] };
    let pixel =
        |place: f64, axis: usize| ((place + 0.5) * frame.spacing_mm[axis] / frame.mm_per_pixel) as usize;
    let (x, y) = (pixel(iso[u], u), pixel(along_v, v));
    for i in 0..13 {
        picture.paint((x + i).saturating_sub(6), y, [255, 255, 160]);
        picture.paint(x, (y + i).saturating_sub(6), [255, 255, 160]);
    }
}
