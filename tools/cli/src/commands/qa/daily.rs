//! `stillpoint qa daily`

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use clap::Args;
use stillpoint_control::channels::Channel;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::Machine;
use stillpoint_pipeline::config::quantity::si;
use stillpoint_pipeline::graph::{Graph, OperatorNode};
use stillpoint_recorder::Session;
use stillpoint_report::numbers;
use stillpoint_report::pipeline_of;

use super::course::{Course, CourseParams};
use super::figures::{GateLimits, evaluate};
use super::readings::{Readings, Topics};
use super::record::{FileLimits, Limits, Record, Subject, VERSION, remarks, rows};
use crate::commands::run::{Clock, Run};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pipeline_file::PipelineFile;
use crate::recorded::with_topics;

/// Move a phantom by known steps and ramps, and judge the poses and the time to beam off.
///
/// In place of the head of a simulated rig lies a phantom that moves as `phantom` of the rig says: first ramps of constant
/// speed, which end the beam, then steps along and about the axes. The displacement at beam off is fitted against the speed;
/// the slope is the time from motion to beam off. The record and its page are written into a folder of records. The command
/// exits with 1 if a figure is beyond its limit. For a phantom that a person or a stage moves before a camera, record a
/// session and give it with `--session`.
#[derive(Args)]
pub struct Daily {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Judge this session in place of a run.
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["file", "sets", "clock", "repeats"])]
    session: Option<PathBuf>,
    /// The known place of the phantom in each rest of a session without a rig, in their order and the reference first, such
    /// as `--at 'z 0 mm' --at 'z 5 mm' --at 'roll 2 deg'`.
    #[arg(long = "at", value_name = "PLACE", requires = "session")]
    at: Vec<String>,
    /// Which clock decides when activations happen: only a live run measures the time that this machine needs.
    #[arg(long, value_enum, default_value = "live")]
    clock: Clock,
    /// Number of ramps at each of four speeds and in each of two directions.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=20))]
    repeats: u8,
    /// Largest error of a position at rest: 1 mm for radiosurgery, 2 mm else.
    #[arg(long, value_name = "LENGTH", default_value = "1 mm")]
    position_limit: String,
    /// Largest error of an angle at rest.
    #[arg(long, value_name = "ANGLE", default_value = "0.5 deg")]
    angle_limit: String,
    /// Longest time from motion to beam off.
    #[arg(long, value_name = "TIME", default_value = "100 ms")]
    latency_limit: String,
    /// Folder of the records.
    #[arg(long, value_name = "FOLDER", default_value = "qa")]
    out: PathBuf,
    /// Print the record as JSON.
    #[arg(long)]
    json: bool,
}

impl Daily {
    /// Executes the subcommand.
    pub fn execute(self, registry: &Registry) -> Ended {
        let limit = |option: &str, text: &str, unit: &str| {
            si(text.trim(), unit)
                .map_err(|e| Failure::wrong(format!("{option} {text}: {}; {}", e.message, e.help)))
                .and_then(|value| match value > 0.0 {
                    true => Ok(value),
                    false => Err(Failure::wrong(format!("{option} {text}: give a limit above 0"))),
                })
        };
        let limits = Limits {
            position_m: limit("--position-limit", &self.position_limit, "m")?,
            angle_rad: limit("--angle-limit", &self.angle_limit, "rad")?,
            latency_s: limit("--latency-limit", &self.latency_limit, "s")?,
            gate: None,
        };
        let declared = self.at.iter().map(|text| place(text)).collect::<Result<Vec<_>, _>>()?;
        let (session, graph, subject) = match &self.session {
            Some(session) => self.recorded(session, registry)?,
            None => match self.run(registry)? {
                Ok(done) => done,
                Err(exit) => return Ok(exit),
            },
        };
        let limits = Limits { gate: file_limits(&graph), ..limits };
        let opened = with_topics(Session::open_any(&session), &session)?;
        let readings = Readings::of(&opened, &Topics::of(&graph)?)?;
        // Without a gate no time is judged.
        let beyond = limits.gate.map_or(GateLimits { position: f64::MAX, angle: f64::MAX }, |file| file.gate);
        let declared = (!declared.is_empty()).then_some(declared.as_slice());
        let figures = evaluate(&readings, &beyond, declared)
            .map_err(|e| Failure::failed(format!("{}: {e}", session.display())))?;
        let rows = rows(&figures, &limits, subject.ramps_made);
        let record = Record {
            version: VERSION,
            date: now(),
            program: format!("stillpoint {}", env!("CARGO_PKG_VERSION")),
            subject,
            passed: rows.iter().all(|row| row.passed),
            rows,
            remarks: match limits.gate {
                Some(_) => remarks(&figures, &readings.against),
                None => vec!["the pipeline has no `gate.beam`, so no time to beam off is judged".to_owned()],
            },
            limits,
            figures,
        };
        let path = record.write(&self.out)?;
        if self.json {
            print_json(&record)?;
        } else {
            record.print();
            outln!("record: {}", path.display());
        }
        Ok(if record.passed { Exit::Done } else { Exit::Failed })
    }

