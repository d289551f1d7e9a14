//! Heads on bladders: what the virtual rigs obey (SCIENCE C3 to C6).
//!
//! - [`valve`]: how much air an orifice lets through
//! - `plate`: a bladder pressed between two plates
//! - `body`: a rigid head on bladders, with valves: the equations of motion
//! - [`layouts`]: the head with one, three and six degrees of freedom
//! - [`rigs`]: the table of rigs, by name
//! - [`equilibrium`]: where the head rests with its valves shut, and how that moves with the air
//! - [`reach`]: which poses bladders can hold
//! - [`sticking`]: friction of the bladders on the head
//! - [`rolling`]: contacts that move over head and bladders, in place of those that stay
//! - [`grip`]: friction of such contacts

mod body;
pub mod equilibrium;
pub mod grip;
pub mod layouts;
mod plate;
pub mod reach;
pub mod rigs;
pub mod rolling;
pub mod sticking;
pub mod valve;

pub use body::{Drive, Plant, State, Stop};
pub use layouts::{OneDof, SixDof, ThreeDof};
pub use plate::Pressed;
pub use reach::{Hold, Limits, Unreachable};
