//! The figures at the end of both runs.

use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;

use crate::accuracy;
use crate::hold::Hold;
use crate::session_pipeline::pipeline_of;

/// A figure at the end of two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// What it says.
    pub name: String,
    /// Its unit; empty for a plain number.
    pub unit: &'static str,
    /// Its value in each run, where it has one.
    pub values: [Option<f64>; 2],
}

/// The figures of both sessions, those of the first one in front.
pub(super) fn of_sessions(sessions: [&Session; 2], registry: &Registry) -> Vec<Figure> {
    let [first, second] = sessions.map(|session| figures(session, registry));
    let mut all: Vec<Figure> = Vec::new();
    for (side, figures) in [first, second].into_iter().enumerate() {
        for (name, unit, value) in figures {
            match all.iter_mut().find(|figure| figure.name == name) {
                Some(figure) => figure.values[side] = value,
                None => {
                    let mut values = [None, None];
                    values[side] = value;
                    all.push(Figure { name, unit, values });
                }
            }
        }
    }
    all
}

/// The figures of a session: how the head was held, the beam, and the accuracy.
fn figures(session: &Session, registry: &Registry) -> Vec<(String, &'static str, Option<f64>)> {
    let mut all = Vec::new();
    let held = pipeline_of(session, registry).ok().and_then(|(graph, _)| Hold::of_session(&graph, session));
    if let Some(held) = held {
        for against in &held.targets {
            for off in &against.channels {
                let name = |what: &str| {
                    format!("{} from {} in {}, {what}", against.estimate, against.target, off.channel)
                };
                all.push((name("rms of the last 5 s"), off.unit, Some(off.rms)));
                all.push((name("worst of the last 5 s"), off.unit, Some(off.worst)));
            }
        }
        for beam in &held.gates {
            all.push((format!("{}: share of beam-on time", beam.topic), "", beam.duty));
            all.push((format!("{}: leases", beam.topic), "", Some(beam.leases as f64)));
        }
    }
    if let Some(found) = accuracy::of_session(session) {
        for (axis, rms) in ["x", "y", "z"].into_iter().zip(found.rms_mm) {
            if rms.is_some() {
                all.push((format!("{} from the truth in {axis}, rms", found.topic), "mm", rms));
            }
        }
        all.push((format!("{} from the truth, worst", found.topic), "mm", Some(found.worst_mm)));
        if let Some(turns) = &found.turns {
            for (axis, rms) in ["pitch", "roll", "yaw"].into_iter().zip(turns.rms_deg) {
                all.push((format!("{} from the truth in {axis}, rms", found.topic), "deg", Some(rms)));
            }
        }
    }
    all
}
