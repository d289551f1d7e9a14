//! How far the filtered head position is from the rig's truth, out of a session.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, Pose, Sample, Standing, Track};

/// Motion of the filtered position against the truth, each about its own mean: a centroid of what the camera sees is not
/// the head's origin, so only motion can be compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// The estimate's topic.
    pub topic: String,
    /// Pairs compared.
    pub samples: usize,
    /// Root mean square per axis of the frame, mm; none where the track does not follow the axis.
    pub rms_mm: [Option<f64>; 3],
    /// Largest distance, mm.
    pub worst_mm: f64,
    /// How far the truth moved from its first place, mm.
    pub moved_mm: f64,
}

impl std::fmt::Display for Accuracy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named = ["x", "y", "z"].into_iter().zip(self.rms_mm);
        let axes = named
            .filter_map(|(axis, rms)| Some(format!("{axis} {:.2}", rms?)))
            .collect::<Vec<_>>()
            .join(", ");
        write!(
            f,
            "accuracy of {} against the rig's truth, motion only: rms {axes} mm, worst {:.2} mm, \
             while the head moved up to {:.1} mm ({} samples)",
            self.topic, self.worst_mm, self.moved_mm, self.samples
        )
    }
}

/// The accuracy of a session that keeps a truth and a track in one frame; `None` where it does not.
pub fn of_session(path: &Path) -> Option<Accuracy> {
    let session = Session::open(path).ok()?;
    let topics = session.topics();
    let truth =
        topics.iter().find(|t| t.name.ends_with(".truth") && t.type_name == Pose::KIND.type_name())?;
    let track = topics.iter().find(|t| t.type_name == Track::KIND.type_name() && t.frame == truth.frame)?;
    let (truth_name, track_name) = (truth.name.clone(), track.name.clone());
    let mut true_at: BTreeMap<u64, [f64; 3]> = BTreeMap::new();
    let mut tracked: Vec<(u64, [f64; 3])> = Vec::new();
    for recorded in session.samples_where(|t| t.name == truth_name || t.name == track_name) {
        let recorded = recorded.ok()?;
        if topics[recorded.topic].name == truth_name {
            let view = Pieces::split(Pose::KIND, &recorded.sample).ok()?.view::<Pose>().ok()?;
            true_at.insert(view.head.origin, view.first()?.position);
        } else {
            let view = Pieces::split(Track::KIND, &recorded.sample).ok()?.view::<Track>().ok()?;
            let track = view.first()?;
            if track.standing() != Standing::None {
                tracked.push((view.head.origin, track.position));
            }
        }
    }
    let pairs: Vec<_> = tracked.into_iter().filter_map(|(t, p)| Some((*true_at.get(&t)?, p))).collect();
    let truths: Vec<_> = pairs.iter().map(|(truth, _)| *truth).collect();
    let estimates: Vec<_> = pairs.iter().map(|(_, estimate)| *estimate).collect();
    let (true_mean, mean) = (mean_of(&truths)?, mean_of(&estimates)?);
    let minus = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| (a[i] - b[i]) * 1e3) };
    let norm = |a: [f64; 3]| (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
    let (mut squares, mut worst, mut moved) = ([0.0; 3], 0.0f64, 0.0f64);
    for (truth, estimate) in &pairs {
        let motion = minus(*truth, true_mean);
        let error = minus(*estimate, mean);
        // An axis that the track does not follow has no error.
        let error = [0, 1, 2].map(|i| error[i] - motion[i]);
        let error = error.map(|e| if e.is_nan() { 0.0 } else { e });
        moved = moved.max(norm(minus(*truth, truths[0])));
        worst = worst.max(norm(error));
        for i in 0..3 {
            squares[i] += error[i] * error[i];
        }
    }
    let followed = mean.map(f64::is_finite);
    let rms_mm = [0, 1, 2].map(|i| followed[i].then(|| (squares[i] / pairs.len() as f64).sqrt()));
    Some(Accuracy { topic: track_name, samples: pairs.len(), rms_mm, worst_mm: worst, moved_mm: moved })
}

fn mean_of(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    let sum = points.iter().fold([0.0; 3], |sum: [f64; 3], p| std::array::from_fn(|i| sum[i] + p[i]));
    (!points.is_empty()).then(|| sum.map(|s| s / points.len() as f64))
}
