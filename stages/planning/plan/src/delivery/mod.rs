//! The dose that a moving patient got from a plan.
//!
//! Recorded motions are weighted by beam-on time and put into bins of six numbers; each bin has the dose of the whole plan
//! to the patient as he lay there, by rays through the moved image; the delivered dose is their mean. So the meterset is
//! spread evenly over beam-on time, and every beam meets every motion: the interplay of beams and motion is not modelled.
//!
//! - `time`: how long the beam was on at each motion
//! - `bins`: the motions in bins
//! - `dose`: the dose over bins

mod bins;
mod dose;
mod time;

pub use bins::{Bin, BinWidth, bins};
pub use dose::{mean_dose, shifted_cloud};
pub use time::{BeamTime, MotionAt, Stretch, beam_time};
