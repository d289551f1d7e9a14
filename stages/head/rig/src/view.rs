//! What a camera without noise sees: depth, label and incidence of every pixel.

use crate::camera::Pinhole;
use crate::scene::Label;

/// A block of pixels, from (u0, v0) up to but without (u1, v1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    pub u0: usize,
    pub v0: usize,
    /// Column after the last.
    pub u1: usize,
    /// Row after the last.
    pub v1: usize,
}

impl Rect {
    /// The block without pixels, which any [`Rect::cover`] replaces.
    pub const EMPTY: Self = Self { u0: usize::MAX, v0: usize::MAX, u1: 0, v1: 0 };

    /// Whether there are no pixels in it.
    pub fn is_empty(&self) -> bool {
        self.u0 >= self.u1 || self.v0 >= self.v1
    }

    /// Grows the block so that it covers columns `u0..u1` of row `v`.
    pub fn cover(&mut self, u0: usize, u1: usize, v: usize) {
        *self = Self { u0: self.u0.min(u0), v0: self.v0.min(v), u1: self.u1.max(u1), v1: self.v1.max(v + 1) };
    }
}

/// Depth, label and incidence per pixel, row by row from the top left, `width * height` each.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) depth_m: Vec<f32>,
    pub(crate) label: Vec<u8>,
    pub(crate) cosine: Vec<f32>,
}

impl RenderedView {
    pub fn empty(camera: &Pinhole) -> Self {
        Self {
            width: camera.width(),
            height: camera.height(),
            depth_m: vec![f32::INFINITY; camera.pixels()],
            label: vec![Label::Background as u8; camera.pixels()],
            cosine: vec![1.0; camera.pixels()],
        }
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn height(&self) -> usize {
        self.height
    }

    /// Depth along the optical axis in metres; infinite where no surface is seen.
    pub fn depth_m(&self) -> &[f32] {
        &self.depth_m
    }

    /// [`Label`] of each pixel, as its number.
    pub fn label(&self) -> &[u8] {
        &self.label
    }

    /// Cosine of the angle between the line of sight and the surface's normal, from 0 (grazing) to 1.
    pub fn cosine(&self) -> &[f32] {
        &self.cosine
    }

    /// Copies a block from another view of the same size.
    pub(crate) fn restore(&mut self, rect: &Rect, from: &Self) {
        if rect.is_empty() {
            return;
        }
        for v in rect.v0..rect.v1 {
            let row = v * self.width + rect.u0..v * self.width + rect.u1;
            self.depth_m[row.clone()].copy_from_slice(&from.depth_m[row.clone()]);
            self.label[row.clone()].copy_from_slice(&from.label[row.clone()]);
            self.cosine[row.clone()].copy_from_slice(&from.cosine[row]);
        }
    }
}
