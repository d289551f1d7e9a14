//! Pixels.

use std::io::Write;

use super::letters::{SIZE, letter};

/// Pixels to a pixel of a letter.
const LETTER_SCALE: usize = 2;
/// Width and height of a letter, and how far the next one stands.
pub const LETTER: [usize; 2] = [SIZE[0] * LETTER_SCALE, SIZE[1] * LETTER_SCALE];
const PITCH: usize = LETTER[0] + LETTER_SCALE;
/// Colour of letters.
pub const INK: [u8; 3] = [255, 255, 160];

/// A picture in colours.
pub struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    /// A black one.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[0; 3]; width * height] }
    }

    /// Pixels along a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels along a column.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Makes it wider: what is new, on the right, is black.
    pub fn widen(&mut self, by: usize) {
        let wider = self
            .pixels
            .chunks(self.width)
            .flat_map(|row| row.iter().copied().chain(std::iter::repeat_n([0; 3], by)).collect::<Vec<_>>());
        self.pixels = wider.collect();
        self.width += by;
    }

    /// Sets a pixel; beyond the picture nothing is set.
    pub fn paint(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[x + self.width * y] = colour;
        }
    }

    /// Lays a colour over a pixel; `cover` is 0 for none of it and 1 for it alone.
    pub fn blend(&mut self, x: usize, y: usize, colour: [u8; 3], cover: f64) {
        if x < self.width && y < self.height {
            for (pixel, over) in self.pixels[x + self.width * y].iter_mut().zip(colour) {
                *pixel = (f64::from(*pixel) * (1.0 - cover) + f64::from(over) * cover).round() as u8;
            }
        }
    }

    /// Writes a text with its upper left corner there, on a dark ground.
    pub fn text(&mut self, text: &str, left: usize, top: usize) {
        let background = (PITCH * text.chars().count() + LETTER_SCALE, LETTER[1] + 2 * LETTER_SCALE);
        for y in 0..background.1 {
            for x in 0..background.0 {
                if let (Some(x), Some(y)) = ((left + x).checked_sub(2), (top + y).checked_sub(2)) {
                    self.blend(x, y, [0; 3], 0.65);
                }
            }
        }
        for (place, name) in text.chars().enumerate() {
            for (row, bits) in letter(name).into_iter().enumerate() {
                for column in (0..SIZE[0]).filter(|c| bits >> (SIZE[0] - 1 - c) & 1 == 1) {
                    for i in 0..LETTER_SCALE * LETTER_SCALE {
                        let (x, y) = (i % LETTER_SCALE, i / LETTER_SCALE);
                        let left = left + PITCH * place;
                        self.paint(left + LETTER_SCALE * column + x, top + LETTER_SCALE * row + y, INK);
                    }
                }
            }
        }
    }

    /// Writes a text around a place, kept inside the first `width` columns.
    pub fn text_around(&mut self, text: &str, [x, y]: [f64; 2], width: usize) {
        let size = [(PITCH * text.chars().count()) as f64, LETTER[1] as f64];
        let most = [width, self.height].map(|n| n as f64);
        let corner = |axis: usize, middle: f64| {
            (middle - 0.5 * size[axis]).clamp(2.0, (most[axis] - size[axis] - 2.0).max(2.0)) as usize
        };
        self.text(text, corner(0, x), corner(1, y));
    }

    /// Writes it as a PNG.
    pub fn write(&self, to: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(to, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(self.pixels.as_flattened())
    }
}
