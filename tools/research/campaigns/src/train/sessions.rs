//! Data to train on from recorded sessions.

use std::path::Path;

use stillpoint_control::channels::{Channel, Channels};
use stillpoint_recorder::Session;
use stillpoint_samples::{Duties, DutiesElement, Pieces, SampleKind, Standing, Track, TrackElement};
use stillpoint_train::dataset::Sample;
use stillpoint_train::excite::SCALE;

use stillpoint::Failure;

/// Intervals of measurements that differ from the sample time by more than this part begin a new run.
const SAME: f64 = 0.2;

/// The runs of a session: stretches in which a pose was measured every `sample_time` seconds, each pose counted from the
/// first of its run, with the mean duties until the next.
pub fn runs(path: &Path, state: &str, duties: &str, sample_time: f64) -> Result<Vec<Vec<Sample>>, Failure> {
    let session = Session::open_any(path).map_err(Failure::failed)?;
    let channels = Channels::new(&[Channel::Z, Channel::Pitch, Channel::Roll]).map_err(Failure::failed)?;
    let mut poses: Vec<(u64, [f64; 3])> = Vec::new();
    each::<Track>(&session, state, |origin, _, track: &TrackElement| {
        if track.standing() == Standing::Measured
            && let Some([z, pitch, roll, ..]) = channels.of_track(track)
            && [z, pitch, roll].iter().all(|v| v.is_finite())
        {
            poses.push((origin, [z, pitch, roll]));
        }
    })?;
    let mut valves: Vec<(u64, DutiesElement)> = Vec::new();
    each::<Duties>(&session, duties, |_, stamp, element: &DutiesElement| valves.push((stamp, *element)))?;
    poses.sort_by_key(|(time, _)| *time);
    valves.sort_by_key(|(time, _)| *time);
    if let Some((_, wrong)) = valves.iter().find(|(_, d)| d.valves != 6) {
        return Err(Failure::wrong(format!(
            "{duties} of {} has {} valves: the network is for six",
            path.display(),
            wrong.valves
        )));
    }
    let mut runs: Vec<Vec<Sample>> = Vec::new();
    let mut start = None;
    for pair in poses.windows(2) {
        let ((time, pose), (next, _)) = (pair[0], pair[1]);
        let interval = next.saturating_sub(time) as f64 * 1e-9;
        let duty = mean(&valves, time, next);
        let (Some(duty), true) = (duty, (interval / sample_time - 1.0).abs() <= SAME) else {
            start = None;
            continue;
        };
        if start.is_none() {
            runs.push(Vec::new());
        }
        let from = *start.get_or_insert(pose);
        let counted = (0..3).map(|i| (pose[i] - from[i]) / SCALE[i]).collect();
        if let Some(run) = runs.last_mut() {
            run.push(Sample { pose: counted, duty: duty[..6].to_vec() });
        }
    }
    Ok(runs)
}

/// The mean duties from one time to another, each standing until the next; `None` before the first.
fn mean(valves: &[(u64, DutiesElement)], from: u64, to: u64) -> Option<[f64; 16]> {
    let first = valves.partition_point(|(time, _)| *time <= from).checked_sub(1)?;
    let mut sum = [0.0; 16];
    for (place, (time, duties)) in valves.iter().enumerate().skip(first).take_while(|(_, (t, _))| *t < to) {
        let end = valves.get(place + 1).map_or(to, |(next, _)| (*next).min(to));
        let part = end.saturating_sub((*time).max(from)) as f64 / (to - from) as f64;
        sum.iter_mut().zip(&duties.duty).for_each(|(sum, duty)| *sum += part * duty);
    }
    Some(sum)
}

/// Hears each sample of a topic with its origin and stamp.
fn each<S: stillpoint_samples::Sample<Body = ()>>(
    session: &Session,
    topic: &str,
    mut received: impl FnMut(u64, u64, &S::Element),
) -> Result<(), Failure> {
    let kind: &'static SampleKind = S::KIND;
    if !session.topics().iter().any(|t| t.name == topic) {
        let all: Vec<&str> = session.topics().iter().map(|t| t.name.as_str()).collect();
        return Err(Failure::wrong(format!("the session has no topic `{topic}`; it has {}", all.join(", "))));
    }
    for recorded in session.samples_where(|t| t.name == topic) {
        let recorded = recorded.map_err(Failure::failed)?;
        let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
        let view = pieces.view::<S>().map_err(|e| Failure::wrong(format!("{topic}: {e}")))?;
        if let Some(element) = view.first() {
            received(view.header.origin, view.header.stamp, element);
        }
    }
    Ok(())
}
