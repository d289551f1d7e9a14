//! Why a camera is not placed by the edges of the couch.

use thiserror::Error;

/// Why a camera is not placed by the edges of the couch.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum EdgeError {
    /// A number of the couch is out of its range.
    #[error("{what} of the couch: {value_mm} mm (allowed: {least_mm} to {most_mm} mm)")]
    Range {
        /// Name of the number.
        what: &'static str,
        /// Its value, mm.
        value_mm: f64,
        /// The least, mm.
        least_mm: f64,
        /// The most, mm.
        most_mm: f64,
    },
    /// There is no plane.
    #[error(
        "no flat couch fills the middle of the images: {share:.0} % of its pixels are on one plane (at least 60 %); clear the couch, \
         and point the camera at it"
    )]
    NoPlane {
        /// Percent of the pixels.
        share: f64,
    },
    /// There are no two edges at the width of the couch.
    #[error(
        "no two long edges {width_mm:.0} mm apart are found ({found} of {least} places on the weaker one): both must be in view; \
         check --couch-width, and clear the edges"
    )]
    NoSides {
        /// The stated width, mm.
        width_mm: f64,
        /// Places on the weaker edge.
        found: usize,
        /// The least.
        least: usize,
    },
    /// There is no edge at the head end.
    #[error(
        "the edge at the head end is seen over {share:.0} % of the couch's width (at least {least:.0} %): bring it into view as a \
         whole, or use a board or balls"
    )]
    NoEnd {
        /// Percent of the width.
        share: f64,
        /// The least.
        least: f64,
    },
    /// Both ends are in view.
    #[error("both ends of the couch are in view, so it is open which is the head end: show one of them")]
    TwoEnds,
    /// An edge is not straight.
    #[error(
        "{edge} is not straight: its places scatter by {found:.2} pixels (allowed: {most:.2}); clear it, or use a board or balls"
    )]
    Bent {
        /// Name of the edge.
        edge: &'static str,
        /// Root of the mean square of the distances, px.
        found: f64,
        /// The most, px.
        most: f64,
    },
    /// Parts of an edge are off its line.
    #[error(
        "{edge} has steps: {share:.0} % of its places are on one line (at least {least:.0} %); clear it, or use a board or balls"
    )]
    Steps {
        /// Name of the edge.
        edge: &'static str,
        /// Percent of its places.
        share: f64,
        /// The least.
        least: f64,
    },
    /// The width differs.
    #[error(
        "the couch is measured {found_mm:.1} mm wide, and {given_mm:.1} mm are given (edges may be blurred by {most} pixels each): check \
         the width, the unit of the depth and the focal lengths"
    )]
    Width {
        /// The measured width, mm.
        found_mm: f64,
        /// The stated width, mm.
        given_mm: f64,
        /// The most, px.
        most: f64,
    },
    /// The head end is not square to the sides.
    #[error(
        "the edge at the head end is {off_deg:.2} degrees from square to the long edges (allowed: {most_deg} degrees): use a board or \
         balls"
    )]
    NotSquare {
        /// By how much, degrees.
        off_deg: f64,
        /// The most, degrees.
        most_deg: f64,
    },
}