    fn recorded(&self, session: &Path, registry: &Registry) -> Result<(PathBuf, Graph, Subject), Failure> {
        let opened = with_topics(Session::open_any(session), session)?;
        let (graph, _) = pipeline_of(&opened, registry)?;
        let subject = Subject {
            pipeline: graph.name.clone(),
            file: session.display().to_string(),
            session: session.display().to_string(),
            clock: "recorded".into(),
            simulated: simulated(&graph, false),
            not_included: not_included(&graph),
            ramps_made: None,
        };
        Ok((session.to_owned(), graph, subject))
    }

    /// Runs the pipeline with a phantom; the outer result is a failure, the inner one a pipeline that was refused.
    fn run(&self, registry: &Registry) -> Result<Result<(PathBuf, Graph, Subject), Exit>, Failure> {
        let is_live = self.clock == Clock::Live;
        let checked = match self.pipeline.check(registry, &Machine::any()) {
            Ok(checked) => checked,
            Err(refused) => return refused.end(self.json).map(Err),
        };
        let topics = Topics::of(&checked.graph)?;
        let Some(rig) = rig(&checked.graph) else {
            return Err(Failure::wrong(
                "the pipeline has no simulated rig, so a person or a stage moves the phantom: record a session of it by \
                 `stillpoint run`, and give the session with `--session`",
            ));
        };
        let course = course(&checked.graph, rig, usize::from(self.repeats));
        let mut pipeline = self.pipeline.clone();
        pipeline.sets.extend(sets(&checked.graph, rig, &course, &topics));
        let machine = if is_live { Machine::here() } else { Machine::any() };
        let checked = match pipeline.check(registry, &machine) {
            Ok(checked) => checked,
            Err(refused) => return refused.end(self.json).map(Err),
        };
        let run = Run::recording(self.out.join("sessions"), self.clock, self.json);
        if !self.json {
            let seconds = course.length as f64 * 1e-9;
            errln!("stillpoint: a phantom moves for {seconds:.0} s of session time");
        }
        let (session, report) = run.record_checked(registry, &checked, course.length)?;
        if let Some(why) = report.ended_early {
            return Err(Failure::failed(format!("{}: the run ended early: {why}", session.display())));
        }
        let subject = Subject {
            pipeline: checked.graph.name.clone(),
            file: checked.source.file.display().to_string(),
            session: session.display().to_string(),
            clock: if is_live { "live" } else { "simulated" }.into(),
            simulated: simulated(&checked.graph, !is_live),
            not_included: not_included(&checked.graph),
            ramps_made: Some(course.ramps),
        };
        Ok(Ok((session, (*checked.graph).clone(), subject)))
    }
}

fn of_kind<'a>(graph: &'a Graph, kind: &str) -> Option<&'a OperatorNode> {
    graph.operators.iter().find(|node| node.stage.kind.name == kind)
}

fn rig(graph: &Graph) -> Option<&OperatorNode> {
    graph.operators.iter().find(|node| super::readings::is_rig(node.stage.kind.name))
}

/// The limits of the gate of a pipeline, if it has one.
fn file_limits(graph: &Graph) -> Option<FileLimits> {
    let params = &of_kind(graph, "gate.beam")?.params.resolved;
    let number = |value: &serde_json::Value| value.as_f64();
    let sum = |a: &str, b: &str| Some(number(&params[a])? + number(&params[b])?);
    Some(FileLimits {
        gate: GateLimits {
            position: sum("position_tolerance", "position_sd")?,
            angle: sum("angle_tolerance", "angle_sd")?,
        },
        tolerance: number(&params["position_tolerance"])?,
        off_s: 1.5e-9 * number(&params["pose"]["frame_period"])? + 0.02,
    })
}

