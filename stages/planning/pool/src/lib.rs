//! The planning pool: pure calls by content.
//!
//! A [`Call`] is a pure function of arguments that are named by the hash of their bytes, and its key is the SHA-256 of
//! all that its answer depends on. Any worker of the same [`Build`] answers with the same bytes. So a call may be sent
//! twice, lost, given to another worker, or answered twice, and the plan is the same to the byte: for no worker or eight.
//!
//! Nothing here knows a network or a clock: a [`Courier`] carries messages and tells the time.
//!
//! - `hash`: names of contents; `wire`: canonical bytes, by serde
//! - `build`: what must be alike so that two processes give the same bytes
//! - `call`: what is asked; [`goals`] and [`answer`]: arguments and answers as bytes; `compute`: the functions
//! - `message`: what clients and workers say; `fetch`: contents, part by part
//! - `store`: contents on disk; `opened`: contents in memory
//! - `worker`, `client`: the two sides as state machines; `roster`: the workers that a client knows
//! - `courier`: who carries messages; [`topic`]: messages as samples; [`pipe`]: messages over the pipes of a child process
//! - `pool`: a client behind a courier; `error`: why a call has no answer
//! - `record`: the calls of a run as a file
//! - `simulate`: the same run with other workers and another network
//! - `setup`: what a search stands on, with the names of its contents
//! - `solver`: the solver of a search over the pool; `later`: the solver of a search that does not wait
//! - `doses`: the doses of beams over the pool; `games`: the games of a training; `game`: their patients and rules on the wire

#![forbid(unsafe_code)]

pub mod answer;
mod build;
mod call;
mod client;
mod compute;
mod courier;
mod doses;
mod error;
mod fetch;
mod game;
mod games;
pub mod goals;
mod hash;
mod later;
mod message;
mod opened;
pub mod pipe;
mod pool;
mod record;
mod roster;
mod setup;
mod simulate;
mod solver;
mod store;
pub mod topic;
mod wire;
mod worker;

pub use build::{Build, BuildError};
pub use call::{BeamDoses, Call, Kind, MOST_BYTES};
pub use client::{Client, ClientSettings, Event, Inside, Tally};
pub use compute::Ready;
pub use courier::{Arrival, Courier, CourierError, To};
pub use doses::PoolDoses;
pub use error::CallError;
pub use games::{Played, PoolGames};
pub use hash::Hash;
pub use later::{LaterSolver, Requested};
pub use message::{Hello, INLINE, Message, PART, Spent};
pub use pool::{Home, Pool};
pub use record::{Attempt, Handled, Record, RecordError, RecordedCall, Round};
pub use roster::WorkerState;
pub use setup::{DoseFiles, Names, PoolSetup};
pub use simulate::{Network, Outcome, Simulation, SimulationError, WorkersSpent};
pub use solver::PoolSolver;
pub use store::{Store, StoreError};
pub use wire::WireError;
pub use worker::{Job, Worker, WorkerCounts, WorkerSettings};
