//! The virtual rig: a head on a couch, as a depth camera sees it.
//!
//! Plain mathematics that knows nothing of pipelines; SI units and radians throughout.
//!
//! - [`shape`]: ellipsoids and cuboids that cannot be built with sizes that make no sense
//! - [`head`]: the parametric head
//! - [`scene`]: couch, pads, clutter and floor
//! - [`camera`]: pinhole intrinsics and the camera's place over the couch
//! - [`ray`]: one ray against one shape
//! - [`trajectory`]: scripted head motion

pub mod camera;
pub mod head;
pub mod ray;
pub mod scene;
pub mod shape;
pub mod trajectory;
