//! From traces to figures: errors of the pose at rest, and the displacement at beam off against the speed, whose slope is
//! the time from motion to beam off (Naylor et al., Phys. Med. 2025, 105181).

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, Vector4};
use serde::Serialize;
use stillpoint_pose::PoseNumbers;

use super::readings::Readings;

/// Poses over time, in the order of their times, ns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace(Vec<(u64, Isometry3<f64>)>);

impl Trace {
    /// Adds a pose, if there is one and it is newer than the last.
    pub fn extend(&mut self, time: u64, pose: Option<Isometry3<f64>>) {
        if self.0.last().is_none_or(|(last, _)| *last < time) {
            self.0.extend(pose.map(|pose| (time, pose)));
        }
    }

    /// Whether it has no pose.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The pose at a time, between its neighbours; `None` outside of the trace.
    pub fn at(&self, time: u64) -> Option<Isometry3<f64>> {
        let next = self.0.partition_point(|(t, _)| *t < time);
        let (after, to) = self.0.get(next)?;
        if *after == time {
            return Some(*to);
        }
        let (before, from) = self.0.get(next.checked_sub(1)?)?;
        let part = (time - before) as f64 / (after - before) as f64;
        from.try_lerp_slerp(to, part, 1e-12)
    }

    /// The median time from one pose to the next, ns.
    fn interval(&self) -> u64 {
        let mut gaps: Vec<u64> = self.0.windows(2).map(|w| w[1].0 - w[0].0).collect();
        gaps.sort_unstable();
        gaps.get(gaps.len() / 2).copied().unwrap_or(0)
    }

    /// The mean pose within a time, and how many poses that were.
    fn mean(&self, rest: &Rest) -> Option<(Isometry3<f64>, usize)> {
        let within: Vec<_> = self.0.iter().filter(|(t, _)| (rest.from..=rest.until).contains(t)).collect();
        let (_, first) = within.first()?;
        let (mut place, mut turn) = (Vector3::zeros(), Vector4::zeros());
        for (_, pose) in &within {
            place += pose.translation.vector;
            let coords = pose.rotation.coords;
            turn += if coords.dot(&first.rotation.coords) < 0.0 { -coords } else { coords };
        }
        let rotation = UnitQuaternion::new_normalize(nalgebra::Quaternion::from(turn));
        Some((Isometry3::from_parts(Translation3::from(place / within.len() as f64), rotation), within.len()))
    }

    /// The times in which nothing moves by more than `tolerance` (m and rad) from their first pose, at least `length` ns
    /// long, without `settling` at their beginnings.
    fn rests(&self, tolerance: f64, length: u64, settling: u64) -> Vec<Rest> {
        let mut rests = Vec::new();
        let mut start = 0;
        for i in 0..=self.0.len() {
            let moves = self.0.get(i).is_none_or(|(_, pose)| {
                let first = &self.0[start].1;
                (pose.translation.vector - first.translation.vector).norm() > tolerance
                    || pose.rotation.angle_to(&first.rotation) > tolerance
            });
            if !moves {
                continue;
            }
            if let (Some((from, _)), Some((until, _))) = (self.0.get(start), self.0.get(i.saturating_sub(1)))
                && until.saturating_sub(*from) >= length
            {
                rests.push(Rest { from: from + settling, until: *until });
            }
            start = i;
        }
        rests
    }
}

/// A time in which the phantom rests, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Rest {
    from: u64,
    until: u64,
}

/// The phantom at rest: how far it is from the reference, and how far the pose is from that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Step {
    /// Beginning of the time that is judged, s from the capture.
    pub at_s: f64,
    /// x, y, z, m, and pitch, roll, yaw, rad, from the reference.
    pub known: [f64; 6],
    /// The same of pose minus phantom.
    pub error: [f64; 6],
    /// Poses in the mean.
    pub poses: usize,
}

impl Step {
    /// Length of the error of the position, m.
    pub fn distance(&self) -> f64 {
        Vector3::from_row_slice(&self.error[..3]).norm()
    }

