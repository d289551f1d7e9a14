//! The evidence about a fault, read from the session of its run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use stillpoint_recorder::{Completeness, Session, session_parts};
use stillpoint_samples::{
    Actuation, Diagnostics, Duties, DutiesElement, FarEnd, FarEndDoing, FarEndElement, Pieces, RigState,
    Sample, Track, View,
};

use stillpoint::Failure;

/// Maximum growth of duties from rest, 1/s: the default of the sender's slew and of the far end's ramp.
const GROWTH: f64 = 10.0;
/// Period of the sender, s. Its first order has the growth of one period. No order is on its way for longer.
const PERIOD: f64 = 0.01;
/// Maximum opening of a safe inlet.
const SHUT: f64 = 0.05;
/// Minimum opening of a safe outlet.
const OPEN: f64 = 0.5;

/// The evidence of one session. Times are in ms after the fault.
#[derive(Debug, Default)]
pub struct Evidence {
    /// Arrival of the last order before the far end vented, or before the end of the observation.
    pub last_order_ms: f64,
    /// Last time before that at which the far end followed an order.
    pub last_followed_ms: f64,
    /// Acquisition time of the newest frame with a pose before that.
    pub last_pose_ms: f64,
    /// Time at which the far end first vented; `None` if it did not.
    pub vents_ms: Option<f64>,
    /// Time after that at which the valves were first safe: inlets shut, outlets at least half open.
    pub valves_ms: Option<f64>,
    /// Time at which the beam was first off; `None` if it stayed on.
    pub beam_ms: Option<f64>,
    /// Every vent of the far end.
    pub vents: Vec<Vent>,
    /// All reasons and faults of actuation after the fault, as bits.
    pub reasons: u32,
    /// Number of datagrams that the far end refused, or that its link did not take.
    pub refused: u64,
    /// Names of the processes that did not end in order.
    pub died: BTreeSet<String>,
    /// Gaps that the session states.
    pub gaps: Vec<String>,
    /// Number of parts of the session.
    pub parts: usize,
    /// Longest time between two samples of the far end or of the rig.
    pub bedside_stood_ms: f64,
    /// Description of the first duty that grew too fast when the valves followed again; `None` if none did.
    pub jump: Option<String>,
}

/// One vent of the far end. Times are in ms after the fault.
#[derive(Debug, PartialEq)]
pub struct Vent {
    /// Arrival of the last order before it.
    pub order_ms: f64,
    /// Time after its begin at which the valves were first safe.
    pub valves_ms: Option<f64>,
    /// Time after its begin at which the far end first followed an order again.
    pub follows_ms: Option<f64>,
}

/// Names of processes, each with one of its operators.
const PROCESSES: [(&str, &str); 3] = [("control", "valves"), ("perception", "head"), ("console", "console")];

/// Values from the samples of a session, in the order of the samples. Stamps are in ns.
#[derive(Default)]
struct Tracks {
    far: Vec<(u64, FarEndElement)>,
    duties: BTreeMap<u64, DutiesElement>,
    /// Stamps, and whether the valves are safe.
    rig: Vec<(u64, bool)>,
    /// Stamps of poses, and acquisition times of their frames, ns.
    poses: Vec<(u64, u64)>,
    reasons: Vec<(u64, u32)>,
    /// Datagrams for the valves that the link did not take.
    untaken: u64,
}

impl Evidence {
    /// Reads the session in the folder of a trial. Its fault happened at `struck`, ns since the epoch, and the run was
    /// observed for `watched` after that.
    pub fn read(place: &Path, struck: u64, watched: Duration) -> Result<Self, Failure> {
        let sessions = place.join("s");
        let folder = std::fs::read_dir(&sessions).map_err(Failure::failed)?.flatten().next();
        let folder = folder.ok_or_else(|| Failure::failed("the run recorded no session"))?.path();
        let session = Session::open_any(&folder).map_err(Failure::failed)?;
        let tracks = Tracks::read(&session)?;
        let mut evidence = tracks.evidence(struck, struck + watched.as_nanos() as u64);
        let unended = session.unended();
        let died = PROCESSES.iter().filter(|(_, operator)| unended.iter().any(|(o, _)| o == operator));
        evidence.died = died.map(|(process, _)| (*process).to_owned()).collect();
        if let Completeness::Gaps(gaps) = session.completeness() {
            evidence.gaps = gaps.iter().map(ToString::to_string).collect();
        }
        evidence.parts = session_parts(&folder).map_err(Failure::failed)?.len();
        Ok(evidence)
    }
}

