//! `stillpoint qa commission`

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use stillpoint_actuate::commissioning::{Found, Given, Reading, Unfound, find};
use stillpoint_actuate::operators::{CommissionParams, READINGS};
use stillpoint_actuate::sequence::{Phase, Sequence};
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::Machine;
use stillpoint_pipeline::config::quantity::si;
use stillpoint_pipeline::graph::Graph;
use stillpoint_recorder::Session;
use stillpoint_report::numbers::fixed;
use stillpoint_report::pipeline_of;
use stillpoint_samples::{Diagnostics, Pieces};

use crate::columns::{Columns, Side};
use crate::commands::run::{Clock, Run};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::out_folder::OutFolder;
use crate::pipeline_file::PipelineFile;
use crate::recorded::with_topics;

/// The kind of the operator that makes the sequence.
const KIND: &str = "actuate.commission";
/// Time from the start of a run to the begin of its sequence, and after its end, ns.
const AROUND: u64 = 5_000_000_000;
/// Name of the file with the parameters.
const PARAMETERS: &str = "valves.yaml";

/// Find dead bands, volumes, supply and leaks of valves and bladders by a guided sequence.
///
/// The pipeline has an operator `actuate.commission`, as `examples/commission.yaml` does. The sequence begins when a person
/// arms it. It fills, holds and pulses one bladder after the other over the far end, by the pressures that the far end
/// measures. Then the command fits the parameters of each bladder, prints them, and writes those of `actuate.valves` as YAML.
/// It exits with 1 and names the cause if a bladder cannot be told: a valve that moves nothing, or a leak that is too large.
#[derive(Args)]
pub struct Commission {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Judge this session in place of a run.
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["file", "sets", "clock"])]
    session: Option<PathBuf>,
    /// Which clock decides when activations happen; a far end of hardware needs a live run.
    #[arg(long, value_enum, default_value = "live")]
    clock: Clock,
    /// Diameter of the orifice of a valve, from its data sheet: pressures alone give only its ratio to the volume.
    #[arg(long, value_name = "LENGTH", default_value = "1 mm")]
    orifice: String,
    /// Discharge coefficient of the orifice.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.8)]
    discharge: f64,
    /// Pressure of the vacuum below that of the room: a choked outlet does not tell it.
    #[arg(long, value_name = "PRESSURE", default_value = "12 psi")]
    vacuum: String,
    /// Pressure above that of the room at which a bladder has twice its volume: pulses show how much air the pressure takes,
    /// and the volume is the one that gives this with `doubles_at`.
    #[arg(long, value_name = "PRESSURE", default_value = "50 kPa")]
    doubles_at: String,
    /// Largest leak that is accepted, as the diameter of a hole.
    #[arg(long, value_name = "LENGTH", default_value = "0.2 mm")]
    leak_limit: String,
    /// Folder of the session and of the parameters.
    #[arg(long, value_name = "FOLDER", default_value = "commissioned")]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What was found of a bladder, in the units of the table.
#[derive(Serialize)]
struct Row {
    bladder: usize,
    found: Option<Values>,
    /// Why nothing was found.
    unfound: Option<String>,
}

#[derive(Clone, Copy, Serialize)]
struct Values {
    /// Of inlet and outlet.
    dead_band: [f64; 2],
    volume_l: f64,
    /// How much air a rise of the pressure takes.
    mg_per_kpa: f64,
    supply_kpa: f64,
    /// Diameter of a hole; 0 if none is seen.
    leak_mm: f64,
    /// Smallest leak that would have been seen.
    least_leak_mm: f64,
    /// What the model leaves of the pressures.
    residual_kpa: f64,
    pulses: usize,
}

impl From<Found> for Values {
    fn from(found: Found) -> Self {
        Self {
            dead_band: found.dead_band,
            volume_l: found.bladder.volume * 1e3,
            mg_per_kpa: (found.bladder.mass(found.pressure + 500.0)
                - found.bladder.mass(found.pressure - 500.0))
                * 1e6,
            supply_kpa: found.supply * 1e-3,
            leak_mm: found.leak * 1e3,
            least_leak_mm: found.least_leak * 1e3,
            residual_kpa: found.residual * 1e-3,
            pulses: found.pulses,
        }
    }
}

