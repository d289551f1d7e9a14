//! Leaf sequencing, step and shoot: the fluence of each beam as segments of a multileaf collimator.
//!
//! The fluence is brought to levels ([`LeafMap`]) and divided into segments by the algorithm of Engel (Discrete Appl. Math.
//! 152 (2005) 35): as few monitor units as any sequence has, and few segments. Then the weights of the segments are
//! optimised with the objectives of the plan, leaves' transmission included, and segments are added by their price
//! (Romeijn, Ahuja, Dempsey, Kumar, SIAM J. Optim. 15 (2005) 838) until the objective is near to that of the fluence.
//!
//! - `map`: the fluence of a beam on leaf pairs and columns, in levels
//! - `engel`: levels into segments
//! - `segment`: where the leaves of a segment stand, and what passes them
//! - `influence`: the dose of segments from that of bixels
//! - `price`: the segment that a plan gains most by
//! - `aperture`: the fluence of beams whose leaves move while they give dose
//! - `sequence`: all of it for the beams of a plan

mod aperture;
mod engel;
mod influence;
mod map;
mod price;
mod segment;
mod sequence;

pub use aperture::{Aperture, LeafPairs, moving_fluence};
pub use engel::{Shape, divide};
pub use map::{LeafMap, LeavesError, Levels, within_leaves};
pub use segment::{LeafBeam, Segment};
pub use sequence::{FluenceBeam, LeafOptions, Sequenced, sequence};
