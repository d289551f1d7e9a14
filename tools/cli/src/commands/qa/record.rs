//! The record of daily QA: figures against limits, as a table, as JSON and as a page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stillpoint_control::channels::{ALL, Channel};
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::html;
use stillpoint_report::numbers::fixed;
use stillpoint_report::page::{Block, Cell, Mood, Section, Table, Tile};

use super::figures::{Figures, GateLimits, Line, Step};
use crate::columns::{Columns, Side};
use crate::exit::Failure;
use crate::out_folder::OutFolder;

/// Version of the form of a record.
pub const VERSION: u32 = 1;

/// Limits that the figures are held to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Limits {
    /// Of a position at rest, m.
    pub position_m: f64,
    /// Of an angle at rest, rad.
    pub angle_rad: f64,
    /// Of the time from motion to beam off, s.
    pub latency_s: f64,
    /// Of the pipeline file, where it has a gate.
    #[serde(skip)]
    pub gate: Option<FileLimits>,
}

/// Limits that follow from the gate of the pipeline file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileLimits {
    /// Tolerances and permitted standard deviations together.
    pub gate: GateLimits,
    /// Tolerance of a position alone, m.
    pub tolerance: f64,
    /// 1.5 periods of the camera's frames and 20 ms, s.
    pub off_s: f64,
}

/// A figure and its limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the figure.
    pub name: String,
    /// The figure; none if it was not measured.
    pub value: Option<f64>,
    /// Half of its 95 % confidence interval, where it has one.
    pub half: Option<f64>,
    /// Its limit; a figure passes if its whole interval is within it.
    pub limit: f64,
    /// Unit of all three.
    pub unit: String,
    /// Where the limit comes from.
    pub source: String,
    /// Whether it passes.
    pub passed: bool,
}

impl Row {
    fn at_most(
        name: &str,
        value: Option<f64>,
        half: Option<f64>,
        limit: f64,
        unit: &str,
        source: &str,
    ) -> Self {
        let passed = value.is_some_and(|v| v + half.unwrap_or(0.0) <= limit);
        Self {
            name: name.to_owned(),
            value,
            half,
            limit,
            unit: unit.to_owned(),
            source: source.to_owned(),
            passed,
        }
    }

    fn value_text(&self) -> String {
        let half = self.half.map_or(String::new(), |half| format!(" ± {}", self.number(half)));
        match self.value {
            None => "not measured".to_owned(),
            Some(value) => format!("{}{half} {}", self.number(value), self.unit),
        }
    }

    fn number(&self, value: f64) -> String {
        fixed(value, if self.unit == "ms" || self.unit.is_empty() { 0 } else { 2 })
    }

    fn limit_text(&self) -> String {
        let relation = if self.unit.is_empty() { "at least" } else { "at most" };
        format!("{relation} {} {}", fixed(self.limit, if self.unit.is_empty() { 0 } else { 2 }), self.unit)
            .trim_end()
            .to_owned()
    }
}

/// What was run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Its file, or that of the session.
    pub file: String,
    /// The session.
    pub session: String,
    /// `live`, `simulated` or `recorded`.
    pub clock: String,
    /// Parts that are simulated.
    pub simulated: Vec<String>,
    /// Parts whose time is not in the time to beam off.
    pub not_included: Vec<String>,
    /// Number of ramps that the phantom made; none if it is not known.
    pub ramps_made: Option<usize>,
}

/// A record.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Version of this form.
    pub version: u32,
    /// Date and time of day, UTC.
    pub date: String,
    /// Program that wrote it.
    pub program: String,
    #[serde(flatten)]
    pub subject: Subject,
    /// Whether every row passes.
    pub passed: bool,
    pub rows: Vec<Row>,
    /// What explains figures that were not measured.
    pub remarks: Vec<String>,
    pub limits: Limits,
    pub figures: Figures,
}

/// The part of an earlier record that the page shows.
#[derive(Clone, Debug, Deserialize)]
struct Earlier {
    version: u32,
    date: String,
    pipeline: String,
    clock: String,
    rows: Vec<Row>,
}

