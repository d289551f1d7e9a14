//! Two `estimate.kalman` and `estimate.fuse` on benches: sensors that fail, and what is then said.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    Diagnostics, Health, Pose, PoseElement, SensorHealth, Standing, Track, TrackElement,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

use stillpoint_mechanics::random::Random;

const TEXT: &str = "
stillpoint: 1
name: fuse
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  a: { use: feed.pose, frame: couch }
  b: { use: feed.pose, frame: couch }
  first: { use: estimate.kalman, inputs: { measurement: a.out }, params: { follow: z, acceleration_sd: 100 mm/s2, acceleration_hold: 33 ms } }
  second: { use: estimate.kalman, inputs: { measurement: b.out }, params: { follow: z, acceleration_sd: 100 mm/s2, acceleration_hold: 33 ms } }
  fused:
    use: estimate.fuse
    every: 20 ms
    inputs: { first: first.state, second: second.state }
    params: { follow: z }
";

const MS: u64 = 1_000_000;
/// Standard deviations of the sensors, m.
const SD: [f64; 2] = [1.5e-3, 0.8e-3];

/// Two sensors, their filters and the fusion.
struct Rig {
    filters: [Bench; 2],
    fuse: Bench,
    random: Random,
    /// Standard deviation that the sensors claim, over theirs.
    scatter: f64,
    last: Option<Left>,
}

/// What a sensor does.
#[derive(Clone, Copy)]
struct Shot {
    /// Error of the time that it states, ns.
    clock: i64,
    value: f64,
}

impl Rig {
    fn new(text: &str) -> Self {
        let bench =
            |name| Bench::new(text, name, stillpoint_estimate::STAGES, &MemoryFiles::default()).unwrap();
        Self {
            filters: [bench("first"), bench("second")],
            fuse: bench("fused"),
            random: Random::new(4),
            scatter: 1.0,
            last: None,
        }
    }

    /// A measurement of a sensor at `time`; what the fusion then sends.
    fn measure(&mut self, side: usize, time: u64, shot: Shot) -> Option<TrackElement> {
        let mut covariance = [0.0; 36];
        let sd = self.scatter * SD[side];
        for i in 0..6 {
            covariance[7 * i] = if i == 2 { sd * sd } else { f64::INFINITY };
        }
        let pose = PoseElement {
            position: [f64::NAN, f64::NAN, shot.value],
            orientation: [1.0, 0.0, 0.0, 0.0],
            covariance,
        };
        // 5 ms from acquisition to the filter, as the sensor's clock has it.
        let age = 5 * MS as i64 - shot.clock;
        let left = self.filters[side].at(time + 5 * MS).feed::<Pose>(0, &(), &[pose], age);
        let (_, sent) = left.outputs.iter().find(|(port, _)| *port == 0)?;
        let view = sent.pieces().view::<Track>().unwrap();
        // 1 ms more to the fusion.
        let age = age + MS as i64;
        let left = self.fuse.at(time + 6 * MS).feed::<Track>(side, &(), view.elements, age);
        assert_eq!(left.fault, None);
        let track = sent_track(&left);
        self.last = Some(left);
        track
    }

    fn tick(&mut self, time: u64) -> Option<TrackElement> {
        let left = self.fuse.at(time).tick();
        assert_eq!(left.fault, None);
        let track = sent_track(&left);
        self.last = Some(left);
        track
    }

    fn reasons(&self) -> [String; 2] {
        let health = self.health();
        [0, 1].map(|i| health[i].reason().to_owned())
    }

    fn health(&self) -> Vec<SensorHealth> {
        let (_, sent) = self.last.as_ref().unwrap().outputs.iter().find(|(port, _)| *port == 1).unwrap();
        let health = sent.pieces().view::<Health>().unwrap().elements.to_vec();
        assert_eq!([health[0].name(), health[1].name()], ["first", "second"]);
        health
    }

    fn metric(&self, name: &str) -> f64 {
        let (_, sent) = self.last.as_ref().unwrap().outputs.iter().find(|(port, _)| *port == 2).unwrap();
        let view = sent.pieces().view::<Diagnostics>().unwrap();
        view.elements.iter().find(|m| m.name() == name).unwrap_or_else(|| panic!("no {name}")).value
    }
}

