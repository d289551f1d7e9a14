//! How long samples take on their way from a source to a sink, and where the time goes, from the journals alone.
//!
//! - `journals`: the journals of a session or of a running pipeline, with the times at which outputs were sent
//! - `paths`: the paths from sources to sinks
//! - `follow`: one sample on its way along a path, hop by hop
//! - `figures`: quantiles of the times of a path, and the hop to blame for the longest
//! - `edges`: rate, latency and loss of every edge
//! - `perfetto`: the activations as a trace in the JSON format of Chrome and Perfetto

mod edges;
mod figures;
mod follow;
mod journals;
mod paths;
mod perfetto;

use serde::Serialize;

pub use edges::{EdgeFigures, edges};
pub use figures::passages_between;
pub use figures::{Blame, HopFigures, Judged, LapFigures, Lost, PathFigures, Worst};
pub use follow::PoseRole;
pub use journals::{Journals, Laps, Operator, add_laps, as_run, laps};
pub use perfetto::perfetto;

pub use crate::statistics::Spread;

/// The figures of all paths.
#[derive(Clone, Debug, Serialize)]
pub struct Trace {
    /// The paths with samples first, those with the most operators first.
    pub paths: Vec<PathFigures>,
    /// Whether there are more paths than were followed.
    pub more_paths: bool,
}

impl Trace {
    /// The figures of all paths on which `asked` holds for the topic at the start and the topic or operator at the end.
    pub fn of(journals: &Journals<'_>, asked: impl Fn(&str, &str) -> bool) -> Self {
        let (paths, more_paths) = paths::of(journals);
        let mut found: Vec<PathFigures> = paths
            .iter()
            .filter(|path| asked(&path.from(journals), &path.to(journals)))
            .map(|path| PathFigures::of(journals, path))
            .collect();
        found.sort_by_key(|p| (p.arrived == 0, std::cmp::Reverse(p.operators.len()), p.path.clone()));
        Self { paths: found, more_paths }
    }

    /// Numbers of the paths on which samples arrive first: one for each start and end.
    pub fn quickest(&self) -> Vec<usize> {
        let mut chosen: Vec<usize> = Vec::new();
        for (number, path) in self.paths.iter().enumerate().filter(|(_, p)| p.arrived > 0) {
            let is_same = |at: &usize| self.paths[*at].from == path.from && self.paths[*at].to == path.to;
            // A path by which most samples do not come is not the quickest of all of them.
            let order =
                |p: &PathFigures| (2 * p.arrived < p.samples, p.total_ms.p50.unwrap_or(f64::INFINITY));
            match chosen.iter().position(is_same) {
                Some(at) if order(path) < order(&self.paths[chosen[at]]) => chosen[at] = number,
                Some(_) => {}
                None => chosen.push(number),
            }
        }
        chosen
    }

    /// The path that is shown first: the one with the most operators of those on which samples arrived.
    pub fn longest(&self) -> Option<&PathFigures> {
        self.paths.iter().find(|p| p.arrived > 0)
    }
}

#[cfg(test)]
mod tests;
