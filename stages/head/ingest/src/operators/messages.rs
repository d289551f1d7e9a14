//! Clouds out of messages of ROS 2, of recordings and of the wire alike.

use stillpoint_operator::{Outputs, StepError};

use super::points::send_cloud;
use crate::bag::Reading;
use crate::camera_info::{CameraInfo, CameraInfoError, Image};
use crate::depth_message::{DepthMessage, DepthMessageError};
use crate::point_cloud2::{PointCloud2, PointCloud2Error};

/// The most different cameras of a topic: the rays of each are held in memory.
const MOST_CAMERAS: usize = 16;

/// Why a message becomes no cloud.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// It is no cloud.
    #[error(transparent)]
    Cloud(#[from] PointCloud2Error),
    /// It is no depth image.
    #[error(transparent)]
    Depth(#[from] DepthMessageError),
    /// No sample has so many points.
    #[error("it has {points} points: raise `max_points`")]
    TooLarge {
        /// Its points.
        points: usize,
    },
    /// The executor did not take the sample.
    #[error("{0}")]
    Step(StepError),
}

/// The rays of the pixels of images of one size.
pub struct Camera {
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// For each pixel: x and y of the point of its ray at a depth of 1.
    pub rays: Vec<[f64; 2]>,
}

/// The cameras of a topic, one for all equal infos.
pub struct Cameras {
    image: Image,
    infos: Vec<CameraInfo>,
    cameras: Vec<Camera>,
    most_pixels: usize,
}

/// Why a `CameraInfo` is not taken.
#[derive(Debug, thiserror::Error)]
pub enum CamerasError {
    /// It describes no camera.
    #[error(transparent)]
    Info(#[from] CameraInfoError),
    /// There are too many.
    #[error("it changes more than {MOST_CAMERAS} times")]
    TooMany,
    /// No sample has so many points.
    #[error("its images have {width} x {height} pixels: raise `max_points`")]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl Cameras {
    /// Those of images of a topic of this name, of at most so many pixels.
    pub fn of_topic(topic: &str, most_pixels: usize) -> Self {
        let image = if topic.contains("rect") { Image::Rectified } else { Image::Raw };
        Self { image, infos: Vec::new(), cameras: Vec::new(), most_pixels }
    }

    /// The number of the camera that this `CameraInfo` describes.
    ///
    /// # Errors
    /// Why there is none.
    pub fn number(&mut self, bytes: &[u8]) -> Result<usize, CamerasError> {
        let info = CameraInfo::parse(bytes, self.image)?;
        if let Some(number) = self.infos.iter().position(|known| *known == info) {
            return Ok(number);
        }
        let CameraInfo { width, height, .. } = info;
        if self.infos.len() == MOST_CAMERAS {
            return Err(CamerasError::TooMany);
        }
        if u64::from(width) * u64::from(height) > self.most_pixels as u64 {
            return Err(CamerasError::TooLarge { width, height });
        }
        self.cameras.push(Camera { size: [width, height], rays: info.rays()? });
        self.infos.push(info);
        Ok(self.infos.len() - 1)
    }

    /// The camera of a number.
    pub fn get(&self, number: usize) -> Option<&Camera> {
        self.cameras.get(number)
    }
}

/// Sends a message as a cloud; `camera` is that of an image.
///
/// # Errors
/// Why it becomes no cloud; nothing is sent then.
pub fn send_message(
    reading: Reading,
    bytes: &[u8],
    camera: Option<&Camera>,
    port: usize,
    outputs: &mut Outputs<'_>,
) -> Result<(), MessageError> {
    let fits = |points: usize, outputs: &Outputs<'_>| match points <= outputs.capacity(port) {
        true => Ok(()),
        false => Err(MessageError::TooLarge { points }),
    };
    if reading == Reading::Cloud {
        let cloud = PointCloud2::parse(bytes)?;
        fits(cloud.width() * cloud.height(), outputs)?;
        let sent = send_cloud(outputs, port, cloud.width(), cloud.height(), |points| {
            points.iter_mut().zip(cloud.points()).for_each(|(to, from)| *to = from);
            Ok(())
        });
        return sent.map_err(MessageError::Step);
    }
    let image = depth_image(reading, bytes)?;
    let (size, rays) = camera.map_or(([0, 0], &[][..]), |camera| (camera.size, &camera.rays));
    fits(rays.len(), outputs)?;
    let mut fault = None;
    let sent = send_cloud(outputs, port, size[0] as usize, size[1] as usize, |points| {
        image.points_into(size, rays, points).map_err(|e| {
            let reason = StepError(e.to_string());
            fault = Some(e);
            reason
        })
    });
    match fault {
        Some(fault) => Err(fault.into()),
        None => sent.map_err(MessageError::Step),
    }
}

/// How many points a message has. Its pixels are looked at as a step does.
///
/// # Errors
/// Why it becomes no cloud.
pub fn points_of(
    reading: Reading,
    bytes: &[u8],
    camera: Option<&Camera>,
    scratch: &mut Vec<[f32; 3]>,
) -> Result<usize, MessageError> {
    if reading == Reading::Cloud {
        let cloud = PointCloud2::parse(bytes)?;
        return Ok(cloud.width() * cloud.height());
    }
    let (size, rays) = camera.map_or(([0, 0], &[][..]), |camera| (camera.size, &camera.rays));
    scratch.resize(rays.len(), [0.0; 3]);
    depth_image(reading, bytes)?.points_into(size, rays, scratch)?;
    Ok(rays.len())
}

fn depth_image(reading: Reading, bytes: &[u8]) -> Result<DepthMessage<'_>, DepthMessageError> {
    match reading {
        Reading::Compressed => DepthMessage::parse_compressed(bytes),
        _ => DepthMessage::parse(bytes),
    }
}
