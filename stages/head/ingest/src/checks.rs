//! The checks of clouds and images, one for each kind of fault, that every reader makes.
//!
//! A reader of files, of recordings and of the wire calls the same functions, so that what one of them refuses, all
//! refuse. `tests/sweep.rs` runs each check over each reader.

pub use stillpoint_patient::records::{MOST_QUOTED, Surplus, double, number, quoted, surplus};

use crate::INVALID_POINT;
use crate::depth::Intrinsics;

/// Distance from the camera, m, beyond which no camera of depth measures: the nearest point is closer.
pub const FAR: f32 = 20.0;
/// Distance from the camera, m, below which no cloud of a head lies as a whole.
pub const NEAR: f32 = 0.01;

/// A point as a reader hands it on: a point that is not finite, and the origin, with which drivers mark a missing
/// return, are [`INVALID_POINT`].
#[must_use]
pub fn point(point: [f32; 3]) -> [f32; 3] {
    let is_measured = point.iter().all(|c| c.is_finite()) && point != [0.0; 3];
    if is_measured { point } else { INVALID_POINT }
}

/// What a parameter says about the unit of coordinates or of depths, and how it is corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Coordinates in metres: `unit` can say otherwise.
    Metres,
    /// Coordinates in millimetres, as `unit` says.
    Millimetres,
    /// Depths in the unit of an image: `depth_unit` can say otherwise.
    Depths,
}

/// Why points, a camera or times are refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CheckError {
    /// No point is within reach of a depth camera.
    #[error(
        "its nearest point is {nearest:.0} m from the origin (allowed: at most {FAR} m): {}",
        match of {
            Scale::Metres => "are these millimetres? Then set `unit: mm`",
            Scale::Millimetres => "its unit is not `mm`: convert the points",
            Scale::Depths => "its depths are in another unit: set `depth_unit`",
        }
    )]
    Far {
        /// Distance of the nearest point, m.
        nearest: f32,
        /// What the parameter says.
        of: Scale,
    },
    /// All points are nearer than a head.
    #[error(
        "its farthest point is {farthest} m from the origin (allowed: at least {NEAR} m): are these metres? Then set \
         `unit: m`"
    )]
    Near {
        /// Distance of the farthest point, m.
        farthest: f32,
    },
    /// A number of a camera is not positive.
    #[error("its {name} is {value} (allowed: a positive number)")]
    Camera {
        /// The number.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A principal point is outside the image.
    #[error(
        "its {name} is {value} px in an image of {pixels} pixels along it (allowed: -0.5 to {}): use the intrinsics of this \
         resolution",
        *pixels as f64 - 0.5
    )]
    PrincipalPoint {
        /// The coordinate.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Pixels of the image along it.
        pixels: usize,
    },
    /// An image and its camera are in two frames.
    #[error(
        "it is in the frame `{}` and its CameraInfo in `{}`: set `camera_info` to the topic of its own camera",
        quoted(image),
        quoted(camera)
    )]
    Frame {
        /// Frame of the image.
        image: String,
        /// Frame of its camera.
        camera: String,
    },
    /// Two messages are too far apart in time.
    #[error(
        "message {} comes {} after message {}: the clock was set between these times (allowed: at most {}, `max_gap`): leave \
         messages out with `skip` and `frames`, or play it with `pace: ticks`",
        after + 1,
        long_time(*gap),
        after,
        long_time(*longest)
    )]
    Gap {
        /// Number of the first of them, from 1.
        after: usize,
        /// The time between them, ns.
        gap: u64,
        /// The longest that is allowed, ns.
        longest: u64,
    },
}

/// Refuses points that are likely to be in another unit. Missing points ([`point`]) do not count.
///
/// # Errors
/// The nearest point is farther than any depth camera measures, or the farthest is nearer.
pub fn scale(points: impl IntoIterator<Item = [f32; 3]>, of: Scale) -> Result<(), CheckError> {
    let squared = |p: [f32; 3]| p.iter().map(|c| c * c).sum::<f32>();
    let finite = points.into_iter().map(|p| squared(point(p))).filter(|s| s.is_finite());
    let range = finite.fold(None, |range: Option<[f32; 2]>, s| {
        Some(range.map_or([s, s], |[least, most]| [least.min(s), most.max(s)]))
    });
    let Some([nearest, farthest]) = range.map(|range| range.map(f32::sqrt)) else { return Ok(()) };
    match of {
        _ if nearest > FAR => Err(CheckError::Far { nearest, of }),
        Scale::Millimetres if farthest < NEAR => Err(CheckError::Near { farthest }),
        _ => Ok(()),
    }
}

/// Refuses a camera that cannot be that of images of `width` x `height` pixels.
///
/// # Errors
/// A number that is not finite, a focal length that is not positive, or a principal point outside the image.
pub fn camera(camera: &Intrinsics, width: usize, height: usize) -> Result<(), CheckError> {
    let Intrinsics { fx, fy, cx, cy, metres_per_count } = *camera;
    for (name, value) in [("fx", fx), ("fy", fy), ("the depth of a count", metres_per_count)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(CheckError::Camera { name, value });
        }
    }
    principal_point([cx, cy], [width, height])
}

/// Refuses a principal point outside an image of so many pixels in a row and rows.
///
/// # Errors
/// The coordinate, its value and the pixels of the image.
pub fn principal_point(at: [f64; 2], size: [usize; 2]) -> Result<(), CheckError> {
    for ((name, value), pixels) in ["cx", "cy"].into_iter().zip(at).zip(size) {
        let most = pixels as f64 - 0.5;
        if pixels > 0 && !(-0.5..=most).contains(&value) {
            return Err(CheckError::PrincipalPoint { name, value, pixels });
        }
    }
    Ok(())
}

