//! What filters and fusion gain: variance before and behind each filter, its lag behind a ramp, and the fused track beside
//! the filter that has the measurements of all sensors (Figs 4.3 to 4.5).

use nalgebra::{Matrix1, Vector1};
use serde::Serialize;
use stillpoint_estimate::{Hold, Kalman, KalmanParams, Measurement, ProcessNoise};
use stillpoint_samples::Standing;

use crate::ReportError;
use crate::motion::{CHANNELS, Truth, compare, unit};
use crate::numbers::{fixed, percent, short};
use crate::page::{Block, Cell, Section, Table};
use crate::ramp::{RAMP_MM_PER_S, Settled};
use crate::recording::{PoseRole, Recording, Signal, State, Tracking};
use crate::source::Source;
use crate::statistics::{mean, quantile, variance};

/// What a filter needs to settle, ns: no figure here looks at it.
const SETTLING: u64 = 3_000_000_000;

#[derive(Serialize)]
struct FiltersFigures {
    settling_s: f64,
    filters: Vec<Filter>,
    fused: Vec<Fused>,
}

/// A filter of one channel. Variances in mm2 or degrees2.
#[derive(Serialize)]
struct Filter {
    topic: String,
    measurement: String,
    channel: &'static str,
    unit: &'static str,
    raw_variance: f64,
    filtered_variance: f64,
    /// Part of the variance that the filter takes away here: noise, less the lag that it adds.
    reduction: f64,
    /// Part of the variance of white noise that its last gains take away of a head at rest.
    reduction_of_white_noise: Option<f64>,
    /// Mean lag behind a ramp of 10 mm/s over its first, second and sixth second, by its last gains.
    lag_mm: Option<[f64; 3]>,
    interval_ms: f64,
}

/// A fused track of one channel. Variances in mm2 or degrees2.
#[derive(Serialize)]
struct Fused {
    topic: String,
    channel: &'static str,
    unit: &'static str,
    estimates: usize,
    variance: f64,
    claimed: f64,
    claimed_over_actual: f64,
    /// Of the filter that has the measurements of all sensors, at the same times.
    centralised_variance: Option<f64>,
    over_centralised: Option<f64>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let mut figures =
        FiltersFigures { settling_s: SETTLING as f64 * 1e-9, filters: Vec::new(), fused: Vec::new() };
    for signal in recording.signals_of(PoseRole::Filtered) {
        figures.filters.extend((0..6).filter_map(|channel| filter(recording, signal, channel)));
    }
    for signal in recording.signals_of(PoseRole::Fused) {
        figures.fused.extend((0..6).filter_map(|channel| fused(recording, signal, channel)));
    }
    let mut section = Section::new("filters", "Filters and fusion", &figures)?;
    if figures.filters.is_empty() && figures.fused.is_empty() {
        let sentence =
            "The session has no filter with recorded measurements and no fused track that have a truth.";
        return Ok(section.nothing(sentence));
    }
    section.blocks.push(Block::Text(format!(
        "Variances of the errors about their mean, without the first {:.0} s of each track.",
        figures.settling_s
    )));
    if !figures.filters.is_empty() {
        section.blocks.push(Block::Table(filter_table(&figures.filters)));
        section.blocks.push(Block::Table(lag_table(&figures.filters)));
    }
    if !figures.fused.is_empty() {
        section.blocks.push(Block::Table(fused_table(&figures.fused)));
    }
    Ok(section)
}

/// The states of a signal once it has settled.
fn settled(signal: &Signal) -> &[State] {
    let states = signal.states.items();
    let begin = states.first().map_or(0, |s| s.origin.saturating_add(SETTLING));
    &states[states.partition_point(|s| s.origin < begin)..]
}

/// The settled states of a fused track at the times of measurements. Between them it knows only what has arrived, and
/// cannot be compared with a filter that has everything.
fn at_measurements(signal: &Signal) -> Vec<State> {
    settled(signal).iter().filter(|s| s.standing == Standing::Measured).copied().collect()
}

