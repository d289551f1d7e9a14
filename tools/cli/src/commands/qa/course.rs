//! The moves of the phantom of daily QA: first a motion that proves the reference, then ramps of constant speed from where
//! the beam is on, then steps.

use stillpoint_rig::phantom::PhantomMove;

const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000_000_000;

/// When the phantom first moves: after the capture, and after the target has measured where the phantom is.
const FIRST: u64 = 2_500 * MS;
/// Moves to and fro that prove the reference, and how long each takes.
const PROVING: usize = 16;
const PROVING_MOVE: u64 = 250 * MS;
/// How far they go along x, y and z, m: within the tolerance of the gate, above the noise of a camera.
const PROVING_SHIFT: [f64; 3] = [4e-4, 3e-4, 5e-4];
/// Rest before each ramp: the beam comes back within it.
const BEFORE_RAMP: u64 = 2_500 * MS;
/// Rest at the end of a ramp, and speed of the return, m/s: the head is away from its target for a small part of the time
/// only, so that the valves do not take it for one that does not answer.
const AFTER_RAMP: u64 = 100 * MS;
const RETURN: f64 = 20e-3;
/// Time of a step, and of the rest before and after it.
const STEP: u64 = SECOND;
const STEP_REST: u64 = 2_500 * MS;

/// What the course needs to know of the gate and the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CourseParams {
    /// The channel of the ramps, x, y or z: 0 to 2.
    pub axis: usize,
    /// Tolerance of the gate, m.
    pub tolerance: f64,
    /// Where the beam is to be off at last, m.
    pub limit: f64,
    /// Period of the camera's frames, ns.
    pub frame: u64,
    /// Number of ramps at each speed and in each direction.
    pub repeats: usize,
}

/// Speeds of the ramps, m/s.
pub const SPEEDS: [f64; 4] = [2e-3, 5e-3, 10e-3, 20e-3];

/// The steps: shifts, m, and turns, rad, from rest; there and back.
fn steps() -> Vec<([f64; 3], [f64; 3])> {
    let still = [0.0; 3];
    let along = |axis: usize, size: f64| {
        let mut to = still;
        to[axis] = size;
        to
    };
    let mut all: Vec<_> = [2e-3, 5e-3, 10e-3, -5e-3].map(|z| (along(2, z), still)).to_vec();
    all.extend([0, 1].map(|axis| (along(axis, 5e-3), still)));
    all.extend([0, 1, 2].map(|axis| (still, along(axis, 2f64.to_radians()))));
    all
}

/// The moves of the phantom.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    pub moves: Vec<PhantomMove>,
    /// Number of ramps.
    pub ramps: usize,
    /// Length of the run, ns.
    pub length: u64,
}

impl Course {
    /// The moves for a gate and a camera.
    pub fn new(params: &CourseParams) -> Self {
        let mut course = Self { moves: Vec::new(), ramps: 0, length: 0 };
        course.length = FIRST;
        for k in 0..PROVING {
            let part = [1.0, 0.0, -1.0, 0.0][k % 4];
            course.go(PROVING_MOVE, PROVING_SHIFT.map(|s| s * part), [0.0; 3]);
        }
        // At each speed the tolerance is passed at other parts of a frame period, which are evenly spread.
        let all = 2 * params.repeats;
        for repeat in 0..params.repeats {
            for speed in SPEEDS {
                for (number, direction) in [(2 * repeat, 1.0), (2 * repeat + 1, -1.0)] {
                    course.ramp(params, speed * direction, (number as f64 + 0.5) / all as f64);
                }
            }
        }
        course.rest(BEFORE_RAMP);
        for (shift, turn) in steps() {
            course.go(STEP, shift, turn);
            course.rest(STEP_REST);
            course.go(STEP, [0.0; 3], [0.0; 3]);
            course.rest(STEP_REST);
        }
        course
    }

    /// A ramp with this speed, m/s, that passes the tolerance at this part of a frame period.
    fn ramp(&mut self, params: &CourseParams, speed: f64, part: f64) {
        self.rest(BEFORE_RAMP);
        let frame = params.frame.max(1);
        let passes = self.length + (params.tolerance / speed.abs() * 1e9) as u64;
        let at_part = (part * frame as f64) as u64;
        self.rest(((at_part + frame - passes % frame) % frame) / MS * MS);
        // Longer than a gate may take: a ramp that ends before the beam is off measures nothing.
        let slowest = 1.5 * frame as f64 * 1e-9 + 0.07;
        let over = ((params.limit / speed.abs() + slowest) * 1e3).ceil() as u64 * MS;
        let distance = speed * over as f64 * 1e-9;
        let mut to = [0.0; 3];
        to[params.axis] = distance;
        self.go(over, to, [0.0; 3]);
        self.rest(AFTER_RAMP);
        self.go((distance.abs() / RETURN * 1e3).ceil() as u64 * MS, [0.0; 3], [0.0; 3]);
        self.ramps += 1;
    }

    fn go(&mut self, over: u64, shift: [f64; 3], turn: [f64; 3]) {
        self.moves.push(PhantomMove { at: self.length, over, shift, turn });
        self.length += over;
    }

    fn rest(&mut self, time: u64) {
        self.length += time;
    }

    /// The moves as the value of `phantom` of a rig.
    pub fn yaml(&self) -> String {
        let triple = |numbers: [f64; 3], scale: f64, unit: &str| {
            numbers.map(|n| format!("{:.6} {unit}", n * scale)).join(", ")
        };
        let text = |m: &PhantomMove| {
            format!(
                "{{ at: {} ms, over: {} ms, shift: [{}], turn: [{}] }}",
                m.at / MS,
                m.over / MS,
                triple(m.shift, 1e3, "mm"),
                triple(m.turn, 1f64.to_degrees(), "deg")
            )
        };
        format!("[{}]", self.moves.iter().map(text).collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_rig::phantom::Phantom;

    #[test]
    fn every_course_is_one_that_a_phantom_can_make_and_each_ramp_has_its_speed() {
        for (axis, frame, repeats) in [(2, 100, 1), (0, 33, 3)] {
            let params = CourseParams { axis, tolerance: 1e-3, limit: 1.5e-3, frame: frame * MS, repeats };
            let course = Course::new(&params);
            assert_eq!(course.ramps, 8 * repeats);
            let phantom = Phantom::new(course.moves.clone()).unwrap();
            let ramps: Vec<_> = course.moves[PROVING..].iter().step_by(2).take(course.ramps).collect();
            for (k, ramp) in ramps.iter().enumerate() {
                let [from, to] = [ramp.at, ramp.at + ramp.over].map(|t| phantom.offset(t)[axis]);
                let speed = (to - from).abs() / (ramp.over as f64 * 1e-9);
                assert!((speed - SPEEDS[k / 2 % 4]).abs() < 1e-9, "{k}: {speed}");
                // Evenly spread over the period of the frames.
                let passes = ramp.at as f64 + params.tolerance / speed * 1e9;
                let part = (passes / params.frame as f64).fract();
                let due = ((2 * (k / 8) + k % 2) as f64 + 0.5) / (2 * repeats) as f64;
                assert!((part - due).abs() < 0.05, "{k}: {part} {due}");
                assert!(from == 0.0 && to.abs() > params.limit && (to > 0.0) == (k % 2 == 0), "{k}: {to}");
            }
            assert_eq!(phantom.offset(course.length), [0.0; 6]);
        }
    }
}