    /// Largest error of an angle, rad.
    pub fn angle(&self) -> f64 {
        self.error[3..].iter().fold(0.0, |most, e| most.max(e.abs()))
    }

    /// Whether the phantom is where the reference was taken, to a micrometre or microradian.
    pub fn is_reference(&self) -> bool {
        self.known.iter().all(|k| k.abs() < 1e-6)
    }
}

/// A beam that ended while the phantom moved at constant speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ramp {
    /// Time of beam off, s from the capture.
    pub at_s: f64,
    /// Axis along which it moved: 0 to 2 for x, y, z.
    pub axis: usize,
    /// m/s, with the direction.
    pub speed: f64,
    /// Distance from the reference at beam off, m.
    pub displacement: f64,
}

/// A straight line through points, with its 95 % confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Line {
    pub slope: f64,
    /// Half of the confidence interval of the slope.
    pub slope_half: f64,
    pub intercept: f64,
    /// Half of the confidence interval of the intercept.
    pub intercept_half: f64,
}

/// The limits of the gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateLimits {
    /// Tolerance and permitted standard deviation together, m.
    pub position: f64,
    /// The same of angles, rad.
    pub angle: f64,
}

/// All figures of a session.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    pub steps: Vec<Step>,
    pub ramps: Vec<Ramp>,
    /// Displacement, m, against speed, m/s: the slope is a time, s.
    pub line: Option<Line>,
    /// Times for which the phantom was beyond the limits of the gate with the beam on, s.
    pub beyond_s: Vec<f64>,
}

/// Why there are no figures.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FiguresError {
    #[error("the session has no capture of a reference: send `console.capture` while the phantom is still")]
    Capture,
    #[error("the session has no measured pose: see `head.report` for the reason")]
    Pose,
    #[error(
        "the phantom never rested for {0} s after the capture: leave it still after the capture and after each step"
    )]
    Rest(f64),
}

/// Shortest rest that is judged, and the part at its beginning in which a filter settles, ns.
const REST: u64 = 1_000_000_000;
const SETTLING: u64 = 500_000_000;
/// Motion of a phantom at rest: of a rig, whose pose is exact, and as a camera sees it, m and rad.
const EXACT: f64 = 1e-7;
const SEEN: f64 = 5e-4;
/// Least speed of a ramp, m/s, and greatest deviation from a constant one.
const SLOW: f64 = 5e-4;
const UNEVEN: f64 = 0.15;
/// Turn above which a ramp is none along an axis, rad.
const TURNED: f64 = 2e-3;

/// The figures of a session. Without a rig the poses of the tracker take the place of the known motion for the ramps;
/// steps then need the known poses `declared`, one for each rest: shifts, m, and turns, rad.
pub fn evaluate(
    readings: &Readings,
    limits: &GateLimits,
    declared: Option<&[[f64; 6]]>,
) -> Result<Figures, FiguresError> {
    let captured = readings.captured.ok_or(FiguresError::Capture)?;
    let since = |trace: &Trace| Trace(trace.0.iter().filter(|(t, _)| *t > captured).copied().collect());
    let track = since(&readings.track);
    if track.is_empty() {
        return Err(FiguresError::Pose);
    }
    let truth = since(&readings.truth);
    let rests = match truth.is_empty() {
        false => truth.rests(EXACT, REST, SETTLING),
        true => track.rests(SEEN, REST, SETTLING),
    };
    let (first, reference) = rests
        .iter()
        .find_map(|rest| Some((rest, track.mean(rest)?.0)))
        .ok_or(FiguresError::Rest(REST as f64 * 1e-9))?;
    // The known motion carries the pose of the reference along.
    let known = match truth.at(first.until) {
        Some(at_reference) => {
            let back = at_reference.inverse();
            Trace(truth.0.iter().map(|(t, pose)| (*t, pose * back * reference)).collect())
        }
        None => track.clone(),
    };
    let seconds = |time: u64| (time.saturating_sub(captured)) as f64 * 1e-9;
    let steps = rests.iter().enumerate().filter_map(|(number, rest)| {
        let (seen, poses) = track.mean(rest)?;
        let is_at = match (truth.is_empty(), declared) {
            (false, _) => known.at(rest.until)?,
            (true, Some(declared)) => moved(&reference, declared.get(number)?),
            (true, None) => return None,
        };
        Some(Step {
            at_s: seconds(rest.from),
            known: between(&reference, &is_at),
            error: between(&is_at, &seen),
            poses,
        })
    });
    let ramps: Vec<Ramp> = offs(&readings.beam)
        .filter_map(|off| ramp(off, &known, &reference, &readings.held, seconds(off)))
        .collect();
    let points: Vec<(f64, f64)> = ramps.iter().map(|r| (r.speed.abs(), r.displacement)).collect();
    Ok(Figures {
        steps: steps.collect(),
        line: line(&points),
        ramps,
        beyond_s: beyond(&readings.beam, &known, &reference, limits, &readings.held),
    })
}

