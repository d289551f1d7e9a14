//! The points of a sample as plain arrays, in place, and clouds as samples.

use stillpoint_operator::Outputs;
use stillpoint_operator::StepError;
use stillpoint_samples::{CloudShape, Point, PointCloud};
use zerocopy::{FromBytes, IntoBytes};

/// Sends a cloud of `width` x `height` points on an output. `fill` writes all of them, row by row, in metres.
pub fn send_cloud(
    outputs: &mut Outputs<'_>,
    port: usize,
    width: usize,
    height: usize,
    fill: impl FnOnce(&mut [[f32; 3]]) -> Result<(), StepError>,
) -> Result<(), StepError> {
    let count = width.saturating_mul(height);
    let shape = || {
        let narrow = |n: usize| u32::try_from(n).ok();
        Some((narrow(width)?, narrow(height)?, narrow(count)?))
    };
    let Some((columns, rows, length)) = shape() else {
        return Err(StepError(format!("a cloud of {width} x {height} points is larger than any sample")));
    };
    let mut writer = outputs.open::<PointCloud>(port, count)?;
    *writer.body() = CloudShape { width: columns, height: rows, reserved: 0, length };
    fill(arrays(writer.elements())?)?;
    writer.finish(count)
}

/// Points as arrays, in place.
fn arrays(points: &mut [Point]) -> Result<&mut [[f32; 3]], StepError> {
    <[[f32; 3]]>::mut_from_bytes(points.as_mut_bytes())
        .map_err(|_| StepError("the points of a cloud cannot be written in place".to_string()))
}
