//! Controllers side by side: how each took its head along, what was left, and what it cost; and the gains that learn.

use serde::Serialize;
use serde_json::Value;
use stillpoint_control::response::{Response, response, steps};
use stillpoint_pipeline::session::PARAMS;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::motion::{CHANNELS, Truth, compare, unit};
use crate::numbers::{fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::ranking::{Contender, Rank, ranking, sentence};
use crate::recording::{Orders, PoseRole, Recording, Signal, TargetTrack};
use crate::source::Source;
use crate::statistics::for_a_line;
use crate::wiring::Stage;

#[derive(Serialize)]
struct ControllersFigures {
    controllers: Vec<Controller>,
    /// Where there are several: by channel, which of them was nearest to its target while that stood.
    nearest: Vec<Nearest>,
    /// The same over all channels, the nearest first.
    ranking: Vec<Rank>,
}

#[derive(Serialize)]
struct Controller {
    controller: String,
    /// Its kind, where this build knows the pipeline.
    law: Option<String>,
    target: String,
    estimate: String,
    /// What is compared with the target: a truth, else the estimate.
    truth: Option<String>,
    /// What the person does on its rig, and the seed of that.
    person: Option<String>,
    /// Valves that were open, on average.
    valves_open: f64,
    /// Part of the orders in which a valve was asked for more than there is.
    saturated: f64,
    channels: Vec<Answer>,
}

/// A channel, in mm or degrees.
#[derive(Clone, Debug, Serialize)]
struct Answer {
    channel: &'static str,
    unit: &'static str,
    /// Root mean square of the distance from the target, over the whole session.
    rms: f64,
    /// The same, and the greatest, over the second half of each time for which the target stood.
    rms_held: Option<f64>,
    worst_held: Option<f64>,
    /// Root mean square of the distance from the reference model, where the law says it.
    rms_model: Option<f64>,
    /// The answer to the largest step.
    step: Option<Response>,
}

#[derive(Serialize)]
struct Nearest {
    channel: &'static str,
    controller: String,
    rms_held: f64,
}

/// A controller with what it acts on.
struct Loop<'r> {
    stage: &'r Stage,
    orders: &'r Orders,
    target_track: &'r TargetTrack,
    estimate: &'r Signal,
    truth: Option<&'r Signal>,
}

/// One channel of a loop over time, s, counted from where the target first was.
struct Approach {
    target: Vec<(f64, f64)>,
    value: Vec<(f64, f64)>,
    /// The reference model, where the law says it.
    model: Vec<(f64, f64)>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let loops: Vec<Loop<'_>> =
        recording.wiring.stages().iter().filter_map(|s| controller(recording, s)).collect();
    let (mut controllers, mut charts) = (Vec::new(), Vec::new());
    let ways: Vec<[Option<Approach>; 6]> = loops.iter().map(|l| ways(recording, l)).collect();
    for (of, ways) in loops.iter().zip(&ways) {
        let answers = ways.iter().enumerate().filter_map(|(channel, approach)| {
            approach.as_ref().and_then(|approach| answer(channel, approach, recording.length()))
        });
        controllers.push(figures(from, of, answers.collect()));
    }
    let nearest = CHANNELS.iter().filter_map(|channel| nearest(channel, &controllers)).collect();
    let contenders: Vec<Contender> = controllers.iter().map(contender).collect();
    let figures = ControllersFigures { controllers, nearest, ranking: ranking(&contenders) };
    let mut section = Section::new("controllers", "Controllers", &figures)?;
    if figures.controllers.is_empty() {
        return Ok(section.nothing("The session has no controller with a target, an estimate and duties."));
    }
    section.blocks.push(Block::Text(
        "Truth less target where there is a truth, else estimate less target, at the times of the estimates. \"Held\" is \
         the second half of each time for which the target stood. Rise, settling and overshoot are of the largest step."
            .into(),
    ));
    section.blocks.push(Block::Table(efforts(&figures.controllers)));
    section.blocks.push(Block::Table(answers(&figures.controllers)));
    if !figures.nearest.is_empty() {
        let sentence = figures.nearest.iter().map(|n| format!("{} {}", n.channel, n.controller));
        let sentence = sentence.collect::<Vec<_>>().join(", ");
        section
            .blocks
            .push(Block::Text(format!("Smallest error while the target was constant: {sentence}.")));
    }
    section.blocks.extend(sentence(&figures.ranking, &contenders).map(Block::Text));
    charts.extend((0..6).filter_map(|channel| side_by_side(&loops, &ways, channel)));
    charts.extend(loops.iter().filter_map(|l| gains(recording, l.stage)));
    section.blocks.extend(charts);
    Ok(section)
}