fn sent_track(left: &Left) -> Option<TrackElement> {
    let (_, sent) = left.outputs.iter().find(|(port, _)| *port == 0)?;
    Some(*sent.pieces().view::<Track>().unwrap().first().unwrap())
}

/// What was seen at a time: the fused track, the truth and the reasons.
struct Seen {
    time: u64,
    track: TrackElement,
    truth: f64,
    reasons: [String; 2],
}

impl Seen {
    fn error(&self) -> f64 {
        self.track.position[2] - self.truth
    }
}

/// Runs 30 and 15 Hz sensors over a head that `truth` (time in s to height in m) moves. `script` changes, or takes away,
/// what a sensor says at a time in ms.
fn run(
    text: &str,
    seconds: u64,
    truth: impl Fn(f64) -> f64,
    script: impl Fn(usize, u64, Shot) -> Option<Shot>,
) -> (Rig, Vec<Seen>) {
    let mut rig = Rig::new(text);
    let mut seen = Vec::new();
    for ms in 0..seconds * 1000 {
        let time = 1_000 * MS + ms * MS;
        let height = truth(ms as f64 * 1e-3);
        // Frames at odd milliseconds, ticks between them.
        let sent = match (ms % 33, ms % 66, ms % 22) {
            (1, _, _) => Some(0),
            (_, 20, _) => Some(1),
            (_, _, 10) => None,
            _ => continue,
        };
        let (track, truth) = match sent {
            Some(side) => {
                let shot = Shot { clock: 0, value: height + SD[side] * rig.random.normal() };
                let Some(shot) = script(side, ms, shot) else { continue };
                (rig.measure(side, time, shot), height)
            }
            None => (rig.tick(time), height),
        };
        if let Some(track) = track {
            seen.push(Seen { time: ms, track, truth, reasons: rig.reasons() });
        }
    }
    (rig, seen)
}

fn still(_: f64) -> f64 {
    0.15
}

/// Reasons of one sensor in the order in which they came.
fn course(seen: &[Seen], side: usize) -> Vec<&str> {
    let mut course: Vec<&str> = seen.iter().map(|s| s.reasons[side].as_str()).collect();
    course.dedup();
    course
}

#[test]
fn two_good_sensors_give_one_track_better_than_either() {
    let (rig, seen) = run(TEXT, 20, |t| 0.15 + 0.005 * libm::sin(t), |_, _, shot| Some(shot));
    assert_eq!(course(&seen, 0), ["waiting", "used"].split_at(usize::from(seen[0].reasons[0] == "used")).1);
    let late: Vec<&Seen> = seen.iter().filter(|s| s.time > 2000).collect();
    let rms = (late.iter().map(|s| s.error() * s.error()).sum::<f64>() / late.len() as f64).sqrt();
    let claimed = late.iter().map(|s| s.track.covariance[13 * 2]).sum::<f64>() / late.len() as f64;
    // The claim allows for accelerations of 100 mm/s2; the head has 5.
    assert!(rms < 0.6e-3 && rms < claimed.sqrt(), "{rms} m, claimed {} m", claimed.sqrt());
    let standings = [Standing::Measured, Standing::Predicted];
    assert!(late.iter().all(|s| s.track.channels == 0b100 && standings.contains(&s.track.standing())));
    assert!(rig.metric("weight_of_second") > 0.3 && rig.metric("sensors_used") == 2.0);
    assert!(late.iter().any(|s| s.track.standing() == Standing::Measured));
}

#[test]
fn states_come_in_the_order_of_their_times() {
    // The second sensor's frames arrive 60 ms late.
    let (rig, _) = run(TEXT, 2, still, |_, _, shot| Some(shot));
    drop(rig);
    let mut rig = Rig::new(TEXT);
    rig.measure(0, 1000 * MS, Shot { clock: 0, value: 0.15 }).unwrap();
    rig.measure(0, 1033 * MS, Shot { clock: 0, value: 0.1501 }).unwrap();
    let late = rig.measure(1, 1040 * MS, Shot { clock: -30 * MS as i64, value: 0.1502 });
    assert!(late.is_none(), "a track of the past sends nothing");
    assert!(rig.measure(0, 1066 * MS, Shot { clock: 0, value: 0.1499 }).is_some());
    assert_eq!(rig.metric("sensors_used"), 2.0);
}

