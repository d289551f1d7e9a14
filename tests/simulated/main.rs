//! Whole pipelines in the simulated executor: the default one, the examples, those on measured data, and the guide's.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod answer;
mod beam_off;
mod budget;
mod contacts;
mod default_pipeline;
mod documents;
mod examples;
mod former;
mod frozen;
mod guide;
mod head_tracking;
mod held_head;
mod living;
mod mismatched;
mod misspelled;
mod null_sink;
mod one_dof;
#[path = "../../examples/own_control_law.rs"]
mod own_control_law;
#[path = "../../examples/own_operator.rs"]
mod own_operator;
#[path = "../../examples/own_transport.rs"]
mod own_transport;
// People call `main` of the examples that are programs; tests call its parts.
#[allow(dead_code)]
#[path = "../../examples/plan_a_case.rs"]
mod plan_a_case;
#[allow(dead_code)]
#[path = "../../examples/read_session.rs"]
mod read_session;
mod real_data;
mod script;
mod seams;
mod settings;
mod starting;
mod three_cameras;

use std::path::PathBuf;

use stillpoint_operator::{Registry, Stage};

/// Every kind that the project has.
pub const FAMILIES: &[&[Stage]] = &[
    stillpoint_pipeline::STAGES,
    stillpoint_rig::STAGES,
    stillpoint_ingest::STAGES,
    stillpoint_detect::STAGES,
    stillpoint_segment::STAGES,
    stillpoint_track::STAGES,
    stillpoint_estimate::STAGES,
    stillpoint_control::STAGES,
    stillpoint_actuate::STAGES,
    stillpoint_planner::STAGES,
];

/// All kinds by name.
pub fn registry() -> Registry {
    Registry::new(FAMILIES)
}

/// A path from the root of the workspace.
pub fn from_root(path: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(path)
}