/// Times at which the beam went off, ns.
fn offs(beam: &[(u64, bool)]) -> impl Iterator<Item = u64> {
    beam.windows(2).filter(|pair| pair[0].1 && !pair[1].1).map(|pair| pair[1].0)
}

/// Shift, m, and pitch, roll and yaw, rad, from one pose to another, along and about the axes of their frame.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>) -> [f64; 6] {
    let turn = Isometry3::from_parts(Translation3::identity(), to.rotation * from.rotation.inverse());
    let PoseNumbers { pitch, roll, yaw, .. } = PoseNumbers::of(&turn);
    let shift = to.translation.vector - from.translation.vector;
    [shift.x, shift.y, shift.z, pitch, roll, yaw]
}

/// A pose after a known shift and turn.
fn moved(from: &Isometry3<f64>, by: &[f64; 6]) -> Isometry3<f64> {
    let [x, y, z, pitch, roll, yaw] = *by;
    let shift = PoseNumbers { position: [x, y, z], pitch, roll, yaw }.pose();
    let place = from.translation.vector + shift.translation.vector;
    Isometry3::from_parts(Translation3::from(place), shift.rotation * from.rotation)
}

/// The ramp that a beam ended in, if the phantom moved at constant speed from the reference along an axis that the target
/// holds.
fn ramp(off: u64, known: &Trace, reference: &Isometry3<f64>, held: &[bool; 6], at_s: f64) -> Option<Ramp> {
    // Next to each other, and far enough apart for the numbers of a fast clock.
    let apart = known.interval().max(5_000_000);
    let displacement = |time: u64| Some(known.at(time)?.translation.vector - reference.translation.vector);
    if known.at(off)?.rotation.angle_to(&reference.rotation) > TURNED {
        return None;
    }
    let (before, at) = (displacement(off.checked_sub(apart)?)?, displacement(off)?);
    let velocity = (at - before) / (apart as f64 * 1e-9);
    let axis = velocity.iamax();
    let (speed, distance) = (velocity[axis], at[axis]);
    if !held[axis] || speed.abs() < SLOW || distance * speed <= 0.0 {
        return None;
    }
    // Straight through the reference, and at the same speed half of the distance before.
    let aside = (at - Vector3::ith(axis, distance)).norm();
    let half = (0.5 * distance / speed * 1e9) as u64;
    let middle = displacement(off.checked_sub(half)?)?[axis];
    let is_even =
        (middle - 0.5 * distance).abs() < UNEVEN * distance.abs() && aside < UNEVEN * distance.abs();
    is_even.then_some(Ramp { at_s, axis, speed, displacement: distance.abs() })
}