fn errors(recording: &Recording<'_>, signal: &Signal, channel: usize) -> Option<Vec<f64>> {
    let truth = recording.truth_of(signal)?;
    let found = compare(&Truth::of(truth), settled(signal));
    let errors: Vec<f64> = found.errors(channel).map(|(_, e)| e).collect();
    (errors.len() > 2).then_some(errors)
}

/// The measurements that a track is made of: the raw signals upstream of it that no other track stands between.
fn measurements<'r>(recording: &'r Recording<'_>, topic: &str) -> Vec<&'r Signal> {
    let inputs = recording.wiring.producer(topic).map_or(&[][..], |(stage, _)| &stage.inputs);
    inputs.iter().filter_map(|i| recording.signals_of(PoseRole::Raw).find(|s| s.topic == *i)).collect()
}

fn follows(tracking: &Tracking, channel: usize) -> bool {
    tracking.channels & (1 << channel) != 0
}

fn filter(recording: &Recording<'_>, signal: &Signal, channel: usize) -> Option<Filter> {
    let tracking = signal.tracking.filter(|t| follows(t, channel))?;
    let raw = *measurements(recording, &signal.topic).first()?;
    let raw_variance = variance(&errors(recording, raw, channel)?)?;
    let filtered_variance = variance(&errors(recording, signal, channel)?)?;
    let mut intervals: Vec<f64> = raw
        .states
        .items()
        .windows(2)
        .map(|w| (w[1].origin - w[0].origin) as f64 * 1e-9 / raw.states.stride() as f64)
        .collect();
    intervals.sort_by(f64::total_cmp);
    let interval = quantile(&intervals, 0.5)?;
    let [position, rate] = tracking.gains[channel];
    let gains = Settled { position, rate, interval };
    Some(Filter {
        topic: signal.topic.clone(),
        measurement: raw.topic.clone(),
        channel: CHANNELS[channel],
        unit: unit(channel).0,
        raw_variance,
        filtered_variance,
        reduction: 1.0 - filtered_variance / raw_variance,
        reduction_of_white_noise: gains.noise_ratio().map(|ratio| 1.0 - ratio),
        lag_mm: gains.lag_mm().filter(|_| channel < 3),
        interval_ms: interval * 1e3,
    })
}

fn fused(recording: &Recording<'_>, signal: &Signal, channel: usize) -> Option<Fused> {
    signal.tracking.filter(|t| follows(t, channel))?;
    let truth = Truth::of(recording.truth_of(signal)?);
    let states = at_measurements(signal);
    let found = compare(&truth, &states);
    let (unit, scale) = unit(channel);
    let errors: Vec<f64> = found.errors(channel).map(|(_, e)| e).collect();
    let variance = variance(&errors).filter(|v| *v > 0.0)?;
    let claims: Vec<f64> =
        found.pairs.iter().map(|p| (p.sd[channel] * scale).powi(2)).filter(|v| v.is_finite()).collect();
    let claimed = mean(&claims)?;
    let centralised_variance = centralised(recording, signal, channel, &truth);
    Some(Fused {
        topic: signal.topic.clone(),
        channel: CHANNELS[channel],
        unit,
        estimates: errors.len(),
        variance,
        claimed,
        claimed_over_actual: claimed / variance,
        centralised_variance,
        over_centralised: centralised_variance.map(|c| variance / c),
    })
}