const LATENCY: &str = "motion to beam off";
const OWN: &str = "this command";
const REPORTS: &str = "MPPG 9.a";
const GATING: &str = "TG-142";
const FILE: &str = "the pipeline file";

/// The figures of a session against the limits.
pub fn rows(figures: &Figures, limits: &Limits, ramps_made: Option<usize>) -> Vec<Row> {
    let most = |of: fn(&Step) -> f64, steps: &[&Step]| steps.iter().map(|s| of(s)).reduce(f64::max);
    // The first rest is the reference itself.
    let (references, steps): (Vec<&Step>, Vec<&Step>) =
        figures.steps.iter().skip(1).partition(|s| s.is_reference());
    let [mm, deg, ms] = [1e3, 1f64.to_degrees(), 1e3];
    let scaled = |value: Option<f64>, scale: f64| value.map(|v| v * scale);
    let rest = |name: &str, steps: &[&Step]| {
        let position = scaled(most(Step::distance, steps), mm);
        let angle = scaled(most(Step::angle, steps), deg);
        [
            Row::at_most(&format!("{name}: position"), position, None, limits.position_m * mm, "mm", REPORTS),
            Row::at_most(&format!("{name}: angle"), angle, None, limits.angle_rad * deg, "deg", REPORTS),
        ]
    };
    let mut rows = [rest("steps", &steps), rest("back at the reference", &references)].concat();
    let Some(file) = &limits.gate else { return rows };
    let made = ramps_made.unwrap_or(4).max(4);
    rows.push(Row {
        name: "ramps that ended the beam".into(),
        value: Some(figures.ramps.len() as f64),
        half: None,
        limit: made as f64,
        unit: String::new(),
        source: OWN.into(),
        passed: figures.ramps.len() >= made,
    });
    let of = |value: fn(&Line) -> f64, scale: f64| figures.line.as_ref().map(|line| value(line) * scale);
    rows.extend([
        Row::at_most(
            LATENCY,
            of(|l| l.slope, ms),
            of(|l| l.slope_half, ms),
            limits.latency_s * ms,
            "ms",
            GATING,
        ),
        Row::at_most(
            "limit of the gate",
            of(|l| l.intercept, mm),
            of(|l| l.intercept_half, mm),
            file.gate.position * mm,
            "mm",
            FILE,
        ),
        Row::at_most(
            "beyond the limits with beam, longest",
            Some(figures.beyond_s.iter().copied().fold(0.0, f64::max) * ms),
            None,
            file.off_s * ms,
            "ms",
            FILE,
        ),
    ]);
    rows
}

/// What the gate says where no ramp ended a beam.
pub fn remarks(figures: &Figures, against: &BTreeMap<&'static str, u64>) -> Vec<String> {
    let most = against.iter().max_by_key(|(_, count)| **count).filter(|_| figures.ramps.is_empty());
    let text = |(reason, _): (&&str, &u64)| {
        format!(
            "no ramp ended a beam; the most frequent reason of the gate against the beam is \"{reason}\": repeat the run, or \
             look into the session by `stillpoint report`"
        )
    };
    most.map(text).into_iter().collect()
}

impl Record {
    /// Prints the table.
    pub fn print(&self) {
        outln!("daily QA of {} ({}), {}", self.subject.pipeline, self.subject.clock, self.date);
        let mut table = Columns::new([
            (Side::Left, "figure"),
            (Side::Right, "found"),
            (Side::Right, "limit"),
            (Side::Left, "limit by"),
            (Side::Left, ""),
        ]);
        for row in &self.rows {
            let mark = if row.passed { "pass" } else { "fail" };
            table.row([
                row.name.clone(),
                row.value_text(),
                row.limit_text(),
                row.source.clone(),
                mark.to_owned(),
            ]);
        }
        out!("{table}");
        for (what, parts) in [
            ("simulated", &self.subject.simulated),
            ("not in the time to beam off", &self.subject.not_included),
        ] {
            parts.iter().for_each(|part| outln!("{what}: {part}"));
        }
        self.remarks.iter().for_each(|remark| outln!("{remark}"));
        outln!("{}", if self.passed { "passed" } else { "failed" });
    }

