//! How far the filtered head is from the rig's truth, out of a session.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;
use stillpoint_recorder::{Session, Topic};
use stillpoint_samples::{Pieces, Pose, PoseElement, Sample, Standing, Track, TrackElement};

use crate::offset::mean_offset;
use crate::wiring::{Stage, Wiring};

/// Motion of the filtered head against the truth.
///
/// A track has another place on the head, and other axes, than the rig: only motion can be compared. Where the track has
/// rotations, one rigid offset between the two is taken out, the mean one; else the mean of both positions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// The estimate's topic.
    pub topic: String,
    /// Pairs compared.
    pub samples: usize,
    /// Root mean square per axis of the frame, mm; none where the track does not follow the axis. Of a track with
    /// rotations, at the rig's place on the head.
    pub rms_mm: [Option<f64>; 3],
    /// Largest distance, mm.
    pub worst_mm: f64,
    /// How far the truth moved from its first place, mm.
    pub moved_mm: f64,
    /// Rotations, where the track has them.
    pub turns: Option<Turns>,
}

/// Rotation of the filtered head against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Turns {
    /// Root mean square about each axis of the frame, degrees.
    pub rms_deg: [f64; 3],
    /// Largest angle, degrees.
    pub worst_deg: f64,
    /// How far the truth turned from its first direction, degrees.
    pub turned_deg: f64,
}

impl std::fmt::Display for Accuracy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named = ["x", "y", "z"].into_iter().zip(self.rms_mm);
        let axes =
            named.filter_map(|(axis, rms)| Some(format!("{axis} {}", three(rms?)))).collect::<Vec<_>>();
        write!(
            f,
            "accuracy of {} against the rig's truth, motion only: rms {} mm, worst {} mm, while the head moved up to {} mm",
            self.topic,
            axes.join(", "),
            three(self.worst_mm),
            three(self.moved_mm)
        )?;
        if let Some(Turns { rms_deg: [x, y, z], worst_deg, turned_deg }) = self.turns {
            let [x, y, z, worst, turned] = [x, y, z, worst_deg, turned_deg].map(three);
            write!(
                f,
                "; rms about x {x}, y {y}, z {z} degrees, worst {worst}, while it turned up to {turned}"
            )?;
        }
        write!(f, " ({} samples)", self.samples)
    }
}

/// Three digits that count, and at most six behind the point.
fn three(value: f64) -> String {
    let before = if value == 0.0 { 0.0 } else { libm::log10(value.abs()).floor() };
    let digits = (2.0 - before).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

/// A place and a direction; NaN where they are not known.
#[derive(Clone, Copy, Debug)]
struct Place {
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
}

impl Place {
    fn new(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Self {
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        Self { position: position.into(), rotation }
    }

    fn of_pose(pose: &PoseElement) -> Self {
        Self::new(pose.position, pose.orientation)
    }

    fn of_track(track: &TrackElement) -> Self {
        Self::new(track.position, track.orientation)
    }

    fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.position.into(), self.rotation)
    }

    /// All three rotations of a track are known.
    fn is_turned(&self) -> bool {
        self.rotation.coords.iter().all(|c| c.is_finite())
    }
}