/// A stage that makes duties out of a target and an estimate, all of which were recorded.
fn controller<'r>(recording: &'r Recording<'_>, stage: &'r Stage) -> Option<Loop<'r>> {
    let orders = recording.duties.iter().find(|d| stage.outputs.contains(&d.topic))?;
    let target_track = recording.targets.iter().find(|t| stage.inputs.contains(&t.topic))?;
    let is_estimate = |s: &&Signal| stage.inputs.contains(&s.topic) && s.part != PoseRole::Truth;
    let estimate = recording.signals.iter().find(is_estimate)?;
    if orders.values.items().is_empty() || estimate.states.items().is_empty() {
        return None;
    }
    Some(Loop { stage, orders, target_track, estimate, truth: recording.truth_of(estimate) })
}

/// The channels that the target holds: target and truth, in mm and degrees.
fn ways(recording: &Recording<'_>, of: &Loop<'_>) -> [Option<Approach>; 6] {
    let target_track = of.target_track.values.items();
    let found = of.truth.map(|truth| compare(&Truth::of(truth), of.estimate.states.items()));
    std::array::from_fn(|channel| {
        let scale = unit(channel).1;
        let target = target_track.iter().filter(|(_, all)| all[channel].is_finite());
        let mut target: Vec<(f64, f64)> =
            target.map(|(t, all)| (recording.seconds(*t), all[channel] * scale)).collect();
        let (begin, start) = *target.first()?;
        let states = of.estimate.states.items().iter();
        let at = |origin: u64| -> Option<f64> {
            // The truth as the estimate would have it without its error.
            let Some(found) = &found else { return Some(0.0) };
            let place = found.pairs.binary_search_by_key(&origin, |p| p.origin).ok()?;
            Some(found.pairs[place].error[channel])
        };
        let value = states.filter_map(|s| {
            let value = (s.channels[channel] - at(s.origin)?) * scale - start;
            Some((recording.seconds(s.origin), value))
        });
        let value: Vec<_> = value.filter(|(t, v)| *t >= begin && v.is_finite()).collect();
        target.iter_mut().for_each(|(_, v)| *v -= start);
        let model = model(recording, of.stage, channel).into_iter().map(|(t, v)| (t, v - start)).collect();
        (!value.is_empty()).then_some(Approach { target, value, model })
    })
}

/// Where the reference model of a law was, as its diagnostics say: in the frame of its estimate.
fn model(recording: &Recording<'_>, stage: &Stage, channel: usize) -> Vec<(f64, f64)> {
    let name = format!("model_{}_{}", CHANNELS[channel], if channel < 3 { "m" } else { "rad" });
    let metrics = recording.metrics.iter().find(|m| stage.outputs.contains(&m.topic));
    let values = metrics.and_then(|m| m.values.iter().find(|(of, _)| *of == name));
    let points = values.iter().flat_map(|(_, values)| values.items());
    let known = points.filter(|(_, v)| v.is_finite());
    known.map(|(t, v)| (recording.seconds(*t), v * unit(channel).1)).collect()
}

fn answer(channel: usize, approach: &Approach, end: f64) -> Option<Answer> {
    let beyond = |from: &[(f64, f64)]| -> Vec<(f64, f64)> {
        let distance = |(time, value): &(f64, f64)| {
            let stood = from.partition_point(|(t, _)| t <= time).checked_sub(1)?;
            Some((*time, value - from[stood].1))
        };
        approach.value.iter().filter_map(distance).collect()
    };
    let rms_of = |distances: &[(f64, f64)]| rms(&distances.iter().map(|(_, d)| *d).collect::<Vec<_>>());
    let distances = beyond(&approach.target);
    let held: Vec<f64> = second_halves(&approach.target, end)
        .iter()
        .flat_map(|[from, to]| distances.iter().filter(move |(t, _)| (*from..*to).contains(t)))
        .map(|(_, d)| *d)
        .collect();
    let mut steps = steps(&approach.target, end);
    steps.sort_by(|a, b| (b.to - b.from).abs().total_cmp(&(a.to - a.from).abs()));
    Some(Answer {
        channel: CHANNELS[channel],
        unit: unit(channel).0,
        rms: rms_of(&distances)?,
        rms_model: rms_of(&beyond(&approach.model)),
        rms_held: rms(&held),
        worst_held: held.iter().map(|d| d.abs()).reduce(f64::max),
        step: steps.first().and_then(|step| response(*step, &approach.value)),
    })
}

