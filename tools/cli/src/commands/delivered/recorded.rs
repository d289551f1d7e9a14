//! Poses and beam-on time of a session.

use nalgebra::{Isometry3, Vector3};
use stillpoint_patient::case::{Case, PatientPosition};
use stillpoint_patient::couch::patient_from_couch;
use stillpoint_plan::delivery::{BeamTime, MotionAt, Stretch, beam_time};
use stillpoint_pose::checked_isometry;
use stillpoint_recorder::{Session, Topic};
use stillpoint_samples::{
    Actuation, ActuationState, FarEnd, Gate, Pieces, Pose, Sample, SampleKind, Standing, Track,
};

use super::reference::Reference;
use crate::exit::Failure;

/// A pose stands for at most this time before and behind it, ns.
const HOLD_NS: u64 = 250_000_000;
/// Largest part of the beam-on time without a pose.
const MOST_UNKNOWN: f64 = 0.05;

/// The motion of the patient, and when the beam was on.
pub struct Recorded {
    /// Motions at the isocentre, along the axes of the patient frame.
    pub motions: Vec<MotionAt>,
    /// Topic of the beam.
    pub beam: String,
    /// With the beam on.
    pub on: BeamTime,
    /// All time after arming.
    pub armed: BeamTime,
    /// Since when, in words.
    pub armed_since: String,
}

impl Recorded {
    /// Of a session.
    pub fn of(
        session: &Session,
        reference: &Reference,
        beam: Option<&str>,
        case: &Case,
    ) -> Result<Self, Failure> {
        let motions = motions(session, reference, case.position())?;
        let (Some(first), Some(last)) = (motions.first(), motions.last()) else {
            return Err(Failure::failed(format!("the session has no pose of {}", reference.poses)));
        };
        let topic = beam_topic(session, beam)?;
        let stretches = stretches(session, topic)?;
        let on = beam_time(&motions, &stretches, HOLD_NS);
        let all: u64 = stretches.iter().map(Stretch::length_ns).sum();
        if all == 0 {
            return Err(Failure::failed(format!(
                "the beam was never on at {}: no dose was delivered; `stillpoint report` tells the reasons of the gate",
                topic.name
            )));
        }
        if on.unknown_ns as f64 > MOST_UNKNOWN * all as f64 {
            return Err(Failure::failed(format!(
                "{:.3} s of {:.3} s with the beam on have no pose within {} ms: too much for a dose",
                on.unknown_ns as f64 * 1e-9,
                all as f64 * 1e-9,
                HOLD_NS / 1_000_000
            )));
        }
        let (from_ns, armed_since) = match armed_at(session)? {
            Some((time, topic)) => (time, format!("valves armed at {topic}")),
            None => (first.time_ns, "the first pose; the session records no state of valves".to_owned()),
        };
        let armed = beam_time(&motions, &[Stretch { from_ns, to_ns: last.time_ns }], HOLD_NS);
        if armed.of_motion_ns.iter().all(|ns| *ns == 0) {
            return Err(Failure::failed("the session has no pose after the valves were armed"));
        }
        Ok(Self { motions, beam: topic.name.clone(), on, armed, armed_since })
    }
}

/// The motions of the patient from the planned set-up, in the order of time.
fn motions(
    session: &Session,
    reference: &Reference,
    position: PatientPosition,
) -> Result<Vec<MotionAt>, Failure> {
    let Some(topic) = session.topics().iter().find(|t| t.name == reference.poses) else {
        return Err(Failure::failed(format!("the session does not record {}", reference.poses)));
    };
    if topic.frame.as_deref() != Some("couch") {
        return Err(Failure::wrong(format!(
            "the poses of {} are in the frame {}; poses in the frame `couch` are needed",
            topic.name,
            topic.frame.as_deref().unwrap_or("of none")
        )));
    }
    let patient_from_couch = patient_from_couch(position);
    let mut motions = Vec::new();
    let mut channels = None;
    each(session, topic, |pieces, kind| {
        let origin = pieces.header().origin;
        let pose = if *kind == *Track::KIND {
            let track = pieces.view::<Track>().map_err(Failure::failed)?.first().copied();
            let Some(track) = track.filter(|t| t.standing() != Standing::None) else { return Ok(()) };
            if track.channels != 0b11_1111 {
                channels = Some(track.channels);
            }
            checked_isometry(track.position, track.orientation).filter(|_| is_finite(&track.position))
        } else {
            let pose = pieces.view::<Pose>().map_err(Failure::failed)?.first().copied();
            let Some(pose) = pose else { return Ok(()) };
            checked_isometry(pose.position, pose.orientation).filter(|_| is_finite(&pose.position))
        };
        if let Some(pose) = pose {
            motions.push(motion(origin, &pose, reference, &patient_from_couch));
        }
        Ok(())
    })?;
    if let Some(channels) = channels {
        return Err(Failure::wrong(format!(
            "{} does not estimate all six numbers of a rigid motion (channels {channels:#b}): a filter of all six, or \
             --poses with the poses of the tracker, is needed",
            topic.name
        )));
    }
    motions.sort_by_key(|motion| motion.time_ns);
    // A filter predicts to times that a measurement may have, too.
    motions.dedup_by_key(|motion| motion.time_ns);
    Ok(motions)
}

fn is_finite(position: &[f64; 3]) -> bool {
    position.iter().all(|metres| metres.is_finite())
}

