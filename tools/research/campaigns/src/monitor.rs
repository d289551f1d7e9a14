//! An independent monitor of a simulated run: the rules of beam and valves, checked against the truth of the rig.
//!
//! The monitor shares no code with the gate, the valves or the far end. It sees the true pose, the acquisition times of the
//! measurements, the state of actuation, and what the far end does.

use stillpoint_samples::{ActuationElement, ActuationState, FarEndDoing, FarEndElement};

/// Tolerance of the gate plus the standard deviation that it permits: mm, degrees, degrees.
pub const ASTRAY: [f64; 3] = [1.5, 0.8, 0.8];
/// Maximum pressure of a bladder, Pa.
pub const PRESSURE: f64 = 40e3;
/// Time within which the beam is off after the true pose left the tolerance, or after the last measurement: 1.5 frame
/// periods of 100 ms and 20 ms, ns (docs/guide/gate.md, "Time to beam off").
const POSE_TIME: u64 = 170_000_000;
/// Time within which the beam is off after actuation stopped following: `lead`, ns.
const LEAD: u64 = 40_000_000;
/// Maximum growth of an opening, 1/s: `slew`.
const SLEW: f64 = 10.0;
const DUTY: f64 = 1.0;
/// Rounding of duties that are sent as `f32`.
const ROUNDING: f64 = 1e-5;

/// A rule that a run can break.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// The beam was on while actuation was disarmed, at fault, holding or venting, for longer than [`LEAD`].
    BeamUnarmed,
    /// The beam was on while the far end vented.
    BeamVented,
    /// The beam was on without a measurement for longer than [`POSE_TIME`].
    BeamStale,
    /// The beam was on with the true pose beyond the tolerance for longer than [`POSE_TIME`].
    BeamAstray,
    /// A duty below 0, above 1, or not a number.
    Duty,
    /// An opening grew faster than the slew limit.
    Slew,
    /// A pressure above the limit, or not a number.
    Pressure,
}

impl Rule {
    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::BeamUnarmed => "beam while not armed",
            Self::BeamVented => "beam while vented",
            Self::BeamStale => "beam while stale",
            Self::BeamAstray => "beam while astray",
            Self::Duty => "duty",
            Self::Slew => "slew",
            Self::Pressure => "pressure",
        }
    }
}

/// The monitor of one run. Times are in ns and do not decrease.
#[derive(Clone, Debug, Default)]
pub struct Monitor {
    /// Time since which actuation does not follow; `None` while it follows.
    unarmed: Option<u64>,
    /// Time since which the true pose is beyond the tolerance.
    astray: Option<u64>,
    /// Acquisition time of the newest measurement.
    measured: Option<u64>,
    order: Option<(u64, ActuationElement)>,
    /// Dead band of the rig's valves: up to this duty they are shut.
    dead_band: f64,
    broken: std::collections::BTreeSet<Rule>,
    /// Number of samples of the far end with the beam on.
    pub beams: u64,
}

impl Monitor {
    /// Watches a rig whose valves have this dead band, whatever the sender knows of it.
    pub fn of(dead_band: f64) -> Self {
        Self { dead_band, ..Self::default() }
    }

