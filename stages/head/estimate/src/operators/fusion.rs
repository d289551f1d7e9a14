//! Two tracks of N channels become one: what `estimate.fuse` runs, whatever N is.

use nalgebra::{SMatrix, SVector};
use stillpoint_samples::{Metric, SensorHealth, Standing, TrackElement};

use crate::channels::{Channels, InSamples, LocalTrack};
use crate::cross::{CrossCovariance, Side, Update};
use crate::fusion::{Weighted, cross_covariance, fused, intersection, inverse_variance, joint};
use crate::offset::ClockOffset;
use crate::operators::dispute::{CLOSE, Dispute};
use crate::operators::fuse::Method;
use crate::process::ProcessNoise;
use crate::state::State;
use crate::watch::{Agreement, Fate, Report, Verdict, Watch, WatchParams};

/// Numbers of a diagnostics sample.
pub const METRICS: usize = 6;
/// Names of the sensors: the names of the inputs.
pub const NAMES: [&str; 2] = ["first", "second"];
/// Pairs that the offset of the clocks is estimated from: about two minutes of frames.
const OFFSET_PAIRS: u32 = 4000;
/// Updates whose tracks were lost and that are still made up for; by then a filter has forgotten the first.
const MADE_UP: u64 = 8;

/// What a fusion needs to know.
#[derive(Clone, Copy, Debug)]
pub struct FusionParams {
    /// How the tracks are weighted.
    pub method: Method,
    /// Tracks are apart where a channel's difference, beyond the tolerance and squared, is more than this many times its
    /// variance.
    pub gate: f64,
    /// What the sensors may differ by for good, m.
    pub tolerance: f64,
    /// The same for rotations, rad.
    pub angle_tolerance: f64,
    /// When a sensor is left out.
    pub watch: WatchParams,
}