/// The second half of each time for which a target stood.
fn second_halves(target: &[(f64, f64)], end: f64) -> Vec<[f64; 2]> {
    let mut changes: Vec<(f64, f64)> = target.to_vec();
    changes.dedup_by_key(|(_, value)| *value);
    let ends = changes.iter().skip(1).map(|(t, _)| *t).chain([end]);
    changes.iter().zip(ends).map(|((from, _), to)| [f64::midpoint(*from, to), to]).collect()
}

fn rms(values: &[f64]) -> Option<f64> {
    let squares: f64 = values.iter().map(|v| v * v).sum();
    (!values.is_empty()).then(|| (squares / values.len() as f64).sqrt())
}

fn figures(from: &Source<'_>, of: &Loop<'_>, channels: Vec<Answer>) -> Controller {
    let orders = of.orders.values.items();
    let count = orders.len().max(1) as f64;
    let graph = from.pipeline.as_ref().ok().map(|(graph, _)| graph);
    let law = graph.and_then(|graph| graph.operators.iter().find(|o| o.name == of.stage.name));
    let open = |o: &crate::recording::Order| o.duty.iter().map(|d| f64::from(*d)).sum::<f64>();
    Controller {
        controller: of.stage.name.clone(),
        law: law.map(|o| o.stage.kind.name.to_owned()),
        target: of.target_track.topic.clone(),
        estimate: of.estimate.topic.clone(),
        truth: of.truth.map(|t| t.topic.clone()),
        person: of.truth.and_then(|t| person(&from.recording, &t.topic)),
        valves_open: orders.iter().map(open).sum::<f64>() / count,
        saturated: orders.iter().filter(|o| o.saturated != 0).count() as f64 / count,
        channels,
    }
}

/// What the person does on the rig that has this truth, as its parameters say.
fn person(recording: &Recording<'_>, truth: &str) -> Option<String> {
    let params = recording.session.attachments().get(PARAMS)?;
    let params: Value = serde_json::from_slice(&params.bytes).ok()?;
    let rig = &params[&recording.wiring.producer(truth)?.0.name];
    let plain = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let (motion, seed) = (rig.get("motion")?, rig.get("seed")?);
    Some(format!("{}, seed {}", plain(motion), plain(seed)))
}

fn nearest(channel: &&'static str, controllers: &[Controller]) -> Option<Nearest> {
    let held = controllers.iter().filter_map(|c| {
        let rms = c.channels.iter().find(|a| a.channel == *channel)?.rms_held?;
        Some((c, rms))
    });
    let held: Vec<_> = held.collect();
    let (c, rms_held) = *held.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (held.len() > 1).then(|| Nearest { channel, controller: c.controller.clone(), rms_held })
}

fn contender(c: &Controller) -> Contender {
    let held = c.channels.iter().filter_map(|a| Some((a.unit == "mm", a.rms_held?)));
    Contender {
        controller: c.controller.clone(),
        law: c.law.clone(),
        person: c.person.clone(),
        held: held.collect(),
    }
}

fn efforts(controllers: &[Controller]) -> Table {
    let columns = ["controller", "law", "person", "compared with", "valves open", "saturated"];
    let mut table = Table::new("Inputs of each controller, and its average number of open valves.", &columns);
    for c in controllers {
        table.row([
            Cell::text(&c.controller),
            Cell::text(c.law.as_deref().unwrap_or("")),
            Cell::text(c.person.as_deref().unwrap_or("")),
            Cell::text(c.truth.as_ref().unwrap_or(&c.estimate)),
            Cell::number(fixed(c.valves_open, 3)),
            Cell::Bar(c.saturated, percent(c.saturated)),
        ]);
    }
    table
}