/// The accuracy of a session that keeps a truth and a track in one frame; `None` where it does not. Of several tracks it
/// is that of the last in a chain.
pub fn of_session(session: &Session) -> Option<Accuracy> {
    let topics = session.topics();
    let truth =
        topics.iter().find(|t| t.name.ends_with(".truth") && t.type_name == Pose::KIND.type_name())?;
    let is_track = |t: &&Topic| t.type_name == Track::KIND.type_name() && t.frame == truth.frame;
    let tracks: Vec<&str> = topics.iter().filter(is_track).map(|t| t.name.as_str()).collect();
    let last = last_of(&tracks, &Wiring::of(session));
    let mut true_at: BTreeMap<u64, Place> = BTreeMap::new();
    let mut tracked: BTreeMap<&str, Vec<(u64, Place)>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.name == truth.name || last.contains(&t.name.as_str())) {
        let recorded = recorded.ok()?;
        let name = topics[recorded.topic].name.as_str();
        if name == truth.name {
            let view = Pieces::split(Pose::KIND, &recorded.sample).ok()?.view::<Pose>().ok()?;
            true_at.insert(view.header.origin, Place::of_pose(view.first()?));
        } else {
            let view = Pieces::split(Track::KIND, &recorded.sample).ok()?.view::<Track>().ok()?;
            let track = view.first()?;
            if track.standing() != Standing::None {
                tracked.entry(name).or_default().push((view.header.origin, Place::of_track(track)));
            }
        }
    }
    last.into_iter().find_map(|name| {
        let places = tracked.get(name)?;
        let pairs: Vec<_> = places.iter().filter_map(|(t, p)| Some((*true_at.get(t)?, *p))).collect();
        of_pairs(name.to_owned(), &pairs)
    })
}

/// Those of the tracks that no operator makes another of.
fn last_of<'a>(tracks: &[&'a str], wiring: &Wiring) -> Vec<&'a str> {
    let makes_another =
        |stage: &Stage, of: &str| stage.outputs.iter().any(|o| o != of && tracks.contains(&o.as_str()));
    let is_last = |name: &&&str| !wiring.consumers(name).any(|stage| makes_another(stage, name));
    tracks.iter().filter(is_last).copied().collect()
}

/// Compares pairs of truth and estimate; `None` where there are none.
fn of_pairs(topic: String, pairs: &[(Place, Place)]) -> Option<Accuracy> {
    let first = pairs.first()?.0;
    let n = pairs.len() as f64;
    let turned = pairs.iter().all(|(_, estimate)| estimate.is_turned());
    let compared = if turned { about_offset(pairs) } else { Vec::new() };
    let errors = if turned {
        compared.iter().map(|(truth, e)| e.translation.vector - truth.translation.vector).collect()
    } else {
        errors_about_mean(pairs)
    };
    // An axis that the track does not follow has no error.
    let known = errors.iter().map(|e| e.map(|c| if c.is_nan() { 0.0 } else { c }));
    let worst = known.map(|e| e.norm()).fold(0.0, f64::max);
    let moved = pairs.iter().map(|(truth, _)| (truth.position - first.position).norm()).fold(0.0, f64::max);
    let rms = |axis: usize| (errors.iter().map(|e| e[axis] * e[axis]).sum::<f64>() / n).sqrt() * 1e3;
    Some(Accuracy {
        topic,
        samples: pairs.len(),
        rms_mm: [0, 1, 2].map(|axis| Some(rms(axis)).filter(|rms| rms.is_finite())),
        worst_mm: worst * 1e3,
        moved_mm: moved * 1e3,
        turns: turns(&compared),
    })
}

/// Errors of the position, m, each of truth and estimate about its own mean.
fn errors_about_mean(pairs: &[(Place, Place)]) -> Vec<Vector3<f64>> {
    let differences: Vec<_> =
        pairs.iter().map(|(truth, estimate)| estimate.position - truth.position).collect();
    let mean = differences.iter().sum::<Vector3<f64>>() / differences.len() as f64;
    differences.iter().map(|difference| difference - mean).collect()
}

/// The estimates with the mean rigid offset put behind them, beside their truths.
fn about_offset(pairs: &[(Place, Place)]) -> Vec<(Isometry3<f64>, Isometry3<f64>)> {
    let poses: Vec<_> = pairs.iter().map(|(truth, estimate)| (truth.pose(), estimate.pose())).collect();
    let offset = mean_offset(&poses).unwrap_or_default();
    poses.into_iter().map(|(truth, estimate)| (truth, estimate * offset)).collect()
}

