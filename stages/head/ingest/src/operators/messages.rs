//! Clouds out of messages of ROS 2, of recordings and of the wire alike.

use stillpoint_cdr::Reader;
use stillpoint_operator::{Outputs, StepError};

use super::points::send_cloud;
use super::unit::Unit;
use crate::bag::Reading;
use crate::camera_info::{CameraInfo, CameraInfoError, Image};
use crate::checks::{self, CheckError, Scale};
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
    /// The image and its camera are in two frames.
    #[error(transparent)]
    SelectedMessage(CheckError),
    /// Its points are in another unit.
    #[error(transparent)]
    Scale(CheckError),
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
    /// Its frame; empty where none is given.
    pub frame: String,
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

/// Which image a topic has: by the words of its last name (`image_rect`, `image_rect_raw`), not by letters that other
/// words contain (`corrected`, `unrectified`), and not by its namespace.
pub fn image_of_name(topic: &str) -> Image {
    let image = match topic.rsplit_once('/') {
        // A transport stands behind the name of the image.
        Some((image, "compressedDepth" | "compressed")) => image,
        _ => topic,
    };
    let last = image.rsplit('/').next().unwrap_or(image);
    match last.split('_').any(|word| word == "rect" || word == "rectified") {
        true => Image::Rectified,
        false => Image::Raw,
    }
}

impl Cameras {
    /// Those of images of a topic, of at most so many pixels. `image` is stated where the name of the topic does not
    /// decide.
    pub fn of_topic(topic: &str, image: Option<Image>, most_pixels: usize) -> Self {
        let image = image.unwrap_or_else(|| image_of_name(topic));
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
        let frame = info.frame.clone();
        self.cameras.push(Camera { size: [width, height], frame, rays: info.rays()? });
        self.infos.push(info);
        Ok(self.infos.len() - 1)
    }

    /// The camera of a number.
    pub fn get(&self, number: usize) -> Option<&Camera> {
        self.cameras.get(number)
    }
}

/// How messages become clouds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form {
    /// Their type.
    pub reading: Reading,
    /// Unit of the coordinates of clouds.
    pub unit: Unit,
    /// Depth of a count of images, m, where it is stated.
    pub depth_unit: Option<f64>,
}

/// A message that was read, and the camera of an image.
enum Read<'a> {
    Cloud(PointCloud2<'a>),
    Image(DepthMessage<'a>, [u32; 2], &'a [[f64; 2]]),
}

impl Form {
    /// Sends a message as a cloud; `camera` is that of an image.
    ///
    /// # Errors
    /// Why it becomes no cloud; nothing is sent then.
    pub fn send(
        &self,
        bytes: &[u8],
        camera: Option<&Camera>,
        port: usize,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), MessageError> {
        let read = self.read(bytes, camera)?;
        let [width, height] = read.size(outputs.capacity(port))?;
        let mut fault = None;
        let sent = send_cloud(outputs, port, width, height, |points| {
            self.fill(&read, points).map_err(|e| {
                let reason = StepError(e.to_string());
                fault = Some(e);
                reason
            })
        });
        match fault {
            Some(fault) => Err(fault),
            None => sent.map_err(MessageError::Step),
        }
    }

    /// Looks at a message as [`send`](Self::send) does.
    ///
    /// # Errors
    /// Why it becomes no cloud of `most` points.
    pub fn check(
        &self,
        bytes: &[u8],
        camera: Option<&Camera>,
        most: usize,
        scratch: &mut Vec<[f32; 3]>,
    ) -> Result<(), MessageError> {
        let read = self.read(bytes, camera)?;
        let [width, height] = read.size(most)?;
        scratch.resize(width * height, [0.0; 3]);
        self.fill(&read, scratch)
    }

    fn read<'a>(&self, bytes: &'a [u8], camera: Option<&'a Camera>) -> Result<Read<'a>, MessageError> {
        if self.reading == Reading::Cloud {
            return Ok(Read::Cloud(PointCloud2::parse(bytes)?));
        }
        let image = match self.reading {
            Reading::Compressed => DepthMessage::parse_compressed(bytes, self.depth_unit)?,
            _ => DepthMessage::parse(bytes, self.depth_unit)?,
        };
        let Some(camera) = camera else { return Ok(Read::Image(image, [0, 0], &[])) };
        let frame =
            Reader::in_either_order(bytes).and_then(|mut r| r.foreign_header()).map_or("", |(_, f)| f);
        checks::same_frame(frame, &camera.frame).map_err(MessageError::SelectedMessage)?;
        Ok(Read::Image(image, camera.size, &camera.rays))
    }

    /// Writes all points, in metres.
    fn fill(&self, read: &Read<'_>, points: &mut [[f32; 3]]) -> Result<(), MessageError> {
        let of = match read {
            Read::Cloud(cloud) => {
                let all = points.iter_mut().zip(cloud.points());
                all.for_each(|(to, from)| *to = checks::point(self.unit.in_metres(from)));
                self.unit.scale()
            }
            Read::Image(image, size, rays) => {
                image.points_into(*size, rays, points)?;
                Scale::Depths
            }
        };
        checks::scale(points.iter().copied(), of).map_err(MessageError::Scale)
    }
}

impl Read<'_> {
    /// Columns and rows of the cloud.
    fn size(&self, most: usize) -> Result<[usize; 2], MessageError> {
        let [width, height] = match self {
            Self::Cloud(cloud) => [cloud.width(), cloud.height()],
            Self::Image(_, size, _) => size.map(|n| n as usize),
        };
        match width.saturating_mul(height) {
            points if points <= most => Ok([width, height]),
            points => Err(MessageError::TooLarge { points }),
        }
    }
}
