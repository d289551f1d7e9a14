//! Why a camera is not placed by a board.

use thiserror::Error;

/// Why a camera is not placed by a board.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BoardError {
    /// An image is damaged, too small or too large.
    #[error(
        "an image has {width} columns, {height} rows and {pixels} pixels (allowed: at least 16 columns and rows, 16777216 pixels, \
         a finite brightness of each): record it once more"
    )]
    Picture {
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// Its pixels.
        pixels: usize,
    },
    /// There is no image.
    #[error("there is no image: give at least one")]
    NoPicture,
    /// Images have other pixels than those before.
    #[error(
        "image {image} has {found:?} columns and rows, and the first {expected:?}: take images of one camera"
    )]
    Size {
        /// The image, from 1.
        image: usize,
        /// Its columns and rows.
        found: [usize; 2],
        /// Those of the first.
        expected: [usize; 2],
    },
    /// A number of the board is out of its range.
    #[error("{what} of the board: {value}{unit} (allowed: {least} to {most}{unit})")]
    Range {
        /// Name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The least.
        least: f64,
        /// The most.
        most: f64,
        /// Their unit.
        unit: &'static str,
    },
    /// The board looks the same after half a turn.
    #[error(
        "a board of {} x {} inner corners looks the same when it is turned by 180 degrees: take one with an odd and an even number, \
         such as 11 x 8", counts[0], counts[1]
    )]
    HalfTurn {
        /// Inner corners of the two sides.
        counts: [usize; 2],
    },
    /// Focal lengths or principal point are those of no camera.
    #[error(
        "the intrinsics {fx}, {fy}, {cx}, {cy} are not those of images of {width} x {height} pixels: give fx, fy, cx and cy in \
         pixels"
    )]
    Intrinsics {
        /// Focal length along a row, px.
        fx: f64,
        /// Focal length along a column, px.
        fy: f64,
        /// Column of the principal point, px.
        cx: f64,
        /// Row of the principal point, px.
        cy: f64,
        /// Columns of the images.
        width: usize,
        /// Rows of the images.
        height: usize,
    },
    /// There is no board.
    #[error(
        "no board is found in image {image} (the largest piece has {found} corners): check that the whole board is in view, sharp, \
         lit and without gloss{}; ink that is black to the eye can be white in infrared, toner is black in both", glare(*.bright)
    )]
    NoBoard {
        /// The image, from 1.
        image: usize,
        /// Corners of the largest piece of a board.
        found: usize,
        /// Share of the brightest pixels.
        bright: f64,
    },
    /// The board has another number of corners.
    #[error(
        "the board in image {image} has {} x {} inner corners, and {} x {} are given: count the places where four squares meet, and \
         check that none is out of view or covered{}", found[0], found[1], given[0], given[1], glare(*.bright)
    )]
    Count {
        /// The image, from 1.
        image: usize,
        /// Inner corners that are found.
        found: [usize; 2],
        /// Inner corners that are given.
        given: [usize; 2],
        /// Share of the brightest pixels.
        bright: f64,
    },
    /// Corners within the board are missing.
    #[error(
        "{missing} corners of the board are missing in image {image}, the first near column {:.0} and row {:.0}: remove what covers \
         the board, and gloss{}", near[0], near[1], glare(*.bright)
    )]
    Missing {
        /// The image, from 1.
        image: usize,
        /// How many.
        missing: usize,
        /// Where the first one should be, px.
        near: [f64; 2],
        /// Share of the brightest pixels.
        bright: f64,
    },
    /// The squares are too small.
    #[error(
        "the squares are {found:.1} pixels wide where they are smallest (at least {least}): bring the board nearer, or print larger \
         squares"
    )]
    Small {
        /// Width of the smallest square, px.
        found: f64,
        /// The least.
        least: f64,
    },
    /// Images differ.
    #[error(
        "the board in image {image} is {off:.2} pixels from where it is in the mean of all (allowed: {most:.2}): something moved; \
         record once more"
    )]
    Moved {
        /// The image, from 1.
        image: usize,
        /// By how much, px.
        off: f64,
        /// The most, px.
        most: f64,
    },
    /// The pose is not determined.
    #[error("the corners of the board determine no place: check the intrinsics, and that the board is flat")]
    NoPose,
    /// The tilt of the board is poorly known.
    #[error(
        "the tilt of the board is known to {found:.3} degrees (allowed: {most:.3}){}: look at the board 20 to 50 degrees off \
         its normal, take a larger board or a nearer one, or more images", if *.twofold { ", and another tilt fits nearly as well" } else { "" }
    )]
    Tilt {
        /// One standard deviation, degrees.
        found: f64,
        /// The most, degrees.
        most: f64,
        /// Another tilt fits nearly as well.
        twofold: bool,
    },
    /// A corner is not where it should be.
    #[error(
        "the corner near column {:.0} and row {:.0} is {off_mm:.2} mm from its place (allowed: {most_mm:.2} mm): check that the board \
         is flat, that the images are rectified, and the intrinsics", near[0], near[1]
    )]
    Residual {
        /// Where it is, px.
        near: [f64; 2],
        /// By how much, mm.
        off_mm: f64,
        /// The most, mm.
        most_mm: f64,
    },
    /// The corners have another focal length.
    #[error(
        "the perspective of the board is that of focal lengths that are {off:+.2} % longer (allowed: {most:.2} %): check the \
         intrinsics; they must be those of these images"
    )]
    Focal {
        /// Fitted over given focal length, less 1, percent.
        off: f64,
        /// The most, percent.
        most: f64,
    },
}

fn glare(bright: f64) -> String {
    match bright > 0.005 {
        true => format!(" ({:.0} % of the pixels have the greatest brightness)", 100.0 * bright),
        false => String::new(),
    }
}
