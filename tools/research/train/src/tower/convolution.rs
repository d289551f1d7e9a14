//! The convolution in three dimensions: the sum over the taps along slices of convolutions in the plane.

use candle_core::Tensor;

use crate::TrainError;

/// Convolves `(batch, channels, slices, rows, columns)` with a cubic kernel `(filters, channels, k, k, k)`, zeros around.
///
/// `stride` is that along slices and that in the plane. The size of the result is `(n + 2 padding - k) / stride + 1`.
pub fn convolve(
    x: &Tensor,
    kernel: &Tensor,
    [stride_slices, stride]: [usize; 2],
    padding: usize,
) -> Result<Tensor, TrainError> {
    let (batch, channels, slices, rows, columns) = x.dims5()?;
    let (filters, _, width, _, _) = kernel.dims5()?;
    let mut padded = x.pad_with_zeros(2, padding, padding)?;
    if [slices, rows, columns].iter().any(|n| n + 2 * padding < width) || stride_slices * stride == 0 {
        let must = "at most slices, rows and columns with their padding, and strides above 0";
        return Err(TrainError::Option { what: "the width of the kernel", value: width as f64, must });
    }
    // Rows and columns that no tap reaches are cut off: candle's gradient takes as many of them along both axes.
    for (axis, length) in [(3, rows), (4, columns)] {
        let whole = padded.pad_with_zeros(axis, padding, padding)?;
        let reached = (length + 2 * padding).saturating_sub(width) / stride.max(1) * stride.max(1) + width;
        padded = whole.narrow(axis, 0, reached.min(length + 2 * padding))?;
    }
    let padded = padded.contiguous()?;
    let (high, wide) = (padded.dim(3)?, padded.dim(4)?);
    let out = (slices + 2 * padding - width) / stride_slices + 1;
    let mut sum: Option<Tensor> = None;
    for tap in 0..width {
        let places: Vec<u32> = (0..out).map(|o| (o * stride_slices + tap) as u32).collect();
        let places = Tensor::from_vec(places, out, x.device())?;
        let slices = padded.index_select(&places, 2)?.transpose(1, 2)?;
        let flat = slices.reshape((batch * out, channels, high, wide))?;
        let weights = kernel.narrow(2, tap, 1)?.squeeze(2)?.contiguous()?;
        let part = flat.conv2d(&weights, 0, stride, 1, 1)?;
        sum = Some(match sum {
            Some(sum) => (sum + part)?,
            None => part,
        });
    }
    let sum =
        sum.ok_or(TrainError::Option { what: "the width of the kernel", value: 0.0, must: "above 0" })?;
    let (_, _, high, wide) = sum.dims4()?;
    Ok(sum.reshape((batch, out, filters, high, wide))?.transpose(1, 2)?.contiguous()?)
}