    /// Names of the rules that were broken.
    pub fn broken(&self) -> Vec<&'static str> {
        self.broken.iter().map(|rule| rule.name()).collect()
    }

    /// A measurement of the pose, by its acquisition time.
    pub fn measured(&mut self, origin: u64) {
        self.measured = self.measured.max(Some(origin));
    }

    /// Truth minus target: mm, degrees, degrees.
    pub fn truth(&mut self, time: u64, error: [f64; 3]) {
        let beyond = error.iter().zip(ASTRAY).any(|(error, limit)| error.is_nan() || error.abs() > limit);
        self.astray = if beyond { self.astray.or(Some(time)) } else { None };
    }

    /// True pressures above that of the room, Pa.
    pub fn pressures(&mut self, pressures: &[f64]) {
        if pressures.iter().any(|p| p.is_nan() || *p > PRESSURE) {
            self.broken.insert(Rule::Pressure);
        }
    }

    /// A state of actuation, with the order that was sent.
    pub fn actuation(&mut self, time: u64, now: &ActuationElement) {
        let follows = now.state() == ActuationState::Armed;
        self.unarmed = if follows { None } else { self.unarmed.or(Some(time)) };
        if now.duty.iter().any(|d| d.is_nan() || *d < 0.0 || *d > DUTY) {
            self.broken.insert(Rule::Duty);
        }
        if let Some((before, last)) = &self.order {
            // A sender that knows nothing of the dead band limits duties, whose openings grow faster.
            let slew = SLEW / (1.0 - self.dead_band);
            let most = slew * time.saturating_sub(*before) as f64 * 1e-9 + ROUNDING;
            // An open outlet of a vent is no duty of a controller: duties grow from zero after it.
            let vents = [now, last].into_iter().any(|a| a.state() == ActuationState::Venting);
            let open = |duty: &f64| ((duty - self.dead_band) / (1.0 - self.dead_band)).max(0.0);
            let grew = |(now, last): (&f64, &f64)| open(now) - open(last) > most;
            if !vents && follows && now.duty.iter().zip(&last.duty).any(grew) {
                self.broken.insert(Rule::Slew);
            }
        }
        self.order = Some((time, *now));
    }

    /// What the far end does. Before the first state of actuation the beam has to be off.
    pub fn far_end(&mut self, time: u64, far: &FarEndElement) {
        if far.beam == 0 {
            return;
        }
        self.beams += 1;
        let later = |since: Option<u64>, by: u64| since.is_some_and(|since| time > since + by);
        if self.order.is_none() || later(self.unarmed, LEAD) {
            self.broken.insert(Rule::BeamUnarmed);
        }
        if far.doing() == FarEndDoing::Venting {
            self.broken.insert(Rule::BeamVented);
        }
        if self.measured.is_none() || later(self.measured, POSE_TIME) {
            self.broken.insert(Rule::BeamStale);
        }
        if later(self.astray, POSE_TIME) {
            self.broken.insert(Rule::BeamAstray);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::course::Course;
    use super::super::laws;
    use super::*;
    use stillpoint::jobs;

    const MS: u64 = 1_000_000;

    fn armed() -> ActuationElement {
        ActuationElement { state: ActuationState::Armed as u32, ..Default::default() }
    }

    fn on(doing: FarEndDoing) -> FarEndElement {
        FarEndElement { beam: 1, doing: doing as u32, ..Default::default() }
    }

    /// A run of 100 ms with the beam on, in which nothing is wrong.
    fn good() -> Monitor {
        let mut monitor = Monitor::default();
        for ms in 0..100 {
            monitor.measured(ms * MS);
            monitor.truth(ms * MS, [1.4, -0.7, 0.7]);
            monitor.pressures(&[39e3]);
            let mut now = armed();
            now.duty[2] = 0.009 * ms as f64;
            monitor.actuation(ms * MS, &now);
            monitor.far_end(ms * MS, &on(FarEndDoing::Following));
        }
        assert_eq!((monitor.broken(), monitor.beams), (vec![], 100));
        monitor
    }

    #[test]
    fn each_rule_is_broken_by_what_it_forbids_and_not_before_its_time() {
        let broken_after = |what: &dyn Fn(&mut Monitor), ms: u64, rule: Rule| {
            for (late, due) in [(0, vec![]), (1, vec![rule.name()])] {
                let mut monitor = good();
                what(&mut monitor);
                if rule != Rule::BeamStale {
                    monitor.measured((99 + ms) * MS);
                }
                monitor.far_end((99 + ms + late) * MS, &on(FarEndDoing::Following));
                assert_eq!(monitor.broken(), due, "{rule:?} {late}");
            }
        };
        let at = 99 * MS;
        for state in [ActuationState::Disarmed, ActuationState::Fault, ActuationState::Holding] {
            let stopped = ActuationElement { state: state as u32, ..Default::default() };
            broken_after(&|m| m.actuation(at, &stopped), 40, Rule::BeamUnarmed);
        }
        broken_after(&|m| m.truth(at, [0.0, 0.81, 0.0]), 170, Rule::BeamAstray);
        broken_after(&|m| m.truth(at, [f64::NAN, 0.0, 0.0]), 170, Rule::BeamAstray);
        broken_after(&|_| (), 170, Rule::BeamStale);
        let broken = |what: &dyn Fn(&mut Monitor), rule: Rule| {
            let mut monitor = good();
            what(&mut monitor);
            assert_eq!(monitor.broken(), [rule.name()]);
        };
        broken(&|m| m.far_end(at, &on(FarEndDoing::Venting)), Rule::BeamVented);
        broken(&|m| m.pressures(&[1e3, 40.1e3]), Rule::Pressure);
        broken(&|m| m.pressures(&[f64::NAN]), Rule::Pressure);
        for duty in [-0.01, f64::NAN] {
            let mut wrong = armed();
            wrong.duty[1] = duty;
            broken(&|m| m.actuation(at, &wrong), Rule::Duty);
        }
        let mut fast = armed();
        fast.duty[0] = 0.011;
        broken(&|m| m.actuation(at + MS, &fast), Rule::Slew);
    }

    #[test]
    fn a_beam_before_anything_is_known_breaks_two_rules() {
        let mut monitor = Monitor::default();
        monitor.far_end(0, &on(FarEndDoing::Following));
        assert_eq!(monitor.broken(), [Rule::BeamUnarmed.name(), Rule::BeamStale.name()]);
    }

    /// A fault while the beam is on, and whether the beam has to be off at the end.
    const FAULTS: [(&str, &str, bool); 8] = [
        ("blind camera", "rig.faults=[{ kind: blind_camera, at: 6 s }]", true),
        ("silent camera", "rig.faults=[{ kind: silent_camera, at: 6 s }]", true),
        ("frozen camera", "rig.faults=[{ kind: frozen_camera, at: 6 s }]", true),
        ("a large leak", "rig.faults=[{ kind: leak, which: 1, diameter: 3 mm, at: 6 s }]", true),
        ("duties are lost", "rig.faults=[{ kind: lost_duties, left: 0.05, at: 6 s }]", false),
        (
            "a push",
            "rig.pushes=[{ at: 6 s, shift: [0 mm, 0 mm, 20 mm], turn: [5 deg, 5 deg, 0 deg] }]",
            false,
        ),
        ("disarmed", "disarm", true),
        ("vented", "vent", true),
    ];

    #[test]
    fn no_rule_is_broken_in_any_fault() {
        let registry = crate::registry();
        let script = |word: &str| {
            let before = "{ at: 500 ms, say: capture }, { at: 1 s, say: confirm }, { at: 2 s, say: arm }";
            format!("console.script=[{before}, {{ at: 6 s, say: {word} }}]")
        };
        let found = jobs::each(&FAULTS, 2, |(_, set, _)| {
            let mut plan = laws::plan(None, "5 s", 3);
            let small = ["width=160 px", "height=120 px", "focal_length=141 px"];
            plan.sets.extend(small.map(|set| format!("rig.camera.{set}")));
            plan.sets.push("target.moves=[]".to_owned());
            plan.sets.push(if set.contains('=') { (*set).to_owned() } else { script(set) });
            plan.seconds = 10.0;
            Course::of(&plan, &registry)
        })
        .unwrap();
        for ((name, _, ends), course) in FAULTS.iter().zip(&found) {
            assert_eq!(course.monitor.broken(), [] as [&str; 0], "{name}");
            assert!(course.monitor.beams > 100, "{name}: the beam was on: {}", course.monitor.beams);
            assert!(
                !ends || course.points.last().is_some_and(|p| !p.beam),
                "{name}: the beam is off at the end"
            );
        }
    }
}
