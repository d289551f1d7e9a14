//! Bladders against a head: contact and grasp (chapter 3, appendix A, SCIENCE B).
//!
//! Twists are ordered (v, w), wrenches (f, tau). All vectors of one formula are in the axes of one frame, the head's
//! unless a name says else.
//!
//! - [`se3`]: exponential and logarithm of rigid motions
//! - [`chart`]: surfaces by two coordinates: sphere, spheroid, plane
//! - [`rolling`]: how a contact wanders over both surfaces (Montana's equations)
//! - [`friction`]: what a soft finger can bear
//! - [`grasp`]: contacts to wrenches and back: Jacobians, grasp maps, null spaces
//! - [`forward`]: from the rates of the bladders to those of the head
//! - [`mobility`]: how many coordinates links and joints leave
//! - [`squeeze`]: forces that hold a wrench while all contacts push

pub mod chart;
pub mod forward;
pub mod friction;
pub mod grasp;
pub mod mobility;
pub mod rolling;
pub mod se3;
pub mod squeeze;