#[test]
fn sensor_that_dies_is_named_and_comes_back() {
    let (_, seen) =
        run(TEXT, 6, still, |side, ms, shot| (side == 1 || !(2000..4000).contains(&ms)).then_some(shot));
    assert_eq!(course(&seen, 0).as_slice(), ["waiting", "used", "silent", "returning", "used"].split_at(1).1);
    assert!(seen.iter().all(|s| s.track.standing() != Standing::None && s.error().abs() < 4e-3));
    assert_eq!(course(&seen, 1).last(), Some(&"used"));
}

#[test]
fn both_gone_means_no_estimate_and_no_number() {
    let (rig, seen) = run(TEXT, 4, still, |_, ms, shot| (ms < 2000).then_some(shot));
    let after: Vec<&Seen> = seen.iter().filter(|s| s.time > 2000 + 66 + 206).collect();
    assert!(after.len() > 50);
    for s in after {
        assert_eq!(s.track.standing(), Standing::None);
        assert!(s.track.position.iter().chain(&s.track.velocity).all(|v| v.is_nan()));
        assert!(s.track.covariance[26].is_infinite());
    }
    assert_eq!(rig.reasons(), ["silent", "silent"]);
}

#[test]
fn frozen_sensor_is_named_and_not_used() {
    let (_, seen) = run(
        TEXT,
        6,
        |t| 0.15 + 0.01 * (t - 2.0).max(0.0),
        |side, ms, shot| Some(if side == 1 && ms > 2000 { Shot { value: 0.1507, ..shot } } else { shot }),
    );
    assert!(course(&seen, 1).contains(&"frozen"), "{:?}", course(&seen, 1));
    let after = seen.iter().filter(|s| s.time > 2400);
    assert!(after.clone().all(|s| s.reasons[1] == "frozen" && s.error().abs() < 4e-3));
}

/// A noiseless camera measures one height again and again while the rest of its image changes, and with it what the fit
/// leaves over. An image that comes again leaves the same over.
#[test]
fn equal_heights_of_different_images_are_no_frozen_sensor() {
    for (changes, expected) in [(true, "used"), (false, "frozen")] {
        let mut rig = Rig::new(TEXT);
        for frame in 0..40_u64 {
            rig.scatter = 1.0 + if changes { 1e-3 * (frame % 7) as f64 } else { 0.0 };
            let time = 1000 * MS + frame * 33 * MS;
            for side in 0..2 {
                rig.measure(side, time, Shot { clock: 0, value: 0.15 });
            }
        }
        assert_eq!(rig.reasons(), [expected, expected]);
    }
}

#[test]
fn sensor_that_jumps_is_named_and_the_track_stays_with_the_other() {
    for faulty in [0, 1] {
        let (_, seen) = run(TEXT, 8, still, |side, ms, shot| {
            let jumped = side == faulty && (2000..6000).contains(&ms);
            Some(if jumped { Shot { value: shot.value + 0.02, ..shot } } else { shot })
        });
        let course = course(&seen, faulty);
        // Its filter refuses it once, starts anew where it jumped to, and there it is elsewhere than the other.
        assert!(course.contains(&"disagrees"), "{course:?}");
        assert_eq!(course.last(), Some(&"used"), "{course:?}");
        assert!(seen.iter().all(|s| s.reasons[1 - faulty] != "disagrees" && s.error().abs() < 5e-3));
    }
}

#[test]
fn sensor_that_is_here_and_there_is_named_and_the_track_stays_with_the_other() {
    let (_, seen) = run(TEXT, 8, still, |side, ms, shot| {
        let off = if ms / 33 % 2 == 0 { 0.1 } else { -0.1 };
        let jumps = side == 0 && (2000..6000).contains(&ms);
        Some(if jumps { Shot { value: shot.value + off, ..shot } } else { shot })
    });
    let course = course(&seen, 0);
    assert!(course.contains(&"jumps"), "{course:?}");
    assert_eq!(course.last(), Some(&"used"), "{course:?}");
    assert!(seen.iter().all(|s| s.reasons[1] != "disagrees" && s.error().abs() < 5e-3));
}