/// Variance of the errors of the filter that has the measurements of all sensors, at the times of the fused track. One
/// channel by itself, without a gate.
fn centralised(recording: &Recording<'_>, fused: &Signal, channel: usize, truth: &Truth<'_>) -> Option<f64> {
    let (stage, _) = recording.wiring.producer(&fused.topic)?;
    let locals: Vec<&Signal> =
        stage.inputs.iter().filter_map(|i| recording.signals.iter().find(|s| s.topic == *i)).collect();
    let tracking = locals.first()?.tracking?;
    let mut measured: Vec<&State> = Vec::new();
    for local in &locals {
        measured.extend(measurements(recording, &local.topic).first()?.states.items());
    }
    measured.sort_by_key(|s| s.origin);
    let hold = match tracking.acceleration_hold_s {
        0.0 => Hold::Step,
        seconds => Hold::Seconds(seconds),
    };
    let acceleration_sd = Vector1::new(tracking.acceleration_sd[channel]);
    let mut filter = Kalman::<1>::new(KalmanParams {
        process: ProcessNoise { acceleration_sd, hold },
        open_sd: Vector1::new(1.0),
        initial_velocity_sd: Vector1::new(0.1),
        gate: f64::INFINITY,
        horizon: u64::MAX,
    })
    .ok()?;
    let mut waiting = measured.into_iter().peekable();
    let mut estimates = Vec::new();
    for state in at_measurements(fused) {
        while let Some(z) = waiting.next_if(|z| z.origin <= state.origin) {
            let (value, sd) = (z.channels[channel], z.sd()[channel]);
            if value.is_finite() && sd.is_finite() {
                let z_here = Measurement { position: Vector1::new(value), covariance: Matrix1::new(sd * sd) };
                // Measurements of one time follow each other by a nanosecond: no time at all.
                let stamp = z.origin.max(filter.stamp().map_or(0, |last| last.saturating_add(1)));
                filter.step(stamp, Some(&z_here)).ok()?;
            }
        }
        if let Some(at) = filter.predicted_to(state.origin.max(filter.stamp().unwrap_or(0))) {
            let mut channels = [f64::NAN; 6];
            channels[channel] = at.position.x;
            estimates.push(State { channels, ..state });
        }
    }
    let found = compare(truth, &estimates);
    variance(&found.errors(channel).map(|(_, e)| e).collect::<Vec<_>>()).filter(|v| *v > 0.0)
}

fn filter_table(filters: &[Filter]) -> Table {
    let columns =
        ["filter", "of", "channel", "raw variance", "filtered", "unit", "reduction here", "of white noise"];
    let mut table = Table::new(
        "\"Reduction here\" is of the recorded errors: noise of neighbouring frames that goes together is not filtered away. \
         \"Of white noise\" is the reduction by the last gains of the filter.",
        &columns,
    );
    for f in filters {
        table.row([
            Cell::text(&f.topic),
            Cell::text(&f.measurement),
            Cell::text(f.channel),
            Cell::number(short(f.raw_variance)),
            Cell::number(short(f.filtered_variance)),
            Cell::text(format!("{}²", f.unit)),
            Cell::number(percent(f.reduction)),
            Cell::number(percent(f.reduction_of_white_noise)),
        ]);
    }
    table
}

fn lag_table(filters: &[Filter]) -> Table {
    let columns = ["filter", "channel", "interval, ms", "lag in second 1, mm", "in second 2", "in second 6"];
    let mut table = Table::new(
        format!(
            "Mean lag behind a ramp of {RAMP_MM_PER_S:.0} mm/s from rest, computed from the last gains of the filter."
        ),
        &columns,
    );
    for f in filters {
        let [first, second, sixth] = f.lag_mm.map_or([None; 3], |lag| lag.map(Some));
        table.row([
            Cell::text(&f.topic),
            Cell::text(f.channel),
            Cell::number(fixed(f.interval_ms, 2)),
            Cell::number(fixed(first, 3)),
            Cell::number(fixed(second, 3)),
            Cell::number(fixed(sixth, 3)),
        ]);
    }
    table
}

fn fused_table(fused: &[Fused]) -> Table {
    let columns = [
        "fused track",
        "channel",
        "estimates",
        "variance",
        "centralised",
        "unit",
        "over centralised",
        "claimed",
        "claimed over actual",
    ];
    let mut table = Table::new(
        "At the times of measurements. \"Centralised\" is the filter that has the measurements of all sensors, run here on \
         the recorded ones with the standard deviations that they state.",
        &columns,
    );
    for f in fused {
        table.row([
            Cell::text(&f.topic),
            Cell::text(f.channel),
            Cell::number(f.estimates.to_string()),
            Cell::number(short(f.variance)),
            Cell::number(short(f.centralised_variance)),
            Cell::text(format!("{}²", f.unit)),
            Cell::number(fixed(f.over_centralised, 3)),
            Cell::number(short(f.claimed)),
            Cell::number(fixed(f.claimed_over_actual, 3)),
        ]);
    }
    table
}