/// A track that a fusion cannot use, by the name of its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` has other channels than this fusion, or values that are not finite: give both filters and this operator the same \
     `follow`"
)]
pub struct OtherTrack(&'static str);

/// A fusion of tracks of any channels.
pub trait Fusion: Send {
    /// Takes a track acquired at `origin` that arrived at `time`, both ns. Returns the fused state at `origin`, if that
    /// is the newest time.
    ///
    /// # Errors
    /// A track of other channels.
    fn take(
        &mut self,
        side: Side,
        track: &TrackElement,
        origin: u64,
        time: u64,
    ) -> Result<Option<TrackElement>, OtherTrack>;
    /// The fused state at `time`, ns; `None` if a newer state was sent.
    fn predict(&mut self, time: u64) -> Option<TrackElement>;
    /// The health of both sensors at `time`, ns.
    fn health(&self, time: u64) -> [SensorHealth; 2];
    /// Numbers about the fusion.
    fn metrics(&self) -> [Metric; METRICS];
}

pub(super) struct Sensor<const N: usize, X> {
    pub(super) watch: Watch,
    /// The newest track, and when it was acquired.
    pub(super) track: Option<(u64, LocalTrack<N, X>)>,
    run: u64,
    used: u64,
    left_out: u64,
}

/// A [`Fusion`] of N channels; M is twice N.
pub struct FusionOf<const N: usize, const M: usize, X> {
    pub(super) params: FusionParams,
    pub(super) channels: Channels<N>,
    pub(super) sensors: [Sensor<N, X>; 2],
    cross: CrossCovariance<N, M>,
    /// What was known when the sensors were last close, or one was left: (time in ns, state).
    pub(super) consensus: Option<(u64, State<N, X>)>,
    pub(super) dispute: Dispute,
    offset: ClockOffset<N>,
    pub(super) distance: f64,
    weight: f64,
    lost: u64,
    sent: u64,
    run: u64,
}

impl<const N: usize, const M: usize, X: InSamples<N>> FusionOf<N, M, X> {
    /// A fusion without tracks.
    pub fn new(params: FusionParams, channels: Channels<N>) -> Self {
        let sensor = || Sensor { watch: Watch::new(params.watch), track: None, run: 0, used: 0, left_out: 0 };
        Self {
            params,
            channels,
            sensors: [sensor(), sensor()],
            cross: CrossCovariance::new(ProcessNoise::per_step(0.0)),
            consensus: None,
            dispute: Dispute::None,
            offset: ClockOffset::new(OFFSET_PAIRS),
            distance: f64::NAN,
            weight: f64::NAN,
            lost: 0,
            sent: 0,
            run: 0,
        }
    }

    /// Brings an update of one filter into the cross covariance.
    fn record(&mut self, side: Side, origin: u64, run: u64, update: &Update<N>) {
        let sensor = &mut self.sensors[side as usize];
        let last = sensor.track.as_ref().map(|(origin, _)| *origin);
        let missing = match update {
            Update::Gain(_) if sensor.run > 0 => run.saturating_sub(sensor.run + 1),
            _ => 0,
        };
        sensor.run = run;
        self.lost += missing;
        // Updates whose tracks were lost had about the gain of this one: it hardly changes in a settled filter.
        let made_up = missing.min(MADE_UP);
        let gap = origin.saturating_sub(last.unwrap_or(origin)) / (made_up + 1);
        for k in (0..=made_up).rev() {
            self.cross.record(side, origin - k * gap, *update);
        }
    }

    /// The state of a sensor at `time`, if it is not older than the timeout.
    pub(super) fn state(&self, side: usize, time: u64) -> Option<State<N, X>> {
        let (origin, track) = self.sensors[side].track.as_ref()?;
        let age = time.saturating_sub(*origin);
        let state = track.state.filter(|_| age <= self.params.watch.timeout)?;
        Some(if age == 0 { state } else { state.predicted(age as f64 * 1e-9, &track.process) })
    }

    pub(super) fn is_used(&self, side: usize) -> bool {
        self.sensors[side].watch.verdict() == Verdict::Used
    }

    /// What the rule has for the covariance of the errors of both tracks.
    pub(super) fn p12(&self, time: u64) -> SMatrix<f64, M, M> {
        match self.params.method {
            Method::CrossCovariance => self.cross.at(time),
            Method::InverseVariance | Method::Intersection => SMatrix::zeros(),
        }
    }

    fn weigh(
        &self,
        first: &State<N, X>,
        second: &State<N, X>,
        p12: &SMatrix<f64, M, M>,
    ) -> Option<Weighted<M>> {
        let (p1, p2) = (joint(first), joint(second));
        match self.params.method {
            Method::CrossCovariance => {
                cross_covariance(&p1, &p2, p12).filter(|w| (0..M).all(|i| w.covariance[(i, i)] > 0.0))
            }
            Method::InverseVariance => inverse_variance(&p1, &p2),
            Method::Intersection => None,
        }
        .or_else(|| intersection(&p1, &p2))
    }

    /// What the sensors that are used say of `time`.
    fn fuse(&mut self, time: u64) -> Option<State<N, X>> {
        let of = |side: usize| if self.is_used(side) { self.state(side, time) } else { None };
        let state = match (of(0), of(1)) {
            (Some(first), Some(second)) => {
                let p12 = self.p12(time);
                let weighted = self.weigh(&first, &second, &p12)?;
                self.weight = weighted.weight[(0, 0)];
                let state = fused(&first, &second, &weighted);
                let variance =
                    SVector::from_fn(|i, _| first.pp[(i, i)] + second.pp[(i, i)] - 2.0 * p12[(i, i)]);
                self.offset.add(&second.position.minus(&first.position), &variance, &state.velocity);
                state
            }
            (Some(only), None) => {
                self.weight = 0.0;
                only
            }
            (None, Some(only)) => {
                self.weight = 1.0;
                only
            }
            (None, None) => return None,
        };
        state.is_finite().then_some(state)
    }

    fn output(&mut self, time: u64, standing: Standing) -> TrackElement {
        let state = self.fuse(time);
        let process =
            (0..2).find(|side| self.is_used(*side)).and_then(|side| self.sensors[side].track.as_ref());
        let track = match (state, process) {
            (Some(state), Some((_, track))) => {
                let both = self.is_used(0) && self.is_used(1);
                if !both || self.distance <= CLOSE * self.params.gate {
                    self.consensus = Some((time, state));
                }
                self.run += 1;
                let numbers = self.channels.track(&state, &track.process);
                TrackElement { standing: standing as u32, run: self.run, ..numbers }
            }
            _ => {
                self.weight = f64::NAN;
                self.run = 0;
                TrackElement { channels: self.channels.bits(), ..TrackElement::NONE }
            }
        };
        self.sent += 1;
        TrackElement {
            accepted: self.sensors.iter().map(|s| s.used).sum(),
            rejected: self.sensors.iter().map(|s| s.left_out).sum(),
            ..track
        }
    }
}

impl<const N: usize, const M: usize, X: InSamples<N>> Fusion for FusionOf<N, M, X> {
    fn take(
        &mut self,
        side: Side,
        track: &TrackElement,
        origin: u64,
        time: u64,
    ) -> Result<Option<TrackElement>, OtherTrack> {
        let own = side as usize;
        let Some(local) = self.channels.read::<X>(track) else {
            return Err(OtherTrack(NAMES[own]));
        };
        let fate = match track.standing() {
            // A filter with a timer sends what it predicts between measurements: nothing new.
            Standing::Predicted => return Ok(None),
            Standing::Measured => Fate::Used,
            Standing::Refused if track.nis.is_nan() => Fate::Refused,
            Standing::Refused => Fate::Gated,
            Standing::None => Fate::NoEstimate,
        };
        let report = Report { origin, arrival: time, repeated: track.repeated, fate };
        let sound = self.sensors[own].watch.is_sound(&report);
        if let [Some((_, a)), Some((_, b))] = [&self.sensors[0].track, &self.sensors[1].track]
            && a.state.and(b.state).is_some()
        {
            self.cross.share(CrossCovariance::<N, M>::shared(&a.process, &b.process));
        }
        if let Some(update) = &local.update {
            self.record(side, origin, track.run, update);
        }
        self.sensors[own].track = Some((origin, local));
        self.sensors[1 - own].watch.look(time);
        let newest = self.sensors[1 - own].track.as_ref().filter(|_| self.is_used(1 - own));
        let at = newest.map_or(origin, |(newest, _)| origin.max(*newest));
        let agreement = if sound { self.agreement(side, at) } else { Agreement::Unknown };
        self.sensors[own].watch.see(report, agreement);
        self.settle(time);
        if self.sensors[own].watch.verdict() == Verdict::Clock {
            // The times of what the tracks have in common are wrong.
            self.cross.restart();
        }
        let used = self.is_used(own);
        let sensor = &mut self.sensors[own];
        *(if used { &mut sensor.used } else { &mut sensor.left_out }) += 1;
        let other_is_newer =
            self.is_used(1 - own) && self.state(1 - own, time).is_some() && (!used || at > origin);
        if other_is_newer {
            return Ok(None);
        }
        let standing = if fate == Fate::Used { Standing::Measured } else { Standing::Refused };
        Ok(Some(self.output(origin, standing)))
    }

    fn predict(&mut self, time: u64) -> Option<TrackElement> {
        for sensor in &mut self.sensors {
            sensor.watch.look(time);
        }
        let is_ahead = |side: usize| {
            let newest = self.sensors[side].track.as_ref();
            self.is_used(side) && newest.is_some_and(|(origin, _)| *origin > time)
        };
        (!(0..2).any(is_ahead)).then(|| self.output(time, Standing::Predicted))
    }

    fn health(&self, time: u64) -> [SensorHealth; 2] {
        let seconds = |from: u64| time.saturating_sub(from) as f64 * 1e-9;
        std::array::from_fn(|side| {
            let sensor = &self.sensors[side];
            let verdict = sensor.watch.verdict();
            SensorHealth {
                age: sensor.watch.last().map_or(f64::NAN, |last| seconds(last.origin)),
                since: if verdict == Verdict::Waiting { f64::NAN } else { seconds(sensor.watch.since()) },
                distance: self.distance,
                used: sensor.used,
                left_out: sensor.left_out,
                name: SensorHealth::field(NAMES[side]),
                reason: SensorHealth::field(verdict.name()),
            }
        })
    }

    fn metrics(&self) -> [Metric; METRICS] {
        let used = (0..2).filter(|side| self.is_used(*side)).count();
        let offset = self.offset.estimate();
        [
            Metric::new("sensors_used", used as f64),
            Metric::new("weight_of_second", self.weight),
            Metric::new("clock_offset_s", offset.map_or(f64::NAN, |o| o.seconds)),
            Metric::new("clock_offset_sd_s", offset.map_or(f64::NAN, |o| o.sd)),
            Metric::new("tracks_lost", self.lost as f64),
            Metric::new("sent", self.sent as f64),
        ]
    }
}
