//! The gate of the beam: when the beam was allowed, and the reasons against it.

use serde::Serialize;
use stillpoint_samples::GateReason;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::far_end::FarEnd;
use crate::judged::Judged;
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Gates, Recording};
use crate::source::Source;
use crate::statistics::for_a_line;

#[derive(Serialize)]
struct GateFigures {
    gates: Vec<Figured>,
    /// How long the beam was on at the far end, which is no longer than it was allowed.
    far_ends: Vec<BeamOn>,
}

#[derive(Serialize)]
struct BeamOn {
    topic: String,
    /// Part of the time watched.
    on: Option<f64>,
    on_s: f64,
    watched_s: f64,
}

#[derive(Serialize)]
struct Figured {
    topic: String,
    /// Fraction of the observed time in which the beam was allowed, as counted by the gate.
    open: Option<f64>,
    open_s: f64,
    watched_s: f64,
    leases: u64,
    /// How long the leases were held that ended.
    ended: usize,
    shortest_s: Option<f64>,
    median_s: Option<f64>,
    longest_s: Option<f64>,
    /// Part of the samples that name a reason against the beam.
    reasons: Vec<(&'static str, f64)>,
    /// Distances from the target by the truth, while the beam was allowed.
    judged: Option<Judged>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let gates = || recording.gates.iter().filter(|g| !g.values.items().is_empty());
    let far_ends = recording.far_ends.iter().filter_map(|far| far.reported().map(BeamOn::of)).collect();
    let figures = GateFigures {
        gates: gates().map(|g| Figured { judged: Judged::of(recording, g), ..figured(g) }).collect(),
        far_ends,
    };
    let mut section = Section::new("gate", "Beam gate", &figures)?;
    if figures.gates.is_empty() && figures.far_ends.is_empty() {
        return Ok(section.nothing("The session has no gate of a beam."));
    }
    for far in &figures.far_ends {
        section.blocks.push(Block::Text(format!(
            "{}: the beam was on at the far end for {} s of {} s ({}).",
            far.topic,
            fixed(far.on_s, 2),
            fixed(far.watched_s, 2),
            percent(far.on)
        )));
    }
    for (gate, rows) in figures.gates.iter().zip(gates()) {
        section.blocks.push(Block::Text(format!(
            "{}: the beam was allowed for {} s of {} s ({}), in {} leases{}.",
            gate.topic,
            fixed(gate.open_s, 2),
            fixed(gate.watched_s, 2),
            percent(gate.open),
            count(gate.leases),
            lengths(gate)
        )));
        section.blocks.extend(gate.judged.as_ref().map(|judged| Block::Text(reported(judged))));
        let mut table = Table::new("", &["reason against the beam", "fraction of the samples"]);
        for (reason, part) in &gate.reasons {
            table.row([Cell::text(*reason), Cell::Bar(*part, percent(*part))]);
        }
        section.blocks.push(Block::Table(table));
        section.blocks.push(chart(recording, rows));
    }
    Ok(section)
}

impl BeamOn {
    fn of(far: FarEnd) -> Self {
        Self { on: far.duty(), topic: far.topic, on_s: far.on_s, watched_s: far.watched_s }
    }
}

fn reported(judged: &Judged) -> String {
    let mm = |value: f64| fixed(value, 2);
    format!(
        "By the truth, while the beam was allowed, the judged point of the head was at most {} mm from its target (RMS {} \
         mm). The origin of the truth, {} mm from there on the same head, was at most {} mm from its own (RMS {} mm).",
        mm(judged.point_worst_mm),
        mm(judged.point_rms_mm),
        fixed(judged.apart_mm, 0),
        mm(judged.origin_worst_mm),
        mm(judged.origin_rms_mm)
    )
}

/// How long the leases were held that ended.
fn lengths(gate: &Figured) -> String {
    let seconds = |s: Option<f64>| fixed(s, 2);
    match gate.ended {
        0 => String::new(),
        1 => format!("; the lease that ended lasted {} s", seconds(gate.longest_s)),
        ended => format!(
            "; the {} leases that ended lasted {} to {} s, median {} s",
            count(ended as u64),
            seconds(gate.shortest_s),
            seconds(gate.longest_s),
            seconds(gate.median_s)
        ),
    }
}

fn figured(gates: &Gates) -> Figured {
    let items = gates.values.items();
    let part =
        |bit: u32| items.iter().filter(|(_, _, r)| r & bit != 0).count() as f64 / items.len().max(1) as f64;
    let [leases, on, watched] = gates.totals;
    let mut held: Vec<f64> = gates.held.items().iter().map(|ns| *ns as f64 * 1e-9).collect();
    held.sort_by(f64::total_cmp);
    Figured {
        topic: gates.topic.clone(),
        open: (watched > 0).then(|| on as f64 / watched as f64),
        open_s: on as f64 * 1e-9,
        watched_s: watched as f64 * 1e-9,
        leases,
        ended: held.len(),
        shortest_s: held.first().copied(),
        median_s: held.get(held.len() / 2).copied(),
        longest_s: held.last().copied(),
        reasons: GateReason::ALL
            .iter()
            .map(|(word, bit)| (*word, part(*bit)))
            .filter(|(_, p)| *p > 0.0)
            .collect(),
        judged: None,
    }
}

fn chart(recording: &Recording<'_>, gates: &Gates) -> Block {
    let items = gates.values.items().iter();
    let points: Vec<_> = items.map(|(t, on, _)| (recording.seconds(*t), f64::from(u8::from(*on)))).collect();
    let name = "beam allowed".to_owned();
    let series = vec![Series { name, points: for_a_line(&points, LINE), style: Style::Steps }];
    let chart = Chart { title: gates.topic.clone(), x: "time, s".into(), y: "1: allowed".into(), series };
    Block::Chart(chart, String::new())
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::GateElement;

    use super::*;

    #[test]
    fn leases_that_ended_have_their_lengths_and_one_that_is_held_has_none() {
        let mut gates = Gates::default();
        // On from 1 s to 3 s, from 5 s to 6 s, and from 9 s on, looked at every half second.
        for half in 0..22u64 {
            let on = |h: u64| (2..6).contains(&h) || (10..12).contains(&h) || h >= 18;
            let on_for = (0..half).filter(|h| on(*h)).count() as u64 * 500_000_000;
            let gate = GateElement {
                position_error: [0.0; 3],
                angle_error: [0.0; 3],
                position_sd: 0.0,
                angle_sd: 0.0,
                lease_ends: 0,
                well_for: 0,
                on_for,
                watched_for: half * 500_000_000,
                leases: 3,
                datagram: half,
                beam: u32::from(on(half)),
                reasons: 0,
                ended_by: 0,
                reserved: 0,
            };
            gates.take(half * 500_000_000, &gate);
        }
        let found = figured(&gates);
        assert_eq!((found.ended, found.leases), (2, 3));
        let lengths = [found.shortest_s, found.median_s, found.longest_s];
        assert_eq!(lengths, [Some(1.0), Some(2.0), Some(2.0)]);
        assert_eq!(super::lengths(&found), "; the 2 leases that ended lasted 1.00 to 2.00 s, median 2.00 s");
        assert_eq!(super::lengths(&Figured { ended: 1, ..found }), "; the lease that ended lasted 2.00 s");
        assert_eq!(super::lengths(&figured(&Gates::default())), "");
    }
}
