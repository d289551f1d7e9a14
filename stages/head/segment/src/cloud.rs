//! A cloud as a camera gives it.

/// Points, and the grid that they stand in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cloud<'a> {
    /// Points in metres in the camera's frame; one with a coordinate that is not finite is no point.
    pub points: &'a [[f32; 3]],
    /// Points in a row where they stand as the camera's grid, else 0.
    pub width: usize,
}

impl<'a> Cloud<'a> {
    /// Points that stand in no grid.
    #[must_use]
    pub fn unorganised(points: &'a [[f32; 3]]) -> Self {
        Self { points, width: 0 }
    }

    /// Whole rows of the grid; 0 where there is none.
    #[must_use]
    pub fn height(&self) -> usize {
        self.points.len().checked_div(self.width).unwrap_or(0)
    }

    /// The places of the points along the edge of the image, some of them twice.
    pub(crate) fn border(self) -> impl Iterator<Item = usize> {
        let (width, height) = (self.width, self.height());
        let rows = (0..width).flat_map(move |u| [u, height.saturating_sub(1) * width + u]);
        let columns = (0..height).flat_map(move |v| [v * width, v * width + width.saturating_sub(1)]);
        rows.chain(columns)
    }
}
