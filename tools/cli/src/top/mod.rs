//! What a run does now, or what a session shows of one: operators, edges, safety, processes, recorder, and what is wrong.
//!
//! - `snapshot`: the figures at one time, the same for a run and a session
//! - `troubles`: what is wrong, in words
//! - `watch`: a running pipeline, observed over a window of time
//! - `plain`: a snapshot as tables of text
//! - `view`: a snapshot on a terminal
//! - `keys`: what the keys of the terminal do

mod keys;
mod plain;
mod snapshot;
mod troubles;
mod view;
mod watch;

pub use keys::{Panel, View};
pub use plain::{plain, words};
pub use snapshot::{Parts, Snapshot, figures};
pub use view::draw;
pub use watch::Watch;