/// A pose as the motion of the patient's isocentre from the machine's, and the turn about it.
fn motion(
    time_ns: u64,
    pose: &Isometry3<f64>,
    reference: &Reference,
    patient_from_couch: &nalgebra::Matrix3<f64>,
) -> MotionAt {
    let isocentre = pose * reference.point_from_isocentre;
    let shift: Vector3<f64> = patient_from_couch * (isocentre.translation.vector - reference.isocentre) * 1e3;
    let turn: Vector3<f64> = patient_from_couch * isocentre.rotation.scaled_axis();
    MotionAt { time_ns, shift_mm: shift.into(), turn_rad: turn.into() }
}

fn beam_topic<'s>(session: &'s Session, requested: Option<&str>) -> Result<&'s Topic, Failure> {
    let of = |kind: &'static SampleKind| session.topics().iter().filter(move |t| is_of(t, kind));
    let mut both = of(FarEnd::KIND).chain(of(Gate::KIND));
    match requested {
        None => both.next().ok_or_else(|| {
            Failure::wrong(
                "the session records neither the state of a far end nor that of a gate; add `far.state` or `gate.state` \
                 to `record:`",
            )
        }),
        Some(name) => both.find(|t| t.name == name).ok_or_else(|| {
            Failure::wrong(format!("{name} is not a recorded state of a far end or of a gate of the session"))
        }),
    }
}

/// When the beam was on. A state holds until the next one.
fn stretches(session: &Session, topic: &Topic) -> Result<Vec<Stretch>, Failure> {
    let mut states: Vec<(u64, bool)> = Vec::new();
    each(session, topic, |pieces, kind| {
        let stamp = pieces.header().stamp;
        let is_on = if *kind == *FarEnd::KIND {
            pieces.view::<FarEnd>().map_err(Failure::failed)?.first().map(|far| far.beam == 1)
        } else {
            pieces.view::<Gate>().map_err(Failure::failed)?.first().map(|gate| gate.beam == 1)
        };
        states.extend(is_on.map(|is_on| (stamp, is_on)));
        Ok(())
    })?;
    states.sort_by_key(|(stamp, _)| *stamp);
    let mut found: Vec<Stretch> = Vec::new();
    for pair in states.windows(2) {
        let [(from_ns, is_on), (to_ns, _)] = [pair[0], pair[1]];
        match found.last_mut() {
            _ if !is_on => {}
            Some(last) if last.to_ns == from_ns => last.to_ns = to_ns,
            _ => found.push(Stretch { from_ns, to_ns }),
        }
    }
    Ok(found)
}

/// When valves were armed first, and the topic that says so. `None` where no state of valves is recorded.
fn armed_at(session: &Session) -> Result<Option<(u64, String)>, Failure> {
    let Some(topic) = session.topics().iter().find(|t| is_of(t, Actuation::KIND)) else { return Ok(None) };
    let mut armed: Option<u64> = None;
    each(session, topic, |pieces, _| {
        let state = pieces.view::<Actuation>().map_err(Failure::failed)?.first().map(|a| a.state());
        if state == Some(ActuationState::Armed) {
            let stamp = pieces.header().stamp;
            armed = Some(armed.map_or(stamp, |before| before.min(stamp)));
        }
        Ok(())
    })?;
    match armed {
        Some(time) => Ok(Some((time, topic.name.clone()))),
        None => Err(Failure::failed(format!("the valves were never armed at {}", topic.name))),
    }
}

fn is_of(topic: &Topic, kind: &'static SampleKind) -> bool {
    topic.kind.kind().is_some_and(|found| *found == *kind)
}

/// Calls `take` with every sample of a topic. A sample that cannot be read is an error: it would be missing in the dose.
fn each(
    session: &Session,
    topic: &Topic,
    mut take: impl FnMut(Pieces<'_>, &'static SampleKind) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let fault = |e: &dyn std::fmt::Display| Failure::failed(format!("{}: {e}", topic.name));
    let Some(kind) = topic.kind.kind() else { return Err(fault(&"this build does not know its type")) };
    for recorded in session.samples_where(|t| t.name == topic.name) {
        let recorded = recorded.map_err(|e| fault(&e))?;
        take(Pieces::split(kind, &recorded.sample).map_err(|e| fault(&e))?, kind)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn a_pose_of_another_point_of_the_head_is_the_motion_of_the_isocentre() {
        let reference = Reference {
            poses: "filter.state".into(),
            tracker: "head".into(),
            surface: "head.case".into(),
            is_case: Some(true),
            isocentre: Vector3::new(0.1, 0.2, 0.3),
            couch_deg: 0.0,
            // The point lies 50 mm towards the crown from the isocentre.
            point_from_isocentre: Translation3::new(0.0, 0.05, 0.0).inverse(),
        };
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.0, 0.0));
        let isocentre = Isometry3::from_parts(Translation3::new(0.1, 0.2, 0.302), turn);
        let pose = isocentre * Translation3::new(0.0, 0.05, 0.0);
        let found = motion(7, &pose, &reference, &patient_from_couch(PatientPosition::HeadFirstSupine));
        // Up is the front of the patient: -y. A right-handed turn stays one.
        for (found, due) in found.shift_mm.iter().zip([0.0, -2.0, 0.0]) {
            assert!((found - due).abs() < 1e-9, "{found} {due}");
        }
        for (found, due) in found.turn_rad.iter().zip([0.1, 0.0, 0.0]) {
            assert!((found - due).abs() < 1e-9, "{found} {due}");
        }
    }
}
