//! Why a camera is not placed.

use thiserror::Error;

/// Why a camera is not placed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ExtrinsicError {
    /// Too few balls are given.
    #[error("{found} balls are given (at least 3): three balls that are not in line determine a place")]
    FewTargets {
        /// Balls given.
        found: usize,
    },
    /// A number of a ball is out of its range.
    #[error("the {what} of ball {ball} is {value_mm} mm (allowed: {least_mm} to {most_mm} mm)")]
    Target {
        /// The ball, from 1.
        ball: usize,
        /// Name of the number.
        what: &'static str,
        /// Its value, mm.
        value_mm: f64,
        /// The least, mm.
        least_mm: f64,
        /// The most, mm.
        most_mm: f64,
    },
    /// The balls are nearly in line.
    #[error(
        "the balls are within {width_mm:.0} mm of one line (at least {least_mm:.0} mm): put one of them farther to the side"
    )]
    InLine {
        /// Width of the triangle, mm.
        width_mm: f64,
        /// The least, mm.
        least_mm: f64,
    },
    /// Balls can be exchanged.
    #[error(
        "balls of one size can be exchanged without a change of their distances by more than {most_mm:.0} mm, so it is open which \
         is which: make the sides of the triangle differ by more, or take another diameter for one ball"
    )]
    Alike {
        /// The distance that must be exceeded, mm.
        most_mm: f64,
    },
    /// Images have other pixels than those before.
    #[error("image {image} has {found:?} pixels, and those before {expected:?}: take images of one camera")]
    Size {
        /// The image, from 1.
        image: usize,
        /// Its columns and rows.
        found: [usize; 2],
        /// Those of the images before.
        expected: [usize; 2],
    },
    /// An image has another number of pixels than its size says.
    #[error(
        "image {image} has {found} pixels, but {size:?} columns and rows: the recording is damaged; record it once more"
    )]
    Pixels {
        /// The image, from 1.
        image: usize,
        /// Its pixels.
        found: usize,
        /// Its columns and rows.
        size: [usize; 2],
    },
    /// A cloud has no rows.
    #[error(
        "the clouds are not images (they have {height} row of {width} points): take those of a depth camera"
    )]
    Unorganised {
        /// Points.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// There is no image.
    #[error("there is no image: record at least one")]
    NoImage,
    /// There are balls missing.
    #[error(
        "{found} of {expected} balls are found{}: check that each is in view, whole and without gloss, and that the diameters are \
         right", describe(.at_mm)
    )]
    Missing {
        /// Balls found.
        found: usize,
        /// Balls given.
        expected: usize,
        /// Their centres in the camera's frame, mm.
        at_mm: Vec<[f64; 3]>,
    },
    /// The balls that are found are not where they are said to be.
    #[error(
        "as many balls are found as are given{}, but there is no match in which all distances are those that are given (allowed: \
         {most_mm:.1} mm); check the places, the unit of the depth and the focal lengths", describe(.at_mm)
    )]
    Distances {
        /// Largest difference of a distance, mm.
        most_mm: f64,
        /// Centres of all that was found, in the camera's frame, mm.
        at_mm: Vec<[f64; 3]>,
    },
    /// Several matches fit.
    #[error(
        "two assignments of balls to places fit equally well: remove what else is round, or move one ball"
    )]
    Ambiguous,
    /// The camera would be below the balls.
    #[error(
        "the camera would be {below_mm:.0} mm below the balls: two places are exchanged or an axis is mirrored; x is to the \
         patient's left, y to the head end, z up (supine, head first)"
    )]
    Mirrored {
        /// How far, mm.
        below_mm: f64,
    },
    /// The distances are all too long or too short.
    #[error(
        "the distances between the balls are {off:+.2} % longer than those that are given (allowed: {most:.2} %): check their \
         places; if these are right, the unit of the depth or the focal lengths are wrong, and `calibrate depth` checks the unit"
    )]
    Scale {
        /// Measured over given distances, less 1, percent.
        off: f64,
        /// The most, percent.
        most: f64,
    },
    /// The residual is too large.
    #[error(
        "ball {ball} is {off_mm:.2} mm from its place (allowed: {most_mm:.2} mm): check its place and that nothing moved"
    )]
    Residual {
        /// The ball, from 1.
        ball: usize,
        /// Its distance, mm.
        off_mm: f64,
        /// The most, mm.
        most_mm: f64,
    },
    /// The couch is not seen.
    #[error(
        "the couch around the balls is not seen ({found} points at height 0, at least {least}): clear it, or leave the check out \
         with --without-surface"
    )]
    NoSurface {
        /// Points.
        found: usize,
        /// The least.
        least: usize,
    },
    /// The couch is not where z is 0.
    #[error(
        "the couch is measured {off_mm:.1} mm from height 0 and tilted by {tilt_deg:.2} degrees (allowed: {most_mm:.1} mm, \
         {most_deg:.2} degrees): check the heights of the balls, or leave the check out with --without-surface"
    )]
    Surface {
        /// Mean height, mm.
        off_mm: f64,
        /// Tilt, degrees.
        tilt_deg: f64,
        /// The most, mm.
        most_mm: f64,
        /// The most, degrees.
        most_deg: f64,
    },
    /// There is no plate.
    #[error(
        "no flat plate fills the middle of the {which} images: {share:.0} % of its points are on one plane (at least 80 %)"
    )]
    NoPlate {
        /// Which images.
        which: &'static str,
        /// Percent of the points.
        share: f64,
    },
    /// The plate is tilted against the axis of the camera.
    #[error(
        "the plate in the {which} images is tilted by {tilt_deg:.1} degrees against the plane across the camera's axis (allowed: \
         {most_deg} degrees): set it square to the axis, so that the way along its normal is that along the axis"
    )]
    Tilted {
        /// Which images.
        which: &'static str,
        /// By how much, degrees.
        tilt_deg: f64,
        /// The most, degrees.
        most_deg: f64,
    },
    /// The sessions are exchanged.
    #[error(
        "the plate in the second images is {by_mm:.1} mm nearer than in the first: give the session at the smaller distance first"
    )]
    Exchanged {
        /// By how much, mm.
        by_mm: f64,
    },
    /// The plates are not parallel.
    #[error(
        "the plate turned by {tilt_deg:.2} degrees between the images (allowed: 1 degree): move it or the camera straight"
    )]
    Turned {
        /// By how much, degrees.
        tilt_deg: f64,
    },
}

fn describe(at_mm: &[[f64; 3]]) -> String {
    let place = |at: &[f64; 3]| format!("({:.0}, {:.0}, {:.0})", at[0], at[1], at[2]);
    match at_mm {
        [] => String::new(),
        all => {
            format!(" (at {} mm in the camera's frame)", all.iter().map(place).collect::<Vec<_>>().join(", "))
        }
    }
}