#[test]
fn sensor_that_lies_more_and_more_never_draws_the_track_far_off() {
    for (liar, speed) in [(0, 0.005), (1, 0.005), (0, 0.03), (1, 0.03), (1, 0.002)] {
        let (_, seen) = run(TEXT, 12, still, |side, ms, shot| {
            let drift = speed * (ms.clamp(2000, 8000) - 2000) as f64 * 1e-3;
            let lies = side == liar && ms < 10_000;
            Some(if lies { Shot { value: shot.value + drift, ..shot } } else { shot })
        });
        let errors = seen.iter().filter(|s| s.track.standing() != Standing::None).map(|s| s.error().abs());
        let worst = errors.fold(0.0, f64::max);
        assert!(worst < 6e-3, "{liar} at {speed} m/s: {worst} m");
        let lied = seen.iter().rfind(|s| s.time < 10_000).unwrap();
        assert_eq!(lied.reasons[liar], "disagrees");
        // Either the other is trusted alone, or neither: then there is no estimate until they agree again.
        assert!(lied.track.standing() == Standing::None || lied.error().abs() < 4e-3);
        assert_eq!(seen.last().unwrap().reasons, ["used", "used"], "{liar} at {speed} m/s");
    }
}

#[test]
fn clock_that_jumps_is_named() {
    for shift in [-150, 300_000, -300_000] {
        let (_, seen) = run(TEXT, 6, still, |side, ms, shot| {
            let clock = if side == 0 && (2000..4000).contains(&ms) { shift * MS as i64 } else { 0 };
            Some(Shot { clock, ..shot })
        });
        let course = course(&seen, 0);
        assert!(
            course.contains(&"clock") || (shift < -1000 && course.contains(&"silent")),
            "{shift}: {course:?}"
        );
        assert!(seen.iter().all(|s| s.error().abs() < 4e-3 || s.track.standing() == Standing::None));
        assert_eq!(seen.last().unwrap().reasons, ["used", "used"], "{shift}: {course:?}");
    }
}

#[test]
fn clock_that_is_a_little_ahead_for_good_is_used_and_one_that_is_far_ahead_is_named() {
    // 6 ms pass from acquisition to the fusion: a stamp that is 9 ms late is 3 ms ahead there.
    for (clock, verdict) in [(7, "used"), (9, "used"), (12, "clock"), (30, "clock")] {
        let (rig, seen) = run(TEXT, 4, still, |side, _, shot| {
            Some(Shot { clock: if side == 1 { clock * MS as i64 } else { 0 }, ..shot })
        });
        let course = course(&seen, 1);
        assert_eq!(course.last(), Some(&verdict), "{clock} ms: {course:?}");
        assert!(course.iter().all(|reason| ["waiting", verdict].contains(reason)), "{clock} ms: {course:?}");
        assert_eq!(rig.metric("sensors_used"), if verdict == "used" { 2.0 } else { 1.0 });
        assert!(seen.iter().all(|s| s.error().abs() < 4e-3 || s.track.standing() == Standing::None));
    }
    let wide = TEXT.replace("params: { follow: z", "params: { clock_ahead: 40 ms, follow: z");
    let ahead = |_, _, shot| Some(Shot { clock: 30 * MS as i64, ..shot });
    let (rig, _) = run(&wide, 4, still, ahead);
    assert_eq!(rig.reasons(), ["used", "used"]);
}

#[test]
fn no_tick_sends_a_state_that_is_older_than_the_last_one() {
    let mut rig = Rig::new(TEXT);
    // Acquired at 1009 ms by the sensor's clock, and here at 1006 ms.
    assert!(rig.measure(0, 1000 * MS, Shot { clock: 9 * MS as i64, value: 0.15 }).is_some());
    assert!(rig.tick(1008 * MS).is_none());
    assert_eq!(rig.reasons(), ["used", "waiting"]);
    assert_eq!(rig.tick(1010 * MS).unwrap().standing(), Standing::Predicted);
}

#[test]
fn numbers_that_are_none_leave_a_sensor_out() {
    let (_, seen) = run(TEXT, 3, still, |side, ms, shot| {
        Some(if side == 0 && ms > 1000 { Shot { value: f64::NAN, ..shot } } else { shot })
    });
    let course = course(&seen, 0);
    assert!(course.contains(&"refused"), "{course:?}");
    assert!(seen.iter().all(|s| s.track.position[2].is_finite()));
}