/// Times for which the phantom was beyond the limits in a held channel while the beam was on, s.
fn beyond(
    beam: &[(u64, bool)],
    known: &Trace,
    reference: &Isometry3<f64>,
    limits: &GateLimits,
    held: &[bool; 6],
) -> Vec<f64> {
    let is_beyond = |time: u64| {
        known.at(time).is_some_and(|pose| {
            let channels = between(reference, &pose).into_iter().zip(held).enumerate();
            let mut judged = channels.filter(|(_, (_, held))| **held);
            judged.any(|(i, (error, _))| error.abs() > if i < 3 { limits.position } else { limits.angle })
        })
    };
    let mut times = Vec::new();
    let mut since = None;
    for (time, is_on) in beam {
        match (since, *is_on && is_beyond(*time)) {
            (None, true) => since = Some(*time),
            (Some(start), false) => {
                times.push((time - start) as f64 * 1e-9);
                since = None;
            }
            _ => {}
        }
    }
    if let (Some(start), Some((last, _))) = (since, beam.last()) {
        times.push((last - start) as f64 * 1e-9);
    }
    times
}

/// The line of least squares through points of positive x, with weights 1 / x^2: the scatter of the displacement grows with
/// the speed, because a camera's frames scatter in time. `None` for less than four points, or points of one x.
pub fn line(points: &[(f64, f64)]) -> Option<Line> {
    // Divided by x: y / x = slope + intercept / x, with a scatter that is the same everywhere.
    let n = points.len() as f64;
    if points.len() < 4 || points.iter().any(|(x, _)| *x <= 0.0) {
        return None;
    }
    let divided = || points.iter().map(|(x, y)| (1.0 / x, y / x));
    let (mu, mv) = (divided().map(|p| p.0).sum::<f64>() / n, divided().map(|p| p.1).sum::<f64>() / n);
    let suu: f64 = divided().map(|(u, _)| (u - mu).powi(2)).sum();
    if suu <= 1e-12 * mu * mu {
        return None;
    }
    let intercept = divided().map(|(u, v)| (u - mu) * (v - mv)).sum::<f64>() / suu;
    let slope = mv - intercept * mu;
    let squares: f64 = divided().map(|(u, v)| (v - slope - intercept * u).powi(2)).sum();
    let variance = squares / (n - 2.0);
    let t = student(points.len() - 2);
    Some(Line {
        slope,
        slope_half: t * (variance * (1.0 / n + mu * mu / suu)).sqrt(),
        intercept,
        intercept_half: t * (variance / suu).sqrt(),
    })
}