fn answers(controllers: &[Controller]) -> Table {
    let columns = [
        "channel",
        "controller",
        "rise, s",
        "settling, s",
        "overshoot",
        "left",
        "rms",
        "rms held",
        "worst held",
        "rms from model",
        "unit",
    ];
    let mut table = Table::new("Comparison by channel.", &columns);
    for channel in CHANNELS {
        let rows = controllers.iter().flat_map(|c| c.channels.iter().map(move |a| (c, a)));
        for (c, a) in rows.filter(|(_, a)| a.channel == channel) {
            let n = |v: Option<f64>, digits| Cell::number(fixed(v, digits));
            table.row([
                Cell::text(a.channel),
                Cell::text(&c.controller),
                n(a.step.and_then(|s| s.rise_s), 2),
                n(a.step.and_then(|s| s.settling_s), 2),
                n(a.step.map(|s| s.overshoot), 3),
                n(a.step.map(|s| s.left), 3),
                n(Some(a.rms), 3),
                n(a.rms_held, 3),
                n(a.worst_held, 3),
                n(a.rms_model, 3),
                Cell::text(a.unit),
            ]);
        }
    }
    table
}

/// All loops in one channel, as figure 4.11 has it.
fn side_by_side(loops: &[Loop<'_>], ways: &[[Option<Approach>; 6]], channel: usize) -> Option<Block> {
    let unit = unit(channel).0;
    let all = || loops.iter().zip(ways).filter_map(|(of, ways)| Some((of, ways[channel].as_ref()?)));
    let mut series: Vec<Series> = all()
        .map(|(of, approach)| Series {
            name: of.stage.name.clone(),
            points: for_a_line(&approach.value, LINE),
            style: Style::Line,
        })
        .collect();
    series.extend(all().filter(|(_, approach)| !approach.model.is_empty()).map(|(of, approach)| Series {
        name: format!("reference model of {}", of.stage.name),
        points: for_a_line(&approach.model, LINE),
        style: Style::Dashed,
    }));
    let (_, approach) = all().next()?;
    series.push(Series {
        name: "target".to_owned(),
        points: for_a_line(&approach.target, LINE),
        style: Style::Steps,
    });
    let chart = Chart {
        title: format!("{} under control", CHANNELS[channel]),
        x: "time, s".into(),
        y: format!("{} from the start, {unit}", CHANNELS[channel]),
        series,
    };
    Some(Block::Chart(chart, String::new()))
}

/// The gains that a law learns, where it says them.
fn gains(recording: &Recording<'_>, stage: &Stage) -> Option<Block> {
    let metrics = recording.metrics.iter().find(|m| stage.outputs.contains(&m.topic))?;
    let learned = metrics.values.iter().filter(|(name, _)| name.starts_with("gain_"));
    let series: Vec<Series> = learned
        .map(|(name, values)| {
            let points: Vec<_> = values.items().iter().map(|(t, v)| (recording.seconds(*t), *v)).collect();
            Series { name: name.clone(), points: for_a_line(&points, LINE), style: Style::Line }
        })
        .collect();
    let chart = Chart {
        title: format!("Adaptive gains of {}", stage.name),
        x: "time, s".into(),
        y: "norm, full duties per scale".into(),
        series,
    };
    let sentence = "Norms of the gains over pose, target and features.".to_owned();
    (!chart.series.is_empty()).then_some(Block::Chart(chart, sentence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_held_is_the_second_half_of_each_time_for_which_the_target_stood() {
        let target = [(0.0, 0.0), (1.0, 0.0), (4.0, 2.0), (5.0, 2.0)];
        assert_eq!(second_halves(&target, 10.0), [[2.0, 4.0], [7.0, 10.0]]);
        let value = (0..100).map(|k| 0.1 * f64::from(k));
        let value = value.map(|t| (t, if t < 3.0 { 1.0 } else { 2.5 })).collect();
        // From 5 s on there is a model, a half above the head.
        let model = vec![(5.0, 3.0)];
        let found = answer(2, &Approach { target: target.to_vec(), value, model }, 10.0).unwrap();
        // From 2 s to 3 s one off, to 4 s two and a half, from 7 s to 10 s a half.
        let squares = 10.0 + 10.0 * 6.25 + 30.0 * 0.25;
        assert!((found.rms_held.unwrap() - f64::sqrt(squares / 50.0)).abs() < 1e-9, "{found:?}");
        assert_eq!((found.worst_held, found.unit), (Some(2.5), "mm"));
        assert!((found.step.unwrap().left - 0.5).abs() < 1e-9);
        assert!((found.rms_model.unwrap() - 0.5).abs() < 1e-9, "{found:?}");
        assert_eq!(second_halves(&[], 1.0), [] as [[f64; 2]; 0]);
    }
}