impl Commission {
    /// Executes the subcommand.
    pub fn execute(self, registry: &Registry) -> Ended {
        let number = |option: &str, text: &str, unit: &str| {
            si(text.trim(), unit)
                .map_err(|e| Failure::wrong(format!("{option} {text}: {}; {}", e.message, e.help)))
                .and_then(|value| match value > 0.0 {
                    true => Ok(value),
                    false => Err(Failure::wrong(format!("{option} {text}: give a number above 0"))),
                })
        };
        if !(self.discharge > 0.0 && self.discharge <= 1.0) {
            return Err(Failure::wrong(format!(
                "--discharge {}: give a number above 0, up to 1",
                self.discharge
            )));
        }
        let given = Given {
            orifice: number("--orifice", &self.orifice, "m")?,
            discharge: self.discharge,
            vacuum: number("--vacuum", &self.vacuum, "Pa")?,
            doubles_at: number("--doubles-at", &self.doubles_at, "Pa")?,
            largest_leak: number("--leak-limit", &self.leak_limit, "m")?,
        };
        let (session, graph) = match &self.session {
            Some(session) => {
                let opened = with_topics(Session::open_any(session), session)?;
                (session.clone(), pipeline_of(&opened, registry)?.0)
            }
            None => match self.run(registry)? {
                Ok(done) => done,
                Err(exit) => return Ok(exit),
            },
        };
        let (topic, params) = commissioned(&graph)?;
        let readings = readings(&session, &topic, params.bladders as usize)?;
        let rows: Vec<Row> = readings
            .iter()
            .enumerate()
            .map(|(bladder, readings)| row(bladder, find(readings, &given)))
            .collect();
        let found: Vec<Values> = rows.iter().filter_map(|row| row.found).collect();
        let is_whole = found.len() == rows.len();
        let yaml = if is_whole { Some(self.yaml(&found, &given)?) } else { None };
        let path = yaml.as_ref().map(|yaml| OutFolder::ready(&self.out)?.put(PARAMETERS, yaml.as_bytes()));
        let path = path.transpose()?;
        if self.json {
            print_json(&serde_json::json!({ "session": session, "bladders": rows, "parameters": path }))?;
        } else {
            print(&rows);
            match &path {
                Some(path) => outln!("parameters of `actuate.valves`: {}", path.display()),
                None => outln!("no parameters are written, because not every bladder is found"),
            }
        }
        Ok(if is_whole { Exit::Done } else { Exit::Failed })
    }

    /// Runs the sequence; the outer result is a failure, the inner one a pipeline that was refused.
    fn run(&self, registry: &Registry) -> Result<Result<(PathBuf, Graph), Exit>, Failure> {
        let machine = if self.clock == Clock::Live { Machine::here() } else { Machine::any() };
        let checked = match self.pipeline.check(registry, &machine) {
            Ok(checked) => checked,
            Err(refused) => return refused.end(self.json).map(Err),
        };
        let (_, params) = commissioned(&checked.graph)?;
        let length = (Sequence::longest(&params.sequence()) * 1e9) as u64 + AROUND;
        if !self.json {
            errln!("stillpoint: the sequence takes up to {} s of session time", length / 1_000_000_000);
        }
        let run = Run::recording(self.out.join("sessions"), self.clock, self.json);
        let (session, report) = run.record_checked(registry, &checked, length)?;
        match report.ended_early {
            Some(why) => Err(Failure::failed(format!("{}: the run ended early: {why}", session.display()))),
            None => Ok(Ok((session, (*checked.graph).clone()))),
        }
    }

    /// The parameters of `actuate.valves`, which takes one dead band and one volume for all bladders: the smallest dead band,
    /// because valves that open sooner than counted let more air pass, and the means of the rest.
    fn yaml(&self, found: &[Values], given: &Given) -> Result<String, Failure> {
        let mean = |of: fn(&Values) -> f64| found.iter().map(of).sum::<f64>() / found.len().max(1) as f64;
        let dead = found.iter().flat_map(|v| v.dead_band).fold(f64::INFINITY, f64::min).clamp(0.0, 0.5);
        Ok(format!(
            "# Found by `stillpoint qa commission`: `params` of `actuate.valves`. The orifice, `doubles_at` and the vacuum were\n\
             # given; the volume counts relative to them.\n\
             dead_band: {dead:.3}\n\
             pressure:\n\
             \x20 volume: {:.3} l\n\
             \x20 doubles_at: {:.1} kPa\n\
             \x20 supply: {:.1} kPa\n\
             \x20 orifice: {:.3} mm\n\
             \x20 discharge: {}\n\
             \x20 vacuum: {:.1} kPa\n",
            mean(|v| v.volume_l),
            given.doubles_at * 1e-3,
            mean(|v| v.supply_kpa),
            given.orifice * 1e3,
            given.discharge,
            given.vacuum * 1e-3,
        ))
    }
}