impl Tracks {
    fn read(session: &Session) -> Result<Self, Failure> {
        const LINK: &str = "valves_datagram.diagnostics";
        const TOPICS: [&str; 6] =
            ["far.state", "far.duties", "rig.state", "filter.state", "valves.state", LINK];
        let mut tracks = Self::default();
        for recorded in session.samples_where(|t| TOPICS.contains(&t.name.as_str())) {
            let recorded = recorded.map_err(Failure::failed)?;
            let bytes = &recorded.sample;
            match session.topics()[recorded.topic].name.as_str() {
                "far.state" => {
                    let view = view::<FarEnd>(bytes)?;
                    tracks.far.extend(view.first().map(|state| (view.header.stamp, *state)));
                }
                "far.duties" => {
                    let view = view::<Duties>(bytes)?;
                    tracks.duties.extend(view.first().map(|duties| (view.header.stamp, *duties)));
                }
                "rig.state" => {
                    let view = view::<RigState>(bytes)?;
                    let Some(state) = view.first() else { continue };
                    let valves = &state.opening[..2 * (state.bladders as usize).min(8)];
                    let safe = valves.chunks_exact(2).all(|pair| pair[0] <= SHUT && pair[1] >= OPEN);
                    tracks.rig.push((view.header.stamp, safe));
                }
                LINK => {
                    let of =
                        |name: &str| ["foreign", "too_many", "too_long", "too_many_at_once"].contains(&name);
                    let counts = view::<Diagnostics>(bytes)?;
                    let untaken = counts.elements.iter().filter(|metric| of(metric.name()));
                    tracks.untaken = untaken.map(|metric| metric.value as u64).sum();
                }
                "filter.state" => {
                    let view = view::<Track>(bytes)?;
                    tracks.poses.push((view.header.stamp, view.header.origin));
                }
                _ => {
                    let view = view::<Actuation>(bytes)?;
                    tracks.reasons.extend(view.first().map(|a| (view.header.stamp, a.reasons | a.fault)));
                }
            }
        }
        Ok(tracks)
    }

    fn evidence(&self, struck: u64, until: u64) -> Evidence {
        let after = |stamp: u64| (stamp as f64 - struck as f64) * 1e-6;
        let watched = || self.far.iter().filter(|(stamp, _)| (struck..=until).contains(stamp));
        let vents = watched().find(|(_, s)| s.doing() == FarEndDoing::Venting).map(|(stamp, _)| *stamp);
        let end = vents.unwrap_or(until);
        let before = || self.far.iter().filter(|(stamp, _)| *stamp <= end);
        let followed = before().rfind(|(_, s)| s.doing() == FarEndDoing::Following);
        let safe = vents.and_then(|vents| self.rig.iter().find(|(stamp, safe)| *stamp >= vents && *safe));
        let poses = self.poses.iter().filter(|(stamp, _)| *stamp < end);
        Evidence {
            last_order_ms: before().next_back().map_or(f64::NAN, |(_, s)| after(s.arrived)),
            last_followed_ms: followed.map_or(f64::NAN, |(stamp, _)| after(*stamp)),
            last_pose_ms: poses.map(|(_, origin)| after(*origin)).fold(f64::NAN, f64::max),
            vents_ms: vents.map(after),
            valves_ms: safe.map(|(stamp, _)| after(*stamp)),
            beam_ms: watched().find(|(_, s)| s.beam == 0).map(|(stamp, _)| after(*stamp)),
            vents: self.vents(struck, until),
            reasons: self.reasons.iter().filter(|(s, _)| *s >= struck).fold(0, |all, (_, r)| all | r),
            refused: self.untaken + self.far.last().map_or(0, |(_, s)| s.refused),
            bedside_stood_ms: longest_pause(self.far.iter().map(|(s, _)| *s), struck, until)
                .max(longest_pause(self.rig.iter().map(|(s, _)| *s), struck, until)),
            jump: self.jump(),
            ..Evidence::default()
        }
    }

