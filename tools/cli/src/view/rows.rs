//! The head, its target, beam and valves over time, as rows at an interval. A row is added between, too, where the state of
//! beam, valves or tracker changes, so that no change is passed over.

use serde::Serialize;
use stillpoint_pose::angles;
use stillpoint_samples::{
    Actuation, ActuationElement, Gate, GateElement, Pieces, PoseReport, PoseReportElement, Target,
    TargetElement, Track, TrackElement,
};

use super::scene::Says;

/// The state at one time. What is not known is `null` in JSON.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Since the base of times, s.
    pub t: f64,
    /// x, y, z in m; pitch, roll, yaw in rad, in the frame of the estimate.
    pub estimate: [f64; 6],
    /// The same of the target, in the channels that it holds.
    pub target: [f64; 6],
    /// Whether the beam may be on.
    pub beam: Option<bool>,
    /// Why it may not: bits.
    pub reasons: u32,
    /// What actuation is at.
    pub valves: Option<u32>,
    /// Why: bits.
    pub valves_reasons: u32,
    /// What made the fault, while actuation is in one: bits.
    pub fault: u32,
    /// What the tracker reports.
    pub tracker: Option<u32>,
    /// Whether the parts of the reference were seen to move together.
    pub proof: Option<u32>,
    /// Why they were not.
    pub unproven: Option<u32>,
    /// How sure the tracker is that it follows what was captured, 0 to 1.
    pub confidence: f64,
}

/// Makes rows of samples.
pub struct Rows {
    interval: u64,
    /// Session time of `t = 0`, ns; of the first sample where it is not given.
    base: Option<u64>,
    track: Option<TrackElement>,
    target: Option<TargetElement>,
    gate: Option<GateElement>,
    valves: Option<ActuationElement>,
    report: Option<PoseReportElement>,
    last: Option<(u64, [Option<u32>; 5])>,
    made: Vec<Row>,
}

impl Rows {
    /// With rows at this interval, ns.
    pub fn every(interval: u64, base: Option<u64>) -> Self {
        Self {
            interval,
            base,
            track: None,
            target: None,
            gate: None,
            valves: None,
            report: None,
            last: None,
            made: Vec::new(),
        }
    }

    /// Session time of `t = 0`, ns.
    pub fn base(&self) -> u64 {
        self.base.unwrap_or(0)
    }

    /// Takes a sample.
    pub fn take(&mut self, says: Says, pieces: Pieces<'_>) {
        let stamp = pieces.header().stamp;
        let base = *self.base.get_or_insert(stamp);
        match says {
            Says::Estimate => set::<Track>(&mut self.track, pieces),
            Says::Target => set::<Target>(&mut self.target, pieces),
            Says::Beam => set::<Gate>(&mut self.gate, pieces),
            Says::Valves => set::<Actuation>(&mut self.valves, pieces),
            Says::Tracker => set::<PoseReport>(&mut self.report, pieces),
        }
        let state = self.state();
        let adds = self.last.is_none_or(|(at, before)| {
            stamp.saturating_sub(at) >= self.interval || (before != state && stamp >= at)
        });
        if adds {
            self.last = Some((stamp, state));
            let row = self.row(stamp.saturating_sub(base) as f64 * 1e-9);
            self.made.push(row);
        }
    }

    /// The rows since the last call.
    pub fn made(&mut self) -> Vec<Row> {
        std::mem::take(&mut self.made)
    }

    /// What a change is noticed by.
    fn state(&self) -> [Option<u32>; 5] {
        [
            self.gate.map(|g| g.beam),
            self.valves.map(|v| v.state),
            self.target.map(|t| t.channels),
            self.report.map(|r| r.proof),
            self.report.map(|r| r.reference),
        ]
    }

    fn row(&self, t: f64) -> Row {
        let mut row = Row {
            t,
            estimate: [f64::NAN; 6],
            target: [f64::NAN; 6],
            beam: self.gate.map(|g| g.beam == 1),
            reasons: self.gate.map_or(0, |g| g.reasons),
            valves: self.valves.map(|v| v.state),
            valves_reasons: self.valves.map_or(0, |v| v.reasons),
            fault: 0,
            tracker: self.report.map(|r| r.status),
            proof: self.report.map(|r| r.proof),
            unproven: self.report.map(|r| r.unproven),
            confidence: self.report.map_or(f64::NAN, |r| r.confidence),
        };
        if let Some(track) = &self.track {
            row.estimate[..3].copy_from_slice(&track.position);
            row.estimate[3..].copy_from_slice(&angles(track.orientation).unwrap_or([f64::NAN; 3]));
        }
        if let Some(target) = &self.target {
            for place in (0..6).filter(|place| target.channels >> place & 1 == 1) {
                row.target[place] = [target.position, target.angles][place / 3][place % 3];
            }
        }
        if let Some(valves) = self.valves.filter(|v| v.state() == stillpoint_samples::ActuationState::Fault) {
            row.fault = valves.fault;
        }
        row
    }
}

fn set<S: stillpoint_samples::Sample>(newest: &mut Option<S::Element>, pieces: Pieces<'_>)
where
    S::Element: Copy,
{
    if let Ok(view) = pieces.view::<S>() {
        *newest = view.elements.first().copied().or(*newest);
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{HEADER_SIZE, Header, Sample};
    use zerocopy::IntoBytes;

    use super::*;

    fn gate(rows: &mut Rows, ms: u64, beam: u32, reasons: u32) {
        let header = Header { stamp: 1_000_000 * ms, count: 1, ..Header::default() };
        let element = GateElement {
            position_error: [f64::NAN; 3],
            angle_error: [f64::NAN; 3],
            position_sd: f64::NAN,
            angle_sd: f64::NAN,
            lease_ends: 0,
            well_for: 0,
            on_for: 0,
            watched_for: 0,
            leases: 0,
            datagram: 0,
            beam,
            reasons,
            ended_by: 0,
            reserved: 0,
        };
        let bytes = stillpoint_samples::AlignedBytes::joined(header.as_bytes(), element.as_bytes());
        assert_eq!(header.as_bytes().len(), HEADER_SIZE);
        rows.take(Says::Beam, Pieces::split(Gate::KIND, &bytes).unwrap());
    }

    #[test]
    fn rows_come_at_the_interval_and_at_each_change_of_the_beam() {
        let mut rows = Rows::every(100_000_000, None);
        for (ms, beam) in [(1000, 0), (1010, 0), (1050, 1), (1060, 0), (1100, 0), (1160, 0), (1170, 0)] {
            gate(&mut rows, ms, beam, 1 - beam);
        }
        let made = rows.made();
        let found: Vec<_> = made.iter().map(|r| ((r.t * 1e3).round() as u64, r.beam)).collect();
        assert_eq!(found, [(0, Some(false)), (50, Some(true)), (60, Some(false)), (160, Some(false))]);
        assert_eq!((made[1].reasons, made[0].reasons, rows.made().len()), (0, 1, 0));
        assert!(serde_json::to_string(&made[0]).unwrap().contains("\"estimate\":[null,null"));
    }
}