/// The topic of the readings, and the parameters of the sequence.
fn commissioned(graph: &Graph) -> Result<(String, CommissionParams), Failure> {
    let node = graph.operators.iter().find(|node| node.stage.kind.name == KIND);
    let found = node.and_then(|node| {
        let params = node.params.value.downcast_ref::<CommissionParams>()?;
        Some((format!("{}.readings", node.name), params.clone()))
    });
    found.ok_or_else(|| {
        Failure::wrong(format!(
            "the pipeline has no `{KIND}`: give one as `examples/commission.yaml`, with the key and the links of your far end"
        ))
    })
}

/// The readings of each bladder.
fn readings(path: &Path, topic: &str, bladders: usize) -> Result<Vec<Vec<Reading>>, Failure> {
    let session = with_topics(Session::open_any(path), path)?;
    let mut readings = vec![Vec::new(); bladders];
    let mut last = Phase::Waiting as u32;
    for recorded in session.samples_where(|t| t.name == topic) {
        let recorded = recorded.map_err(Failure::failed)?;
        let pieces = Pieces::split(<Diagnostics as stillpoint_samples::Sample>::KIND, &recorded.sample);
        let view = pieces.and_then(|p| p.view::<Diagnostics>()).map_err(Failure::failed)?;
        let value =
            |name: &str| view.elements.iter().find(|m| m.name() == name).map_or(f64::NAN, |m| m.value);
        let [phase, bladder, inlet, outlet, pressure] = READINGS.map(value);
        last = phase as u32;
        let phase = match last {
            1 => Phase::Settling,
            2 => Phase::Filling,
            3 => Phase::Holding,
            4 => Phase::Pulsing,
            _ => continue,
        };
        if let Some(of_bladder) = readings.get_mut(bladder as usize) {
            let time = view.header.stamp as f64 * 1e-9;
            of_bladder.push(Reading { time, phase, duty: [inlet, outlet], pressure });
        }
    }
    match last {
        l if l == Phase::Waiting as u32 => Err(Failure::failed(format!(
            "{}: the sequence did not begin: arm it by `stillpoint send console.arm`, and have the far end acknowledge with \
             measured pressures",
            path.display()
        ))),
        l if l == Phase::Stopped as u32 => Err(Failure::failed(format!(
            "{}: the sequence stopped: a pressure was above `limit`, the far end was silent, or a person disarmed it",
            path.display()
        ))),
        _ => Ok(readings),
    }
}

fn row(bladder: usize, found: Result<Found, Unfound>) -> Row {
    match found {
        Ok(found) => Row { bladder, found: Some(found.into()), unfound: None },
        Err(why) => Row { bladder, found: None, unfound: Some(why.to_string()) },
    }
}

fn print(rows: &[Row]) {
    let names = ["dead bands in, out", "volume", "air for a kPa", "supply", "leak", "left over"];
    let mut table = Columns::new(
        std::iter::once((Side::Left, "bladder")).chain(names.into_iter().map(|name| (Side::Right, name))),
    );
    for row in rows {
        let Some(v) = &row.found else { continue };
        let [inlet, outlet] = v.dead_band.map(|d| fixed(d, 3));
        let leak = match v.leak_mm > 0.0 {
            true => format!("{} mm", fixed(v.leak_mm, 3)),
            false => format!("none of {} mm", fixed(v.least_leak_mm, 3)),
        };
        table.row([
            row.bladder.to_string(),
            format!("{inlet}, {outlet}"),
            format!("{} l", fixed(v.volume_l, 3)),
            format!("{} mg", fixed(v.mg_per_kpa, 1)),
            format!("{} kPa", fixed(v.supply_kpa, 1)),
            leak,
            format!("{} kPa", fixed(v.residual_kpa, 2)),
        ]);
    }
    if rows.iter().any(|row| row.found.is_some()) {
        out!("{table}");
    }
    for row in rows {
        if let Some(why) = &row.unfound {
            outln!("bladder {}: {why}", row.bladder);
        }
    }
}
