//! Valves and beam: what leaves the program, and what forbids it.
//!
//! What goes over the wire, plain:
//! - [`key`]: the key that both ends share, and its file
//! - `message`: what a datagram says: an order, for a time, in a session
//! - [`datagram`]: its bytes, which carry a keyed code
//! - `refusal`: why a datagram is refused, and counts
//! - [`receiver`]: the far end: which are accepted, and what is to be done now
//! - [`acknowledgement`]: what the far end tells the sender
//! - `far_end`: valves and beam together, the beam off before anything vents
//!
//! What decides, plain:
//! - [`machine`]: the states of actuation
//! - `answer`: whether the head goes where it is told
//! - [`far_watch`]: whether orders arrive at the far end
//! - `drive`, of `shaping` and [`pressure`]: bounds and growth of duties; pressures estimated from them
//! - [`pose_watch`]: whether a pose can be trusted (cameras: `stillpoint_pose::extrinsic`)
//! - `face_watch`: whether a face that moves explains why there is no fresh pose
//! - `plan_watch`: whether the standing plan holds in the requested set-up
//! - `drift`: whether a head slides in a channel that its target does not hold
//! - [`couch`]: whether the couch angle of the beam is that of the session
//! - [`aim`], `lease`: errors against tolerances; the lease of the beam
//! - `sender`: the sending end of datagrams
//!
//! What is found when a rig is new, plain:
//! - [`sequence`]: which valve is open when
//! - [`commissioning`]: dead bands, volumes, supply and leaks from the readings
//!
//! And [`mod@operators`]: `actuate.valves`, `gate.beam`, `actuate.far_end` and `actuate.commission`.

#![forbid(unsafe_code)]

pub mod acknowledgement;
pub mod aim;
mod answer;
pub mod commissioning;
pub mod couch;
pub mod datagram;
mod drift;
mod drive;
mod face_watch;
mod far_end;
pub mod far_watch;
pub mod key;
mod lease;
pub mod machine;
mod message;
pub mod operators;
mod plan_watch;
pub mod pose_watch;
pub mod pressure;
pub mod receiver;
mod refusal;
mod sealed;
mod sender;
pub mod sequence;
mod shaping;

pub use datagram::{EncodeError, LONGEST, decode, encode};
pub use far_end::{Doing, FarEnd};
pub use key::{Key, KeyError};
pub use message::{Message, Order, Receiving, Safe, Session, VALVES};
pub use receiver::{Act, Clock, Receiver, Receives};
pub use refusal::{Counts, DatagramRefusal};

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[
    Stage::of::<operators::ActuateValves>(),
    Stage::of::<operators::GateBeam>(),
    Stage::of::<operators::ActuateFarEnd>(),
    Stage::of::<operators::ActuateCommission>(),
];