/// The course for a pipeline: ramps along the first of z, x and y that its target holds.
fn course(graph: &Graph, rig: &OperatorNode, repeats: usize) -> Course {
    let channels = of_kind(graph, "control.target").map(|node| node.params.resolved["channels"].clone());
    let holds = |name: &str| {
        channels.as_ref().and_then(|c| c.as_array()).is_some_and(|c| c.iter().any(|c| c == name))
    };
    let axis =
        [(2, "z"), (0, "x"), (1, "y")].into_iter().find(|(_, name)| holds(name)).map_or(2, |(axis, _)| axis);
    let frame = rig.params.resolved["camera"]["every"].as_u64().or(rig.every).unwrap_or(100_000_000);
    let repeats = if of_kind(graph, "gate.beam").is_some() { repeats } else { 0 };
    let file = file_limits(graph);
    let limit = file.map_or(1e-3, |file| file.gate.position);
    let tolerance = file.map_or(1e-3, |file| file.tolerance);
    Course::new(&CourseParams { axis, tolerance, limit, frame, repeats })
}

/// What a run with the phantom sets: the phantom, a target that stays, a script that captures, confirms and arms, and the
/// topics to be recorded.
fn sets(graph: &Graph, rig: &OperatorNode, course: &Course, topics: &Topics) -> Vec<String> {
    let mut sets = vec![
        format!("{}.phantom={}", rig.name, course.yaml()),
        format!("record.topics=[{}]", topics.all().join(", ")),
    ];
    for node in &graph.operators {
        match node.stage.kind.name {
            "control.target" => sets.push(format!("{}.moves=[]", node.name)),
            // Bladders do not move a phantom: orders without effect are no fault here.
            "actuate.valves" => sets.push(format!("{}.answer.effect_patience=10 min", node.name)),
            "console" if of_kind(graph, "gate.beam").is_some() => sets.push(format!(
                "{}.script=[{{ at: 500 ms, say: capture, repeat: 3 s }}, {{ at: 1 s, say: confirm, repeat: 500 ms }}, \
                 {{ at: 1500 ms, say: arm, repeat: 500 ms }}]",
                node.name
            )),
            _ => {}
        }
    }
    sets
}

/// The parts of a pipeline that are simulated.
fn simulated(graph: &Graph, is_clock_simulated: bool) -> Vec<String> {
    let mut parts = Vec::new();
    if let Some(rig) = rig(graph) {
        let kind = rig.stage.kind.name;
        parts.push(format!("the phantom and its motion ({kind})"));
        parts.push("the camera: its image is of the moment of its stamp".to_owned());
        if kind != "rig.camera" {
            parts.push("the valves and bladders, which do not move the phantom".to_owned());
        }
    }
    if is_clock_simulated {
        parts.push(
            "the clock: a step takes the `latency` that the file states, else no time; links take their `delay`"
                .to_owned(),
        );
    }
    parts
}

/// The parts whose time is not in the time to beam off.
fn not_included(graph: &Graph) -> Vec<String> {
    let camera = match rig(graph) {
        Some(_) => "exposure and transfer of a camera",
        None => "the time of the camera before the stamp of its image",
    };
    vec![camera.to_owned(), "the machine behind the far end, from its input to the radiation".to_owned()]
}

/// A place such as `z 5 mm, roll 2 deg`, m and rad.
fn place(text: &str) -> Result<[f64; 6], Failure> {
    let mut known = [0.0; 6];
    for part in text.split(',') {
        let wrong = |why: String| {
            Failure::wrong(format!("--at {text}: {why}; write places such as `z 5 mm, roll 2 deg`"))
        };
        let (name, value) =
            part.trim().split_once(' ').ok_or_else(|| wrong(format!("`{part}` has no value")))?;
        let channel = Channel::named(name).ok_or_else(|| wrong(format!("`{name}` is not a channel")))?;
        known[channel.place()] = si(value.trim(), channel.unit()).map_err(|e| wrong(e.message))?;
    }
    Ok(known)
}

/// Now, as a date and a time of day in UTC.
fn now() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    numbers::utc(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_channels_and_units() {
        let known = place("z 5 mm, roll -2 deg").unwrap();
        assert!((known[2] - 5e-3).abs() < 1e-12 && (known[4] + 2f64.to_radians()).abs() < 1e-12);
        for wrong in ["", "z", "w 1 mm", "z 5", "pitch 1 mm"] {
            let text = place(wrong).unwrap_err().text;
            assert!(text.contains("z 5 mm, roll 2 deg"), "{text}");
        }
    }
}
