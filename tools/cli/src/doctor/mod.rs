//! What `doctor` measures: whether this machine will hold a pipeline.
//!
//! - `finding`: a setting with what is wanted, what was found, and how to mend it
//! - `settings`: settings of the kernel, read from `/proc` and `/sys`
//! - `limits`: limits of the user, shared memory, ports, and what dead runs left
//! - `wakeup`: how late a thread wakes, and how far the clocks drift apart
//! - `latency`: the same by the tools of real-time Linux, where they are installed
//! - `camera`: the rate of a camera of ROS 2

pub mod camera;
mod finding;
pub mod latency;
pub mod limits;
pub mod settings;
pub mod wakeup;

pub use finding::{Finding, Verdict};