    /// Writes the record and its page into the folder, and gives the path of the record.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Failure> {
        let out = OutFolder::ready(folder)?;
        let stem = self.stem(folder);
        let mut text = serde_json::to_string_pretty(self).map_err(Failure::failed)?;
        text.push('\n');
        let earlier = earlier(folder, self);
        let path = out.put(&format!("{stem}.json"), text.as_bytes())?;
        out.put(&format!("{stem}.html"), self.page(&earlier)?.as_bytes())?;
        Ok(path)
    }

    /// The name of the files of this record: pipeline and date, with a number where the name is taken.
    fn stem(&self, folder: &Path) -> String {
        let digits: String = self.date.chars().filter(|c| c.is_ascii_digit() || *c == ' ').collect();
        let mut parts = digits.split_whitespace();
        let (day, time) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        let name = format!("daily-{}-{day}T{time}", self.subject.pipeline);
        let is_free = |stem: &String| !folder.join(format!("{stem}.json")).exists();
        (1..).map(|n| if n == 1 { name.clone() } else { format!("{name}-{n}") }).find(is_free).unwrap_or(name)
    }

    fn page(&self, earlier: &[Earlier]) -> Result<String, Failure> {
        let failed = |e: stillpoint_report::ReportError| Failure::failed(e);
        let mut limits = Table::new("figures against limits", &["figure", "found", "limit", "limit by", ""]);
        for row in &self.rows {
            let (mood, mark) = if row.passed { (Mood::Good, "pass") } else { (Mood::Bad, "fail") };
            limits.row([
                Cell::text(&row.name),
                Cell::number(row.value_text()),
                Cell::number(row.limit_text()),
                Cell::text(&row.source),
                Cell::State(mood, mark.to_owned()),
            ]);
        }
        let result = Section::new("result", "Result", &self.rows)
            .map_err(failed)?
            .with(Block::Tiles(vec![
                Tile::state("daily QA", if self.passed { "passed" } else { "failed" }, self.passed),
                Tile::plain("clock", self.subject.clock.as_str()),
            ]))
            .with(Block::Table(limits))
            .with(Block::Text(format!("Simulated: {}.", listed(&self.subject.simulated))))
            .with(Block::Text(format!(
                "Not in the time to beam off: {}.",
                listed(&self.subject.not_included)
            )));
        let page = html::page(
            &format!("Daily QA of {}", self.subject.pipeline),
            &format!("{}, {}, session {}", self.date, self.program, self.subject.session),
            &[result, self.beam_off()?, self.rest()?, self.history(earlier)?],
        );
        Ok(page)
    }

    fn beam_off(&self) -> Result<Section, Failure> {
        let section =
            Section::new("beam-off", "Motion to beam off", &self.figures.ramps).map_err(Failure::failed)?;
        let Some(line) = &self.figures.line else {
            return Ok(section.nothing("fewer than four ramps of two speeds ended the beam"));
        };
        let mut points: Vec<(f64, f64)> =
            self.figures.ramps.iter().map(|r| (r.speed.abs() * 1e3, r.displacement * 1e3)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fastest = points.last().map_or(0.0, |p| p.0);
        let ends = [0.0, fastest].map(|v| (v, line.intercept * 1e3 + line.slope * v));
        let chart = Chart {
            title: "displacement at beam off against speed".into(),
            x: "speed, mm/s".into(),
            y: "displacement, mm".into(),
            series: vec![
                Series {
                    name: format!("slope {:.0} ms", line.slope * 1e3),
                    points: ends.to_vec(),
                    style: Style::Line,
                },
                Series { name: "ramps".into(), points, style: Style::Dots },
            ],
        };
        Ok(section.with(Block::Chart(
            chart,
            "The slope is the time from motion to beam off, the intercept the limit of the gate.".into(),
        )))
    }

    fn rest(&self) -> Result<Section, Failure> {
        let headings = ALL.map(|channel| format!("{}, {}", channel.name(), shown(channel).0));
        let mut names = vec!["at, s".to_owned(), "phantom".to_owned()];
        names.extend(headings);
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut table = Table::new("errors of the mean pose at rest", &names);
        for step in &self.figures.steps {
            let mut cells = vec![Cell::number(fixed(step.at_s, 1)), Cell::text(place(&step.known))];
            cells.extend((0..6).map(|i| Cell::number(fixed(step.error[i] * shown(ALL[i]).1, 3))));
            table.row(cells);
        }
        let section = Section::new("rest", "Poses at rest", &self.figures.steps).map_err(Failure::failed)?;
        Ok(section.with(Block::Table(table)))
    }

    fn history(&self, earlier: &[Earlier]) -> Result<Section, Failure> {
        let section = Section::new("history", "Earlier records", &earlier.len()).map_err(Failure::failed)?;
        if earlier.is_empty() {
            return Ok(section.nothing("the folder has no earlier record of this pipeline and clock"));
        }
        let named = |rows: &[Row], name: &str| rows.iter().find(|r| r.name == name).cloned();
        let mut table = Table::new("records of this pipeline and clock", &["date", LATENCY, ""]);
        let mut points = Vec::new();
        let all = earlier.iter().map(|e| (&e.date, &e.rows)).chain([(&self.date, &self.rows)]);
        for (number, (date, rows)) in all.enumerate() {
            let passed = rows.iter().all(|row| row.passed);
            let latency = named(rows, LATENCY);
            let (mood, mark) = if passed { (Mood::Good, "pass") } else { (Mood::Bad, "fail") };
            let text = latency.as_ref().map_or("–".to_owned(), Row::value_text);
            table.row([Cell::text(date), Cell::number(text), Cell::State(mood, mark.to_owned())]);
            points.extend(latency.and_then(|row| row.value).map(|value| (number as f64 + 1.0, value)));
        }
        let chart = Chart {
            title: format!("{LATENCY} over the records"),
            x: "record".into(),
            y: "ms".into(),
            series: vec![Series { name: LATENCY.into(), points, style: Style::Dots }],
        };
        Ok(section.with(Block::Chart(chart, String::new())).with(Block::Table(table)))
    }
}

