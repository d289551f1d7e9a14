//! Controllers: targets, a baseline, linear-quadratic and adaptive neural control.
//!
//! - [`riccati`], [`lyapunov`]: the matrix equations behind the gains
//! - [`effect`], [`valves`]: what bladders do to a head, and from a bladder's net duty to its two valves
//! - `squeeze`: the pressures of bladders that are more than the channels they hold
//! - [`mod@reference`]: how a target is approached
//! - [`tracking`], `past`: the error from it at the time of the pose, and when an order acts
//! - [`periodic`], [`harmonic`], `proof`: breath and nods of the patient, with frequencies that are tracked, and whether
//!   it helps to answer them
//! - `balance`: whether bladders follow their orders
//! - [`response`]: how a step of it was answered: rise, settling, overshoot
//! - [`pi`]: proportional and integral control
//! - [`lqi`], `identified`: linear-quadratic control with an integrator, and plants that were identified
//! - [`adaptive`], [`projection`], [`mrac`]: adaptive laws that stay inside bounds, and the controller made of them
//! - [`features`], [`lstm`], [`predictor`], [`tensor_file`]: what the adaptive law learns over; a recurrent network, and its
//!   file
//! - `moves`, `goal`: where the head is to be
//! - [`rig`]: rigs whose mechanics are known: what their bladders do, and what they can hold
//! - [`channels`]: which channels of a pose are controlled, and how they stand in samples
//! - [`mod@operators`], `control.target`, `control.pi`, `control.lqg` and `control.mrac`

#![forbid(unsafe_code)]

pub mod adaptive;
mod balance;
pub mod channels;
pub mod contacts;
pub mod effect;
pub mod features;
mod goal;
pub mod harmonic;
mod identified;
pub mod lqi;
pub mod lstm;
pub mod lyapunov;
mod moves;
pub mod mrac;
pub mod operators;
mod past;
pub mod periodic;
pub mod pi;
pub mod predictor;
pub mod projection;
mod proof;
pub mod reference;
pub mod response;
pub mod riccati;
pub mod rig;
mod squeeze;
pub mod tensor_file;
pub mod tracking;
pub mod valves;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[
    Stage::of::<operators::ControlTarget>(),
    Stage::of::<operators::ControlPi>(),
    Stage::of::<operators::ControlLqg>(),
    Stage::of::<operators::ControlMrac>(),
    Stage::of::<operators::ControlContacts>(),
];
