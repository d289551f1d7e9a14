//! The chain on scenes made here, on those of the virtual rig, on rendered and on measured clouds, and as an operator.

mod drawn;
mod drawn_scenes;
mod face;
mod hard_scenes;
mod identity_scenes;
mod labelled;
mod operator;
mod picture;
mod real_data;
mod rig_scenes;
mod scene;
mod steady;
