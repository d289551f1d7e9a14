//! Where a training computes: the first CUDA device where the feature `cuda` is built, else the processor.

use std::sync::OnceLock;

use candle_core::Device;

use crate::TrainError;

/// The device of this process. Tensors of two devices cannot be computed with, so there is one.
///
/// # Errors
/// The feature `cuda` is built, and there is no CUDA device.
pub fn device() -> Result<&'static Device, TrainError> {
    static DEVICE: OnceLock<Device> = OnceLock::new();
    if let Some(device) = DEVICE.get() {
        return Ok(device);
    }
    let device = Device::cuda_if_available(0).map_err(|e| TrainError::Device(e.to_string()))?;
    Ok(DEVICE.get_or_init(|| device))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_without_cuda_trains_on_the_processor_and_one_with_it_on_the_gpu_or_says_why_not() {
        match device() {
            Ok(device) => assert_eq!(device.is_cuda(), cfg!(feature = "cuda")),
            Err(error) => {
                assert_eq!((cfg!(feature = "cuda"), error.to_string().contains("CUDA")), (true, true))
            }
        }
    }
}
