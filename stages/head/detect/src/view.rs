//! An image prepared for the detector: heads upright, no larger than needed, with a margin.

/// Which way the top of the head points in an image. The number is that of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Top {
    /// Up: a person in front of the camera.
    Up = 0,
    Right = 1,
    /// Down: a patient on a couch, seen from the feet.
    Down = 2,
    Left = 3,
}

/// A part of an image in pixels; it may reach beyond the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Area {
    pub left: i32,
    pub top: i32,
    pub width: u32,
    pub height: u32,
}

/// How an image becomes a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Viewing {
    /// Which way the heads' tops point in the image.
    pub top: Top,
    /// Pixels of the image along the side of one pixel of the view, from 1.
    pub reduce: usize,
    /// Black pixels of the view behind the last column and below the last row.
    pub margin: usize,
}

/// An image with upright heads, with its buffers.
#[derive(Debug, Clone, Default)]
pub struct UprightImage {
    reduced: Vec<u8>,
    pixels: Vec<u8>,
    /// Columns and rows of the reduced image before it is turned.
    size: [usize; 2],
    width: usize,
    height: usize,
}

impl UprightImage {
    /// Takes an image of rows of `width` pixels. Columns and rows at the right and lower edge that do not fill a whole
    /// pixel of the view are left out.
    pub fn show(&mut self, image: &[u8], width: usize, viewing: &Viewing) {
        let height = image.len().checked_div(width).unwrap_or(0);
        self.reduce(image, width, height, viewing.reduce.max(1));
        let [w, h] = self.size;
        let [across, down] = match viewing.top {
            Top::Up | Top::Down => [w, h],
            Top::Right | Top::Left => [h, w],
        };
        (self.width, self.height) = (across + viewing.margin, down + viewing.margin);
        self.pixels.clear();
        self.pixels.resize(self.width * self.height, 0);
        for y in 0..down {
            let row = &mut self.pixels[y * self.width..][..across];
            for (x, pixel) in row.iter_mut().enumerate() {
                let [u, v] = match viewing.top {
                    Top::Up => [x, y],
                    Top::Right => [w - 1 - y, x],
                    Top::Down => [w - 1 - x, h - 1 - y],
                    Top::Left => [y, h - 1 - x],
                };
                *pixel = self.reduced[v * w + u];
            }
        }
    }

    /// Means of squares of `by` pixels, rounded.
    fn reduce(&mut self, image: &[u8], width: usize, height: usize, by: usize) {
        let [w, h] = [width / by, height / by];
        self.size = [w, h];
        self.reduced.clear();
        let area = (by * by) as u64;
        for v in 0..h {
            for u in 0..w {
                let rows = (0..by).map(|k| &image[(v * by + k) * width + u * by..][..by]);
                let sum: u64 = rows.flatten().map(|&pixel| u64::from(pixel)).sum();
                self.reduced.push(((sum + area / 2) / area) as u8);
            }
        }
    }

    /// The view's pixels, margin included.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Columns and rows of the view, margin included.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Where an area of the view is in the image.
    #[must_use]
    pub fn in_image(&self, area: Area, viewing: &Viewing) -> Area {
        let by = viewing.reduce.max(1) as i32;
        let [w, h] = self.size.map(|n| n as i32);
        let Area { left: x, top: y, width, height } = area;
        let (across, down) = (width as i32, height as i32);
        let (left, top, width, height) = match viewing.top {
            Top::Up => (x, y, across, down),
            Top::Right => (w - y - down, x, down, across),
            Top::Down => (w - x - across, h - y - down, across, down),
            Top::Left => (y, h - x - across, down, across),
        };
        Area { left: left * by, top: top * by, width: (width * by) as u32, height: (height * by) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 6 columns, 4 rows; a bright 2 x 1 patch at column 4, row 1.
    fn image() -> Vec<u8> {
        (0..24).map(|i| if i == 10 || i == 11 { 200 } else { 0 }).collect()
    }

    #[test]
    fn what_is_found_in_a_view_is_where_it_is_in_the_image() {
        for top in [Top::Up, Top::Right, Top::Down, Top::Left] {
            let viewing = Viewing { top, reduce: 1, margin: 2 };
            let mut view = UprightImage::default();
            view.show(&image(), 6, &viewing);
            let [width, height] = view.size();
            let bright = |at: &usize| view.pixels()[*at] == 200;
            let places: Vec<usize> = (0..width * height).filter(bright).collect();
            let [first, last] = [places[0], places[1]].map(|at| [at % width, at / width]);
            let area = Area {
                left: first[0] as i32,
                top: first[1] as i32,
                width: (last[0] - first[0] + 1) as u32,
                height: (last[1] - first[1] + 1) as u32,
            };
            let expected = Area { left: 4, top: 1, width: 2, height: 1 };
            assert_eq!((places.len(), view.in_image(area, &viewing)), (2, expected), "{top:?}");
        }
    }

    #[test]
    fn the_top_of_a_head_is_up_in_a_view() {
        // A head whose top is the bright end.
        let mut view = UprightImage::default();
        for (top, image, width) in [
            (Top::Up, [9, 5, 1], 1),
            (Top::Down, [1, 5, 9], 1),
            (Top::Right, [1, 5, 9], 3),
            (Top::Left, [9, 5, 1], 3),
        ] {
            view.show(&image, width, &Viewing { top, reduce: 1, margin: 0 });
            assert_eq!((view.pixels(), view.size()), (&[9, 5, 1][..], [1, 3]), "{top:?}");
        }
    }

    #[test]
    fn a_smaller_view_has_the_means_of_squares() {
        let mut view = UprightImage::default();
        let viewing = Viewing { top: Top::Up, reduce: 2, margin: 1 };
        view.show(&[0, 1, 4, 4, 7, 2, 3, 4, 4, 7, 9, 9, 9, 9, 9], 5, &viewing);
        assert_eq!((view.pixels(), view.size()), (&[2, 4, 0, 0, 0, 0][..], [3, 2]));
        let area = Area { left: 1, top: 0, width: 1, height: 1 };
        assert_eq!(view.in_image(area, &viewing), Area { left: 2, top: 0, width: 2, height: 2 });
        view.show(&[], 0, &viewing);
        assert_eq!(view.size(), [1, 1]);
    }
}
