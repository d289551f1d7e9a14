//! Forces of the bladders on the head, and the margins of their friction cones.

use serde::Serialize;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Recording, Touches};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};

#[derive(Serialize)]
struct ContactFigures {
    bladders: Vec<Bladder>,
}

/// The contact of a bladder, N.
#[derive(Serialize)]
struct Bladder {
    topic: String,
    /// Counted from 0, as in the parameters of a rig.
    bladder: usize,
    least_n: Option<f64>,
    force_n: Spread,
    /// Least margin of the friction cone; none where the places of the contacts are not known.
    least_margin_n: Option<f64>,
    /// Part of the samples in which it pushed with less than the least force, and in which it slid.
    low: f64,
    slides: f64,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let figures = ContactFigures { bladders: recording.contacts.iter().flat_map(bladders).collect() };
    let mut section = Section::new("contacts", "Contact forces", &figures)?;
    if figures.bladders.is_empty() {
        return Ok(section.nothing("The session has no forces of bladders on the head."));
    }
    let columns =
        ["topic", "bladder", "least, N", "median", "99 %", "greatest", "least margin, N", "low", "slides"];
    let mut table = Table::new("Force along the normal, and margin of the friction cone.", &columns);
    for b in &figures.bladders {
        let n = |v: Option<f64>| Cell::number(fixed(v, 1));
        table.row([
            Cell::text(&b.topic),
            Cell::number(b.bladder.to_string()),
            n(b.least_n),
            n(b.force_n.p50),
            n(b.force_n.p99),
            n(b.force_n.max),
            n(b.least_margin_n),
            Cell::Bar(b.low, percent(b.low)),
            Cell::Bar(b.slides, percent(b.slides)),
        ]);
    }
    section.blocks.push(Block::Table(table));
    section.blocks.extend(recording.contacts.iter().map(|touches| chart(recording, touches)));
    Ok(section)
}

fn bladders(touches: &Touches) -> Vec<Bladder> {
    let items = touches.values.items();
    let of = |bladder: usize| {
        let finite = |of: &dyn Fn(&crate::recording::Touch) -> f32| -> Vec<f64> {
            items.iter().map(|t| f64::from(of(t))).filter(|v| v.is_finite()).collect()
        };
        let part = |bits: &dyn Fn(&crate::recording::Touch) -> u32| {
            let set = items.iter().filter(|t| bits(t) & (1 << bladder) != 0).count();
            set as f64 / items.len().max(1) as f64
        };
        let (forces, margins) = (finite(&|t| t.force[bladder]), finite(&|t| t.margin[bladder]));
        Bladder {
            topic: touches.topic.clone(),
            bladder,
            least_n: forces.iter().copied().reduce(f64::min),
            force_n: Spread::of(forces),
            least_margin_n: margins.into_iter().reduce(f64::min),
            low: part(&|t| t.low),
            slides: part(&|t| t.slides),
        }
    };
    (0..touches.bladders).map(of).collect()
}

fn chart(recording: &Recording<'_>, touches: &Touches) -> Block {
    let series = (0..touches.bladders).map(|bladder| {
        let items = touches.values.items().iter();
        let points = items.map(|t| (recording.seconds(t.stamp), f64::from(t.force[bladder])));
        let points: Vec<_> = points.filter(|(_, force)| force.is_finite()).collect();
        Series { name: format!("bladder {bladder}"), points: for_a_line(&points, LINE), style: Style::Line }
    });
    let chart = Chart {
        title: format!("Forces of {}", touches.topic),
        x: "time, s".into(),
        y: "force, N".into(),
        series: series.collect(),
    };
    Block::Chart(chart, String::new())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Touch;

    #[test]
    fn the_least_force_and_margin_stand_with_the_part_of_the_time_in_which_a_bladder_is_low_or_slides() {
        let mut touches =
            Touches { topic: "contacts.contacts".to_owned(), bladders: 2, ..Touches::default() };
        for k in 0..4_u8 {
            let force = f32::from(k) + 0.5;
            touches.values.push(Touch {
                stamp: u64::from(k),
                force: [force, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                margin: [force - 1.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                low: u32::from(k == 0),
                slides: 0b10 * u32::from(k > 1),
            });
        }
        let reported = bladders(&touches);
        assert_eq!(reported.len(), 2);
        assert_eq!((reported[0].least_n, reported[0].least_margin_n), (Some(0.5), Some(-0.5)));
        assert_eq!((reported[0].low, reported[0].slides), (0.25, 0.0));
        assert_eq!(
            (reported[1].least_n, reported[1].least_margin_n, reported[1].slides),
            (Some(20.0), None, 0.5)
        );
    }
}
