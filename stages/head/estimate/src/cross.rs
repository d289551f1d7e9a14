//! The cross covariance of the errors of two tracks of one motion (SCIENCE D3).
//!
//! The same accelerations act on both filters, so their errors are correlated: P12 = (I - K1 H)(F P12 F^T + Q)(I - K2
//! H)^T. The two filters need not be updated at the same times: an update of the first multiplies from the left, an
//! update of the second from the right, and between updates P12 is predicted. The measurement noises of the filters are
//! independent, so P12 is 0 when either track begins.

use nalgebra::{SMatrix, SVector};

use crate::process::{Hold, ProcessNoise};

/// Largest number of updates that wait until the other track is as far.
const WAITING: usize = 16;

/// Which of the two tracks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The first: its errors are the rows of P12.
    First,
    /// The second: its errors are the columns.
    Second,
}

/// How a filter used a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Update<const N: usize> {
    /// It began a track.
    Start,
    /// It used the measurement with this gain, the rows for the position and those for the velocity.
    Gain([SMatrix<f64, N, N>; 2]),
}

#[derive(Debug, Clone, Copy)]
struct PendingUpdate<const N: usize> {
    time: u64,
    side: Side,
    update: Update<N>,
}

/// P12 over the updates of both tracks. It does not allocate.
#[derive(Debug, Clone)]
pub struct CrossCovariance<const N: usize, const M: usize> {
    p12: SMatrix<f64, M, M>,
    /// Time of `p12`, ns; every update up to it is in it.
    at: u64,
    process: ProcessNoise<N>,
    /// How far each track is known, ns.
    known: [u64; 2],
    /// Updates after `at`, in the order of time.
    waiting: [Option<PendingUpdate<N>>; WAITING],
}

impl<const N: usize, const M: usize> CrossCovariance<N, M> {
    /// Tracks without correlation. `process` is the noise that they share.
    #[must_use]
    pub fn new(process: ProcessNoise<N>) -> Self {
        const { assert!(M == 2 * N, "M is twice N: positions, then velocities") };
        Self { p12: SMatrix::zeros(), at: 0, process, known: [0; 2], waiting: [None; WAITING] }
    }

    /// The process noise that two filters with different process noises share: the geometric mean.
    #[must_use]
    pub fn shared(first: &ProcessNoise<N>, second: &ProcessNoise<N>) -> ProcessNoise<N> {
        let mean = |a: f64, b: f64| (a * b).sqrt();
        let hold = match (first.hold, second.hold) {
            (Hold::Seconds(a), Hold::Seconds(b)) => Hold::Seconds(mean(a, b)),
            _ => Hold::Step,
        };
        let (a, b) = (first.acceleration_sd, second.acceleration_sd);
        ProcessNoise { acceleration_sd: SVector::from_fn(|i, _| mean(a[i], b[i])), hold }
    }

    /// Sets the process noise that the tracks share from here on.
    pub fn share(&mut self, process: ProcessNoise<N>) {
        self.process = process;
    }

    /// Takes an update of one track at `time`, ns. Updates of one track come in the order of time; updates of both
    /// together need not.
    pub fn record(&mut self, side: Side, time: u64, update: Update<N>) {
        let step = PendingUpdate { time: time.max(self.at), side, update };
        if self.waiting[WAITING - 1].is_some() {
            // The other track has been silent for all of these: it had no updates among them.
            self.absorb_first();
        }
        let place = self.waiting.iter().position(|w| w.is_none_or(|w| w.time > step.time));
        if let Some(place) = place {
            self.waiting[place..].rotate_right(1);
            self.waiting[place] = Some(step);
        }
        let known = &mut self.known[side as usize];
        *known = (*known).max(time);
        let both = self.known[0].min(self.known[1]);
        while self.waiting[0].is_some_and(|w| w.time <= both) {
            self.absorb_first();
        }
    }

    /// P12 at `time`, ns, by the updates known so far.
    #[must_use]
    pub fn at(&self, time: u64) -> SMatrix<f64, M, M> {
        let (mut p12, mut at) = (self.p12, self.at);
        for step in self.waiting.iter().flatten().take_while(|step| step.time <= time) {
            p12 = self.after(&p12, at, step);
            at = step.time;
        }
        self.predicted(&p12, at, time)
    }

    /// Resets the correlation of the tracks and the times of both.
    pub fn restart(&mut self) {
        *self = Self::new(self.process);
    }

    fn absorb_first(&mut self) {
        if let Some(step) = self.waiting[0].take() {
            self.p12 = self.after(&self.p12, self.at, &step);
            self.at = step.time;
            self.waiting.rotate_left(1);
        }
    }

    fn after(&self, p12: &SMatrix<f64, M, M>, at: u64, step: &PendingUpdate<N>) -> SMatrix<f64, M, M> {
        let Update::Gain(gain) = &step.update else { return SMatrix::zeros() };
        let keep = keep::<N, M>(gain);
        let prior = self.predicted(p12, at, step.time);
        match step.side {
            Side::First => keep * prior,
            Side::Second => prior * keep.transpose(),
        }
    }

    fn predicted(&self, p12: &SMatrix<f64, M, M>, from: u64, to: u64) -> SMatrix<f64, M, M> {
        // Before the first update nothing is known, and nothing is shared.
        if to <= from || from == 0 { *p12 } else { predicted(p12, (to - from) as f64 * 1e-9, &self.process) }
    }
}

/// F P12 F^T + Q, `dt` seconds later.
#[must_use]
pub fn predicted<const N: usize, const M: usize>(
    p12: &SMatrix<f64, M, M>,
    dt: f64,
    process: &ProcessNoise<N>,
) -> SMatrix<f64, M, M> {
    let f = SMatrix::<f64, M, M>::from_fn(|i, j| match j.checked_sub(i) {
        Some(0) => 1.0,
        Some(d) if d == N => dt,
        _ => 0.0,
    });
    let q = process.over(dt);
    let mut predicted = f * p12 * f.transpose();
    for i in 0..N {
        predicted[(i, i)] += q.pp[i];
        predicted[(i, N + i)] += q.pv[i];
        predicted[(N + i, i)] += q.pv[i];
        predicted[(N + i, N + i)] += q.vv[i];
    }
    predicted
}

/// I - K H, by which an update multiplies the errors of its track.
#[must_use]
pub fn keep<const N: usize, const M: usize>(gain: &[SMatrix<f64, N, N>; 2]) -> SMatrix<f64, M, M> {
    SMatrix::from_fn(|i, j| {
        let identity = f64::from(u8::from(i == j));
        match (i < N, j < N) {
            (true, true) => identity - gain[0][(i, j)],
            (false, true) => -gain[1][(i - N, j)],
            _ => identity,
        }
    })
}
