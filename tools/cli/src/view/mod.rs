//! The page of a run or a session: what is served, and by what.
//!
//! - `scene`: the topics that are shown
//! - `rows`: the head, its target, beam and valves over time
//! - `picture`: an image of the camera with the face in it, and the face in the couch's frame
//! - `served`: what clients get, put there by one thread and read by those of the clients
//! - `follow`: what is served of a running pipeline
//! - `past`: what is served of a session, at any time of it
//! - `pictures`: the images of a session, recorded or computed by a replay
//! - `figures`: the state as JSON: the figures of `top`, with paths, ledger and log
//! - `commands`: commands of the page, which need a token
//! - `server`: HTTP
//! - `foxglove`: other viewers, whose server is fed from here
//! - `messages`: what they are shown
//! - `page`: what a browser loads

mod commands;
mod figures;
mod follow;
mod foxglove;
mod messages;
mod past;
mod picture;
mod pictures;
mod rows;
mod scene;
mod served;
mod server;

pub use commands::Commands;
pub use follow::follow;
pub use foxglove::serve as serve_viewers;
pub use past::Past;
pub use served::Served;
pub use server::serve;