#[test]
fn offset_of_the_clocks_is_found_from_the_motion() {
    let (rig, _) = run(
        TEXT,
        60,
        |t| 0.15 + 0.02 * libm::sin(2.0 * t),
        |side, _, shot| {
            // The second sensor's stamps are 30 ms late: what it shows is older than it says.
            Some(if side == 1 { Shot { clock: 3 * MS as i64, ..shot } } else { shot })
        },
    );
    let (offset, sd) = (rig.metric("clock_offset_s"), rig.metric("clock_offset_sd_s"));
    assert!((offset - 0.003).abs() < 0.002, "{offset} s, sd {sd} s");
}

#[test]
fn tracks_that_were_lost_are_made_up_for() {
    let mut rig = Rig::new(TEXT);
    let mut time = 1000 * MS;
    for k in 0..200_u64 {
        time += 33 * MS;
        let (a, b) = (rig.random.normal(), rig.random.normal());
        // Each third track of the first is lost between filter and fusion.
        if k % 3 == 2 {
            let fuse = std::mem::replace(
                &mut rig.fuse,
                Bench::new(TEXT, "fused", stillpoint_estimate::STAGES, &MemoryFiles::default()).unwrap(),
            );
            rig.measure(0, time, Shot { clock: 0, value: 0.15 + SD[0] * a });
            rig.fuse = fuse;
        } else {
            rig.measure(0, time, Shot { clock: 0, value: 0.15 + SD[0] * a });
        }
        rig.measure(1, time + 12 * MS, Shot { clock: 0, value: 0.15 + SD[1] * b });
    }
    assert_eq!(rig.metric("tracks_lost"), 66.0);
    assert_eq!(rig.reasons(), ["used", "used"]);
}

#[test]
fn tracks_of_other_channels_are_refused_with_what_to_do() {
    let text = TEXT.replace("params: { follow: z }", "params: { follow: position }");
    let mut rig = Rig::new(&text);
    let track = TrackElement { channels: 0b100, ..TrackElement::NONE };
    let left = rig.fuse.feed::<Track>(0, &(), &[track], 0);
    assert!(left.fault.unwrap().contains("the same `follow`"));
}

#[test]
fn every_method_follows_and_claims_in_its_way() {
    let claims = ["cross_covariance", "inverse_variance", "intersection"].map(|method| {
        let text =
            TEXT.replace("params: { follow: z }", &format!("params: {{ follow: z, method: {method} }}"));
        let (_, seen) = run(&text, 4, still, |_, _, shot| Some(shot));
        assert!(seen.iter().all(|s| s.error().abs() < 4e-3), "{method}");
        seen.last().unwrap().track.covariance[26]
    });
    assert!(claims[1] < claims[0] && claims[0] < claims[2], "{claims:?}");
}

#[test]
fn poses_are_fused_with_their_rotations() {
    let text = TEXT.replace("follow: z", "follow: pose");
    let mut rig = Rig::new(&text);
    let mut last = None;
    for k in 0..120_u64 {
        let time = 1000 * MS + k * 33 * MS;
        for (side, sd) in SD.into_iter().enumerate() {
            let mut covariance = [0.0; 36];
            (0..6).for_each(|i| covariance[7 * i] = sd * sd);
            let mut noise = || sd * rig.random.normal();
            let half = 0.5 * (0.4 + noise());
            let pose = PoseElement {
                position: [0.1 + noise(), 0.2 + noise(), 0.3 + noise()],
                orientation: [libm::cos(half), libm::sin(half), 0.0, 0.0],
                covariance,
            };
            let at = time + side as u64 * 12 * MS;
            let left = rig.filters[side].at(at).feed::<Pose>(0, &(), &[pose], 0);
            let track = sent_track(&left).unwrap();
            let left = rig.fuse.at(at + MS).feed::<Track>(side, &(), &[track], MS as i64);
            assert_eq!(left.fault, None);
            last = sent_track(&left).or(last);
            rig.last = Some(left);
        }
    }
    let track = last.unwrap();
    assert_eq!((track.channels, rig.reasons()), (0b11_1111, ["used", "used"].map(String::from)));
    let angle = 2.0 * libm::atan2(track.orientation[1], track.orientation[0]);
    assert!(
        (angle - 0.4).abs() < 2e-3 && (track.position[0] - 0.1).abs() < 2e-3,
        "{angle} {:?}",
        track.position
    );
    assert!((0..12).all(|i| track.covariance[13 * i] > 0.0));
}