    fn vents(&self, struck: u64, until: u64) -> Vec<Vent> {
        let after = |stamp: u64| (stamp as f64 - struck as f64) * 1e-6;
        let watched = self.far.iter().filter(|(stamp, _)| (struck..=until).contains(stamp));
        let mut vents = Vec::new();
        let mut vented = false;
        for (begin, state) in watched {
            let begins = state.doing() == FarEndDoing::Venting && !vented;
            vented = state.doing() == FarEndDoing::Venting;
            if !begins {
                continue;
            }
            let follows = |s: &FarEndElement| s.doing() == FarEndDoing::Following;
            let safe = self.rig.iter().find(|(stamp, safe)| stamp >= begin && *safe);
            let followed = self.far.iter().find(|(stamp, s)| stamp >= begin && follows(s));
            vents.push(Vent {
                order_ms: after(state.arrived),
                valves_ms: safe.map(|(stamp, _)| after(*stamp)),
                follows_ms: followed.map(|(stamp, _)| after(*stamp)),
            });
        }
        vents
    }

    /// Describes the first duty that grew faster than permitted after a time in which the far end did not follow.
    fn jump(&self) -> Option<String> {
        let mut rested = self.far.first()?.0;
        for (stamp, state) in &self.far {
            if state.doing() != FarEndDoing::Following {
                // Duties grow from the last order to hold while that order is valid, else from the last time without an
                // order.
                rested = if state.ends > *stamp { state.arrived } else { *stamp };
                continue;
            }
            let Some(duties) = self.duties.get(stamp) else { continue };
            let rest = (*stamp - rested) as f64 * 1e-9;
            let most = GROWTH * (rest + PERIOD) + 1e-6;
            if let Some((valve, duty)) = duties.duty.iter().enumerate().find(|(_, d)| **d > most) {
                return Some(format!("valve {valve} is {duty:.3} open {:.1} ms after rest", rest * 1e3));
            }
        }
        None
    }
}

/// Longest time between two consecutive stamps up to `until`, ms. The first of them may be the last stamp before
/// `from`.
fn longest_pause(stamps: impl Iterator<Item = u64>, from: u64, until: u64) -> f64 {
    let mut last = None;
    let mut longest = 0;
    for stamp in stamps.take_while(|s| *s <= until) {
        if let Some(last) = last.filter(|_| stamp >= from) {
            longest = longest.max(stamp - last);
        }
        last = Some(stamp);
    }
    longest as f64 * 1e-6
}

fn view<S: Sample>(bytes: &[u8]) -> Result<View<'_, S>, Failure> {
    Pieces::split(S::KIND, bytes).and_then(|p| p.view::<S>()).map_err(Failure::failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// A far end that follows for 10 ms, holds, vents, and follows again. One duty has this value 10 ms after the last
    /// rest.
    fn tracks(duty: f64) -> Tracks {
        let mut tracks = Tracks::default();
        for ms in 0..40 {
            let doing = match ms {
                10..12 => FarEndDoing::Holding,
                12..30 => FarEndDoing::Venting,
                _ => FarEndDoing::Following,
            };
            let beam = u32::from(ms < 10);
            let arrived = ms.min(8) * MS;
            tracks
                .far
                .push((ms * MS, FarEndElement { doing: doing as u32, beam, arrived, ..Default::default() }));
            tracks.rig.push((ms * MS, (20..30).contains(&ms)));
            let mut duties = DutiesElement::default();
            duties.duty[2] = if ms == 39 { duty } else { 0.0 };
            tracks.duties.insert(ms * MS, duties);
        }
        tracks
    }

    #[test]
    fn times_are_those_of_the_first_vent_and_what_was_before_it() {
        let e = tracks(0.0).evidence(5 * MS, 35 * MS);
        assert_eq!((e.last_order_ms, e.last_followed_ms), (3.0, 4.0));
        assert_eq!((e.beam_ms, e.vents_ms, e.valves_ms), (Some(5.0), Some(7.0), Some(15.0)));
        assert!((e.bedside_stood_ms - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_vent_ends_where_an_order_is_followed_again() {
        let due = Vent { order_ms: 3.0, valves_ms: Some(15.0), follows_ms: Some(25.0) };
        assert_eq!(tracks(0.0).vents(5 * MS, 35 * MS), [due]);
        assert_eq!(tracks(0.0).vents(31 * MS, 35 * MS), []);
    }

    #[test]
    fn a_duty_that_grows_faster_than_the_ramp_is_a_jump() {
        assert_eq!(tracks(0.1999).jump(), None);
        assert!(tracks(0.21).jump().unwrap_or_default().starts_with("valve 2"));
    }
}
