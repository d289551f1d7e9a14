//! Pictures of few colours as PNG, and bytes as text for a page that stands alone.

/// Pixels from the corner of a picture within which lines are drawn.
const FARTHEST: f64 = 20_000.0;

/// A picture whose pixels are numbers of colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Indexed {
    /// Pixels in a row.
    pub width: usize,
    pub height: usize,
    /// A number of a colour for each pixel, row by row.
    pub pixels: Vec<u8>,
    /// Red, green, blue of each colour; at most 256.
    pub colours: Vec<[u8; 3]>,
}

impl Indexed {
    /// Sets a pixel, if it is one of the picture.
    pub fn paint(&mut self, x: i64, y: i64, colour: u8) {
        let inside = (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y);
        if let Some(pixel) =
            inside.then(|| self.pixels.get_mut(x as usize + self.width * y as usize)).flatten()
        {
            *pixel = colour;
        }
    }

    /// Draws a line two pixels wide.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: u8) {
        // A line that no picture is large enough for ends somewhere far outside.
        if !from.iter().chain(&to).all(|c| c.abs() < FARTHEST) {
            return;
        }
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil();
        for i in 0..=steps as usize {
            let part = i as f64 / steps.max(1.0);
            let [x, y] = [0, 1].map(|k| (from[k] + part * (to[k] - from[k])).round() as i64);
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                self.paint(x + dx, y + dy, colour);
            }
        }
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// Sizes that no PNG has.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(self.colours.as_flattened().to_vec());
        // Numbers of colours are no amounts: differences of neighbours say nothing.
        encoder.set_filter(png::Filter::NoFilter);
        encoder.set_compression(png::Compression::High);
        encoder.write_header()?.write_image_data(&self.pixels)?;
        Ok(bytes)
    }
}

/// Base64 of RFC 4648, with padding.
pub fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for part in bytes.chunks(3) {
        let byte = |i: usize| u32::from(part.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= part.len() { letter as char } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_has_the_vectors_of_its_definition() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xff, 0xfe, 0xfb]), "//77");
    }

    #[test]
    fn a_picture_is_a_png_with_its_colours() {
        let mut picture =
            Indexed { width: 5, height: 4, pixels: vec![0; 20], colours: vec![[0; 3], [9, 8, 7]] };
        picture.line([0.0, 0.0], [2.0, 0.0], 1);
        picture.line([f64::NAN, 0.0], [1e12, 0.0], 1);
        picture.paint(-1, 7, 1);
        assert_eq!(picture.pixels.iter().filter(|p| **p == 1).count(), 8);
        let bytes = picture.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut read = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut read).unwrap();
        assert_eq!((read, reader.info().width), (picture.pixels, 5));
    }
}