/// The quantile of Student's distribution that leaves out 5 % on both sides together.
fn student(freedoms: usize) -> f64 {
    const TABLE: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    let n = freedoms as f64;
    // The expansion of Fisher and Cornish in 1/n beyond the table.
    TABLE.get(freedoms.saturating_sub(1)).copied().unwrap_or(1.959_964 + 2.372_3 / n + 2.822 / (n * n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;
    const LIMITS: GateLimits = GateLimits { position: 1.5e-3, angle: 0.014 };

    fn at(z: f64) -> Isometry3<f64> {
        Isometry3::translation(0.01, -0.02, 0.1 + z)
    }

    /// A phantom that rests for 2 s and then rises and falls at these speeds, with a rest of 2 s before each ramp, seen with
    /// a constant offset and an error of scale. The beam goes off `latency` after the phantom passes 1 mm.
    fn readings(speeds: &[f64], latency: f64, scale: f64) -> Readings {
        let mut readings = Readings {
            captured: Some(0),
            held: [false, false, true, true, true, false],
            ..Readings::default()
        };
        let mut now = 0;
        let mut put = |z: f64, off: bool| {
            now += 5 * MS;
            readings.truth.extend(now, Some(at(z)));
            if now % (100 * MS) == 0 {
                readings.track.extend(now, Some(Isometry3::translation(0.03, 0.0, 0.02 + z * scale)));
            }
            readings.beam.push((now, !off));
        };
        (0..400).for_each(|_| put(0.0, false));
        for speed in speeds {
            (0..400).for_each(|_| put(0.0, false));
            for k in 1..=160 {
                let since = f64::from(k) * 5e-3;
                put(speed * since, since >= 1e-3 / speed.abs() + latency - 1e-9);
            }
            (0..400).for_each(|_| put(speed * 0.8, true));
            put(0.0, true);
        }
        readings
    }

    #[test]
    fn the_slope_is_the_latency_and_the_intercept_the_limit_of_the_gate() {
        let speeds = [5e-3, -5e-3, 10e-3, -10e-3, 20e-3, -20e-3];
        for latency in [0.0, 0.06, 0.15] {
            let figures = evaluate(&readings(&speeds, latency, 1.0), &LIMITS, None).unwrap();
            assert_eq!(figures.ramps.len(), speeds.len(), "{:?}", figures.ramps);
            let line = figures.line.unwrap();
            assert!((line.slope - latency).abs() < 1e-6 && (line.intercept - 1e-3).abs() < 1e-7, "{line:?}");
            let late = figures.beyond_s.iter().copied().fold(0.0, f64::max);
            // Of 20 mm/s the limits of 1.5 mm are passed 25 ms after the tolerance.
            assert!((late - (latency - 0.025).max(0.0)).abs() < 0.011, "{late}");
        }
    }

    #[test]
    fn a_scale_of_the_camera_is_an_error_of_the_steps_and_none_of_the_reference() {
        let figures = evaluate(&readings(&[12.5e-3], 0.05, 1.02), &LIMITS, None).unwrap();
        let (references, steps): (Vec<Step>, Vec<Step>) =
            figures.steps.iter().partition(|s| s.is_reference());
        assert!(!references.is_empty() && references.iter().all(|s| s.distance() < 1e-9), "{references:?}");
        // 10 mm by 2 %.
        assert!(steps.len() == 1 && (steps[0].distance() - 0.2e-3).abs() < 1e-6, "{steps:?}");
    }

    #[test]
    fn a_beam_that_stays_on_is_seen_although_no_ramp_is() {
        let figures = evaluate(&readings(&[10e-3, 20e-3], 10.0, 1.0), &LIMITS, None).unwrap();
        assert_eq!((figures.ramps.len(), figures.line), (0, None));
        assert!(figures.beyond_s.iter().any(|s| *s > 0.6), "{:?}", figures.beyond_s);
    }

    #[test]
    fn without_a_rig_declared_steps_take_its_place() {
        let mut seen = readings(&[12.5e-3], 0.05, 1.0);
        seen.truth = Trace::default();
        let declared = [[0.0; 6], [0.0, 0.0, 9.5e-3, 0.0, 0.0, 0.0], [0.0; 6]];
        let figures = evaluate(&seen, &LIMITS, Some(&declared)).unwrap();
        let step = figures.steps.iter().find(|s| !s.is_reference()).unwrap();
        assert!((step.error[2] - 0.5e-3).abs() < 1e-6, "{step:?}");
        assert!(evaluate(&seen, &LIMITS, None).unwrap().steps.is_empty());
    }

    #[test]
    fn a_session_without_capture_or_rest_says_so() {
        let mut none = readings(&[1e-2], 0.1, 1.0);
        none.captured = None;
        assert_eq!(evaluate(&none, &LIMITS, None), Err(FiguresError::Capture));
        none.captured = Some(u64::MAX);
        assert_eq!(evaluate(&none, &LIMITS, None), Err(FiguresError::Pose));
    }

    #[test]
    fn the_quantiles_are_those_of_the_tables() {
        for (freedoms, due) in [(1, 12.706), (10, 2.228), (14, 2.145), (30, 2.042), (1000, 1.962)] {
            assert!((student(freedoms) - due).abs() < 2e-3, "{freedoms}: {}", student(freedoms));
        }
    }

    proptest! {
        #[test]
        fn the_line_of_exact_points_is_theirs(slope in -1.0..1.0f64, intercept in -1.0..1.0f64) {
            let points: Vec<(f64, f64)> = (1..7).map(|x| (f64::from(x), intercept + slope * f64::from(x))).collect();
            let line = line(&points).unwrap();
            prop_assert!((line.slope - slope).abs() < 1e-9 && (line.intercept - intercept).abs() < 1e-9);
            prop_assert!(line.slope_half < 1e-9 && line.intercept_half < 1e-9);
        }
    }
}
