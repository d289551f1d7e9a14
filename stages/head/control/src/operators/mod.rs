//! The operators of this family, a file each.
//!
//! - `target`: `control.target`, where the head is to be
//! - `planned`: what a config says of targets, checked
//! - `pi`, `lqg`, `mrac`: the controllers `control.pi`, `control.lqg` and `control.mrac`
//! - `contacts`: `control.contacts`, how the bladders hold the head
//! - `params`: parameters that controllers share
//! - `shell`: what every controller does around its law
//! - `freshness`: how old the newest measurement behind a track is

mod contacts;
mod controller_shell;
mod followed;
mod freshness;
mod lqg;
mod mrac;
mod params;
mod pi;
mod planned;
mod target;

pub use contacts::{ContactsParams, ControlContacts};
pub use lqg::{ControlLqg, LqgParams};
pub use mrac::{ControlMrac, FeatureMap, MracParams};
pub use params::{BladderRates, PerChannel, PlantParams};
pub use pi::{ControlPi, PiParams};
pub use target::{ControlTarget, CountedFrom, MoveParams, ReachParams, TargetParams};
