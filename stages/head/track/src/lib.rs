//! Follows what a stage before has cut out of a cloud.
//!
//! - [`mod@centroid`]: the mean of a cloud and how well it is known.
//! - [`quaternion`]: the pose between paired points, (4.21)-(4.22).
//! - `three_points`: three points on a head that move with it.
//! - `buckets`: points sorted into cells.
//! - `patch`: a quadric fitted to the points around a place.
//! - [`movable`]: how far each part of a face moves by itself.
//! - `nearest`: which place is nearest, from a table.
//! - [`surface`]: the reference surface.
//! - `align`: a cloud brought onto the surface.
//! - `observability`: which directions the surface constrains.
//! - `search`: where an alignment starts.
//! - [`tracker`]: a head followed frame by frame.
//! - [`planned`]: a reference from the planning CT, and where it is found.
//! - `capture`: when a face becomes the reference.
//! - `sightings`: in how many frames a face was seen at one place.
//! - `identity`: whether what is followed is still what was captured.
//! - `uncertainty`: what is known of a pose.
//! - `operator`, `track.centroid`; [`head`], `track.head`.
//! - [`summit`]: how high the highest place of a cloud is; `summit_operator`, `track.summit`.
//! - [`forehead`]: the distance to the forehead of a face in an image; `forehead_operator`, `track.forehead`.

mod align;
mod buckets;
mod capture;
pub mod centroid;
pub mod forehead;
mod forehead_operator;
pub mod head;
pub mod identity;
pub mod movable;
mod nearest;
mod observability;
mod operator;
mod output_frame;
mod patch;
pub mod planned;
pub mod quaternion;
mod search;
mod sightings;
pub mod summit;
mod summit_operator;
pub mod surface;
mod three_points;
pub mod tracker;
mod uncertainty;

pub use centroid::{Centroid, centroid};
pub use tracker::HeadTracker;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[
    Stage::of::<operator::TrackCentroid>(),
    Stage::of::<head::TrackHead>(),
    Stage::of::<summit_operator::TrackSummit>(),
    Stage::of::<forehead_operator::TrackForehead>(),
];
