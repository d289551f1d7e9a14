//! The virtual rig: a head on a couch, as a depth camera sees it.
//!
//! SI units and radians throughout. All modules but the operators and `camera_view` are plain mathematics that knows nothing
//! of pipelines.
//!
//! - [`shape`]: ellipsoids and cuboids that cannot be built with sizes that make no sense
//! - [`head`]: the parametric head
//! - [`scene`]: couch, pads, clutter and floor
//! - [`setting`]: what the head rests on and touches
//! - [`camera`]: pinhole intrinsics and the camera's place over the couch
//! - [`ray`]: one ray against one shape
//! - [`patient`]: patients of many builds, drawn by chance
//! - `quadric`: an ellipsoid as a camera sees it, row by row
//! - [`view`]: depth, label and incidence per pixel
//! - [`render`]: the view of a scene with the head at a pose
//! - `normal`: normal deviates from uniform bits
//! - [`noise`]: the model of a depth camera's errors, with presets
//! - `shadow`: what a projector beside the camera cannot light
//! - [`sensor`]: from a view to the depth image that a camera would give
//! - [`involuntary`]: breathing, nodding, drift, coughs
//! - [`trajectory`]: scripted head motion
//! - [`phantom`]: a phantom in place of the head, which moves by known steps and ramps
//! - `phantom_params`: what a config may say of it
//! - [`person`]: a neck of skin, a chest that breathes, a face that moves
//! - `camera_view`: all that makes an image, as one
//! - `operator`, `rig.camera`
//! - `view_operator`, `rig.view`: further cameras over the same head
//! - `bladders`: the head on air bladders: `rig.one_bladder`, `rig.three_bladders`, `rig.eight_bladders`

mod bladders;
pub mod camera;
mod camera_view;
pub mod head;
pub mod involuntary;
pub mod noise;
mod normal;
mod operator;
pub mod patient;
pub mod person;
pub mod phantom;
mod phantom_params;
mod quadric;
pub mod ray;
pub mod render;
pub mod scene;
pub mod sensor;
pub mod setting;
mod shadow;
pub mod shape;
pub mod trajectory;
pub mod view;
mod view_operator;

use bladders::operator::BladderRig;
use stillpoint_mechanics::plant::rigs::RIGS;
use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[
    Stage::of::<operator::Camera>(),
    Stage::of::<view_operator::CameraOperator>(),
    Stage::of::<BladderRig<0>>(),
    Stage::of::<BladderRig<1>>(),
    Stage::of::<BladderRig<2>>(),
];

// Every entry of the table of rigs is an operator here: a new entry needs its line above.
const _: () = assert!(RIGS.len() == 3);