/// Earlier records of the folder about the same pipeline and clock, by date. Other files are passed over.
fn earlier(folder: &Path, record: &Record) -> Vec<Earlier> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let records = files.filter(|p| p.extension().is_some_and(|e| e == "json")).filter_map(|path| {
        let bytes = std::fs::read(path).ok()?;
        serde_json::from_slice::<Earlier>(&bytes).ok()
    });
    let is_alike = |e: &Earlier| {
        e.version == VERSION && e.pipeline == record.subject.pipeline && e.clock == record.subject.clock
    };
    let mut records: Vec<Earlier> = records.filter(is_alike).collect();
    records.sort_by(|a, b| a.date.cmp(&b.date));
    records
}

/// The unit in which a channel is shown, and its number per m or rad.
fn shown(channel: Channel) -> (&'static str, f64) {
    if channel.unit() == "m" { ("mm", 1e3) } else { ("deg", 1f64.to_degrees()) }
}

/// A place of the phantom: the channels that differ from the reference.
fn place(known: &[f64; 6]) -> String {
    let moved = ALL.into_iter().zip(known).filter(|(_, k)| k.abs() > 1e-6).map(|(channel, k)| {
        let (unit, scale) = shown(channel);
        format!("{} {} {unit}", channel.name(), fixed(k * scale, 1))
    });
    let moved: Vec<String> = moved.collect();
    if moved.is_empty() { "reference".to_owned() } else { moved.join(", ") }
}

fn listed(parts: &[String]) -> String {
    if parts.is_empty() { "nothing".to_owned() } else { parts.join("; ") }
}