/// Errors of the rotation, with one constant rotation between the axes of the two taken out.
fn turns(compared: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<Turns> {
    let first = compared.first()?.0.rotation;
    let errors: Vec<Vector3<f64>> =
        compared.iter().map(|(truth, e)| (e.rotation * truth.rotation.inverse()).scaled_axis()).collect();
    let n = compared.len() as f64;
    let rms = |axis: usize| (errors.iter().map(|e| e[axis] * e[axis]).sum::<f64>() / n).sqrt().to_degrees();
    let most = |angles: &mut dyn Iterator<Item = f64>| angles.fold(0.0, f64::max).to_degrees();
    Some(Turns {
        rms_deg: [0, 1, 2].map(rms),
        worst_deg: most(&mut errors.iter().map(|e| e.norm())),
        turned_deg: most(&mut compared.iter().map(|(truth, _)| truth.rotation.angle_to(&first))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A head that nods about a point 0.1 m below the one that is compared, 0.1 rad at most.
    fn nods() -> Vec<Place> {
        (0..20)
            .map(|i| {
                let rotation =
                    UnitQuaternion::from_scaled_axis(Vector3::x() * 0.1 * (f64::from(i) * 0.7).sin());
                Place { position: rotation * Vector3::new(0.0, 0.0, 0.1), rotation }
            })
            .collect()
    }

    #[test]
    fn a_pose_of_another_place_on_the_head_is_exact() {
        let axes = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.2, 1.0));
        let elsewhere = |truth: &Place| Place {
            position: truth.position + truth.rotation * Vector3::new(0.02, 0.05, -0.03),
            rotation: truth.rotation * axes,
        };
        let pairs: Vec<_> = nods().iter().map(|truth| (*truth, elsewhere(truth))).collect();
        let found = of_pairs("it".into(), &pairs).unwrap();
        let turns = found.turns.unwrap();
        assert!(found.worst_mm < 1e-9 && turns.worst_deg < 1e-6, "{} {turns:?}", found.worst_mm);
        assert!(found.moved_mm > 9.0 && turns.turned_deg > 5.0, "{turns:?}");
        // By its position alone it is not.
        let position =
            |place: Place| Place { rotation: Place::new([0.0; 3], [f64::NAN; 4]).rotation, ..place };
        let pairs: Vec<_> = pairs.into_iter().map(|(truth, e)| (truth, position(e))).collect();
        let found = of_pairs("it".into(), &pairs).unwrap();
        assert!(found.worst_mm > 1.0 && found.turns.is_none());
    }

    #[test]
    fn small_errors_keep_three_digits() {
        let told = [0.0, 0.004_321, 0.3, 12.345, 1234.5].map(three);
        assert_eq!(told, ["0.00", "0.00432", "0.300", "12.3", "1234"]);
    }

    #[test]
    fn errors_are_told_per_axis() {
        let still = Place { position: Vector3::zeros(), rotation: UnitQuaternion::identity() };
        let off = |i: i32| if i % 2 == 0 { 1e-3 } else { -1e-3 };
        let moved = |i| Place {
            position: Vector3::new(f64::NAN, off(i), 0.0),
            rotation: Place::new([0.0; 3], [f64::NAN; 4]).rotation,
        };
        let found = of_pairs("it".into(), &(0..10).map(|i| (still, moved(i))).collect::<Vec<_>>()).unwrap();
        assert_eq!(found.rms_mm[0], None);
        assert!((found.rms_mm[1].unwrap() - 1.0).abs() < 1e-9 && found.rms_mm[2].unwrap().abs() < 1e-9);
        let turned = |i| Place { rotation: UnitQuaternion::from_scaled_axis(Vector3::z() * off(i)), ..still };
        let found = of_pairs("it".into(), &(0..10).map(|i| (still, turned(i))).collect::<Vec<_>>()).unwrap();
        assert!((found.turns.unwrap().rms_deg[2] - 1e-3_f64.to_degrees()).abs() < 1e-9);
        assert!(of_pairs("it".into(), &[]).is_none());
    }
}
