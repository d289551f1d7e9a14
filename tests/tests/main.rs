//! Whole systems: real processes, real shared memory, real recordings.
//!
//! - `bench`: a folder of its own, in which the kit's command is run as people run it
//! - `damaged`: sessions of which something is harmed
//! - `guide`: the operator of the page "write your own operator"
//! - `tampered`: a session written anew, with something in it changed
//! - `conformance`: the two equalities, for every pipeline
//! - `live`: failures in a live run
//! - `laps`: what a live run measures, and nothing depends on
//! - `driver`: drivers of cameras in C, C++ and Python
//! - `v4l2`: the driver for cameras of Linux, on a device that is not there
//! - `ending`: how runs end
//! - `safety_case`: the tests that the safety case names are there
//! - `releases`: sessions of every release
//! - `recording`: what survives its recorder
//! - `replaying`: what is the same is found the same, and what is not is named
//! - `seeing`: a head followed live, captured by a person; two cameras on any number of threads
//! - `seat`: cores and priorities
//! - `link`: edges that leave as datagrams
//! - `contracts`: bounds of time, counted live and decided alike in a replay
//! - `controllers`: three loops in one pipeline
//! - `ledger`: sent = received + accounted loss
//! - `breaking`: people who break a running rig
//! - `wire`: what a far end makes of datagrams that somebody else sends
//! - `attach`: people at a running pipeline
//! - `looking`: what runs, its topics and their rates, and its end from outside
//! - `settings`: parameters that people change while it runs
//! - `view`: the page of a run and of its session, in a browser
//! - `browser`: a browser without a window
//! - `programs`: operators in programs of their own
//! - `planted`: faults that are planted in loops, and what names them
//! - `unheard`: runs whose words nobody hears
//! - `refusals`: what `run` refuses
//! - `hung`: a recorder that hangs
//! - `stopping`: simulated and lock-step runs that somebody stops
//! - `traps`: what iceoryx2 does to samples of the dead, and why ours stay

// A test stops at the first surprise; clippy knows test functions, but not what they call.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod affinity;
mod attach;
mod bench;
mod breaking;
mod browser;
mod conformance;
mod contracts;
mod controllers;
mod damaged;
mod driver;
mod ending;
mod guide;
mod hung;
mod laps;
mod ledger;
mod link;
mod live;
mod looking;
mod lying;
mod planted;
mod programs;
mod recording;
mod refusals;
mod releases;
mod replaying;
mod safety_case;
mod seeing;
mod settings;
mod stopping;
mod tampered;
mod traps;
mod unheard;
mod v4l2;
mod view;
mod wire;
mod words;

/// The program that a [`bench::Bench`] runs. `STILLPOINT_MEASURED` names another one: the command of a release build, for
/// the measurements among the tests.
const PROGRAM: &str = env!("CARGO_BIN_EXE_stillpoint-kit");