/// Refuses an image and a description of a camera that name two frames. An empty name is none.
///
/// # Errors
/// Both frames.
pub fn same_frame(image: &str, camera: &str) -> Result<(), CheckError> {
    match image.is_empty() || camera.is_empty() || image == camera {
        true => Ok(()),
        false => Err(CheckError::Frame { image: image.to_owned(), camera: camera.to_owned() }),
    }
}

/// Refuses times between two messages that nobody waits for: a clock that was set while it recorded, or a first time of 0.
/// `times` are in ns, in the order in which they are sent.
///
/// # Errors
/// The numbers of the messages, from 1, and the time between them.
pub fn gaps(times: &[u64], longest: u64) -> Result<(), CheckError> {
    for (number, pair) in times.windows(2).enumerate() {
        let gap = pair[1].saturating_sub(pair[0]);
        if gap > longest {
            return Err(CheckError::Gap { after: number + 1, gap, longest });
        }
    }
    Ok(())
}

/// A time in ns for people.
fn long_time(time: u64) -> String {
    let seconds = time as f64 * 1e-9;
    match seconds {
        s if s >= 2.0 * 365.25 * 86400.0 => format!("{:.1} years", s / (365.25 * 86400.0)),
        s if s >= 2.0 * 86400.0 => format!("{:.1} days", s / 86400.0),
        s if s >= 2.0 * 3600.0 => format!("{:.1} hours", s / 3600.0),
        s => format!("{s:.1} s"),
    }
}

/// What is wrong with one item, a file or a message, of many.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// The item alone is damaged: it is left out and counted, or refused where a reader is strict.
    #[error("{0}")]
    Item(String),
    /// A parameter does not fit the items: it must be changed.
    #[error("{0}")]
    Params(String),
}

impl Fault {
    /// The same fault with the item that has it.
    #[must_use]
    pub fn of(self, item: &dyn std::fmt::Display) -> Self {
        match self {
            Self::Item(reason) => Self::Item(format!("{item}: {reason}")),
            Self::Params(reason) => Self::Params(format!("{item}: {reason}")),
        }
    }
}

impl From<CheckError> for Fault {
    fn from(error: CheckError) -> Self {
        Self::Params(error.to_string())
    }
}

/// The items of a recording that are kept, and why the others are left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checked<T> {
    /// Those that are kept, in their order.
    pub items: Vec<T>,
    /// What is wrong with each of the others.
    pub left_out: Vec<String>,
}

impl<T> Checked<T> {
    /// Keeps the items without a fault.
    ///
    /// # Errors
    /// A fault of the parameters; a fault of an item where the reader is strict, or where no item is left.
    pub fn of(items: impl IntoIterator<Item = Result<T, Fault>>, strict: bool) -> Result<Self, Fault> {
        let mut checked = Self { items: Vec::new(), left_out: Vec::new() };
        for item in items {
            match item {
                Ok(item) => checked.items.push(item),
                Err(Fault::Item(reason)) if !strict => checked.left_out.push(reason),
                Err(fault) => return Err(fault),
            }
        }
        match checked.items.is_empty() && !checked.left_out.is_empty() {
            true => Err(Fault::Item(checked.left_out.swap_remove(0))),
            false => Ok(checked),
        }
    }

    /// What a run says about the items that are left out: how many, and the first of them. `None`: all are kept.
    pub fn remark(&self, what: &str) -> Option<String> {
        let left = self.left_out.len();
        let first = self.left_out.first()?;
        let all = self.items.len() + left;
        let more = if left > 1 { ", the first" } else { "" };
        Some(format!("{left} of {all} {what} left out{more}: {first} (`strict: true` refuses them)"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millimetres_and_metres_are_recognised_and_missing_points_do_not_hide_them() {
        let head = [[0.0, 0.0, 430.0], INVALID_POINT, [0.0; 3], [100.0, 0.0, 500.0]];
        let refused = scale(head, Scale::Metres).unwrap_err().to_string();
        assert!(refused.contains("430 m") && refused.contains("unit: mm"), "{refused}");
        let small = head.map(|p| p.map(|c| c * 1e-6));
        assert!(scale(small, Scale::Millimetres).unwrap_err().to_string().contains("unit: m"));
        for of in [Scale::Metres, Scale::Millimetres, Scale::Depths] {
            assert_eq!(scale([INVALID_POINT, [0.0, 0.1, 1.2]], of), Ok(()));
            assert_eq!(scale([], of), Ok(()));
        }
    }

    #[test]
    fn a_principal_point_lies_in_its_image() {
        assert_eq!(principal_point([-0.5, 5.5], [8, 6]), Ok(()));
        for at in [[650.9, 2.0], [3.0, 5.6], [f64::NAN, 2.0], [-0.6, 2.0]] {
            assert!(principal_point(at, [8, 6]).is_err(), "{at:?}");
        }
    }

    #[test]
    fn a_gap_is_named_with_its_messages_and_its_length() {
        assert_eq!(gaps(&[0, 5, 10], 5), Ok(()));
        let refused = gaps(&[0, 1_760_000_000_000_000_000], 60_000_000_000).unwrap_err().to_string();
        assert!(refused.contains("message 2 comes 55.8 years after message 1"), "{refused}");
    }
}
