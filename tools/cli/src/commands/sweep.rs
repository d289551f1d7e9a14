//! `stillpoint replay --sweep`: a session with a parameter at several values, and the curve of each figure.

use std::io::Write;
use std::path::Path;
use std::str::FromStr;

use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::compare::Figure;
use stillpoint_report::page::{Block, Section};
use stillpoint_report::{html, numbers};

use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::jobs;
use crate::private;
use crate::rerun::{Computed, Rerun, RerunError};
use crate::signals::stop_flag_of_this_process;

/// Most values of a sweep.
const MOST_VALUES: usize = 1000;

/// A parameter with the values that it takes, evenly spaced.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// `operator.param`.
    parameter: String,
    /// Its unit; empty where it has none.
    unit: String,
    values: Vec<f64>,
}

/// A sweep that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "invalid sweep: {text:?} ({reason}); write OPERATOR.PARAM=FROM..TO/COUNT, with a unit behind TO, such as \"law.proportional=1..5 1/s/9\""
)]
pub struct SweepError {
    text: String,
    reason: &'static str,
}

impl FromStr for Sweep {
    type Err = SweepError;

    fn from_str(text: &str) -> Result<Self, SweepError> {
        let wrong = |reason| SweepError { text: text.to_owned(), reason };
        let (parameter, range) = text.split_once('=').ok_or_else(|| wrong("there is no ="))?;
        let (range, count) = range.rsplit_once('/').ok_or_else(|| wrong("there is no /COUNT"))?;
        let (from, to) = range.split_once("..").ok_or_else(|| wrong("there is no FROM..TO"))?;
        let count: usize = count.trim().parse().map_err(|_| wrong("the count is not a whole number"))?;
        if !(2..=MOST_VALUES).contains(&count) {
            return Err(wrong("the count must be from 2 to 1000"));
        }
        let to = to.trim();
        let (to, unit) = to.split_once(char::is_whitespace).unwrap_or((to, ""));
        let number = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let (Some(from), Some(to)) = (number(from), number(to)) else {
            return Err(wrong("FROM and TO must be finite numbers"));
        };
        if from == to {
            return Err(wrong("FROM and TO are the same"));
        }
        let step = |i: usize| from + (to - from) * i as f64 / (count - 1) as f64;
        let values: Vec<f64> = (0..count).map(step).collect();
        if values.iter().any(|value| !value.is_finite()) {
            return Err(wrong("FROM and TO are too far apart"));
        }
        Ok(Self { parameter: parameter.trim().to_owned(), unit: unit.trim().to_owned(), values })
    }
}

/// The run with one value.
struct Point {
    value: f64,
    computed: Computed,
}

impl Sweep {
    /// The change of a run.
    fn set(&self, value: f64) -> String {
        format!("{}={}", self.parameter, self.text(value))
    }

    /// A value with its unit.
    fn text(&self, value: f64) -> String {
        format!("{value} {}", self.unit).trim_end().to_owned()
    }

    /// Runs the session with each value on all cores, prints the figures, and writes the page with their curves.
    pub fn execute(
        &self,
        (path, session): (&Path, &Session),
        registry: &Registry,
        rerun: &Rerun,
        page: Option<&Path>,
        is_json: bool,
    ) -> Ended {
        let with = |value: f64| {
            let sets = [rerun.sets.clone(), vec![self.set(value)]].concat();
            Rerun { sets, record: None, ..rerun.clone() }
        };
        // A value that is out of range is found before anything runs.
        for value in &self.values {
            match with(*value).check(session, registry) {
                Ok(()) => {}
                Err(RerunError::Refused(refused)) => return refused.end(false),
                Err(RerunError::Failed(failure)) => return Err(failure),
            }
        }
        let stop = stop_flag_of_this_process()?;
        let points = jobs::each(&self.values, jobs::threads(None), |value| {
            let session = Session::open(path).map_err(Failure::failed)?;
            let computed = with(*value).compute(&session, registry, stop.clone())?;
            Ok(Point { value: *value, computed })
        })?;
        if let Some(page) = page {
            self.write_page(page, &points)?;
        }
        let exits: Vec<Exit> = points.iter().map(|point| point.computed.exit()).collect();
        let exit = exits.iter().copied().find(|exit| *exit != Exit::Done).unwrap_or(Exit::Done);
        if is_json {
            print_json(&self.json(path, &points))?;
            return Ok(exit);
        }
        self.say(&points);
        for (point, exit) in points.iter().zip(exits).filter(|(_, exit)| *exit != Exit::Done) {
            outln!(
                "{}: not computed to the end (exit {}): replay it with --set for the reason",
                self.set(point.value),
                exit as u8
            );
        }
        Ok(exit)
    }

    /// Prints a row for each figure, with a column for each value.
    fn say(&self, points: &[Point]) {
        let heads: Vec<String> = points.iter().map(|point| self.text(point.value)).collect();
        let mut columns = vec![(Side::Left, self.parameter.as_str()), (Side::Right, "recorded")];
        columns.extend(heads.iter().map(|head| (Side::Right, head.as_str())));
        let mut table = Columns::new(columns);
        let figures = figures(points);
        for figure in &figures {
            let text = |value: Option<f64>| {
                value.map_or("-".to_owned(), |v| format!("{} {}", numbers::short(v), figure.unit))
            };
            let mut row = vec![figure.name.clone(), text(figure.values[0])];
            row.extend(points.iter().map(|point| text(value_of(point, &figure.name))));
            table.row(row);
        }
        match figures.is_empty() {
            true => outln!("no run has figures of how a head was held"),
            false => out!("{table}"),
        }
    }

    fn json(&self, path: &Path, points: &[Point]) -> serde_json::Value {
        let runs: Vec<_> = points
            .iter()
            .map(|point| {
                json!({
                    "value": point.value,
                    "figures": point.computed.comparison.figures,
                    "identical_all": point.computed.comparison.is_identical(),
                    "open": point.computed.done.open(),
                    "ended_early": point.computed.done.report.ended_early,
                    "wall_seconds": point.computed.wall_seconds,
                })
            })
            .collect();
        json!({
            "session": path,
            "parameter": self.parameter,
            "unit": self.unit,
            "runs": runs,
        })
    }

    /// A chart of each figure over the parameter.
    fn write_page(&self, path: &Path, points: &[Point]) -> Result<(), Failure> {
        let figures = figures(points);
        let mut section = Section::new("sweep", "Figures at the end", &figures).map_err(Failure::failed)?;
        let ends = [self.values[0], self.values[self.values.len() - 1]];
        for figure in &figures {
            let curve = points.iter().filter_map(|p| Some((p.value, value_of(p, &figure.name)?))).collect();
            let mut series = vec![Series { name: "changed".to_owned(), points: curve, style: Style::Line }];
            if let Some(recorded) = figure.values[0] {
                let points = ends.map(|end| (end, recorded)).to_vec();
                series.push(Series { name: "recorded".to_owned(), points, style: Style::Dashed });
            }
            let x = format!("{} {}", self.parameter, self.unit);
            let y = if figure.unit.is_empty() { "value" } else { figure.unit };
            let chart =
                Chart { title: figure.name.clone(), x: x.trim_end().to_owned(), y: y.to_owned(), series };
            section = section.with(Block::Chart(chart, String::new()));
        }
        if figures.is_empty() {
            section = section.nothing("no run has figures of how a head was held");
        }
        let about = format!(
            "One session with {} at {} values from {} to {}, by stillpoint {}",
            self.parameter,
            self.values.len(),
            self.text(ends[0]),
            self.text(ends[1]),
            env!("CARGO_PKG_VERSION")
        );
        let page = html::page(&format!("Sweep of {}", self.parameter), &about, &[section]);
        private::create(path)
            .and_then(|mut file| file.write_all(page.as_bytes()))
            .map_err(|e| Failure::failed(format!("{}: {e}; choose another file with --page", path.display())))
    }
}

/// The figures that any run has, in the order of the first run that has them.
fn figures(points: &[Point]) -> Vec<Figure> {
    let mut all: Vec<Figure> = Vec::new();
    for figure in points.iter().flat_map(|point| &point.computed.comparison.figures) {
        if !all.iter().any(|known| known.name == figure.name) {
            all.push(figure.clone());
        }
    }
    all
}

/// The value of a figure in a run.
fn value_of(point: &Point, name: &str) -> Option<f64> {
    point.computed.comparison.figures.iter().find(|figure| figure.name == name)?.values[1]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_sweep_is_a_parameter_with_evenly_spaced_values() {
        let sweep: Sweep = "law.proportional=1..5 1/s/5".parse().unwrap();
        assert_eq!(sweep.values, [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(sweep.set(sweep.values[2]), "law.proportional=3 1/s");
        let plain: Sweep = "law.integral = 4 .. -2 / 3".parse().unwrap();
        assert_eq!(
            (plain.values.clone(), plain.set(plain.values[1])),
            (vec![4.0, 1.0, -2.0], "law.integral=1".into())
        );
    }

    #[test]
    fn what_is_not_a_sweep_is_refused_with_the_form() {
        for text in [
            "",
            "law.p",
            "law.p=1..2",
            "law.p=1/3",
            "law.p=1..2/1",
            "law.p=1..2/1001",
            "law.p=1..x/3",
            "law.p=nan..2/3",
            "law.p=2..2/3",
            "law.p=1..inf/4",
            "law.p=-1e308..1e308/3",
            "law.p=1..1e308/9",
        ] {
            let error = text.parse::<Sweep>().unwrap_err().to_string();
            assert!(error.contains("OPERATOR.PARAM=FROM..TO/COUNT") && error.contains(text), "{error}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn broken_sweeps_are_refused_or_have_finite_values(
            pieces in prop::collection::vec(
                prop_oneof![
                    prop::sample::select(vec![
                        "law.proportional", "=", "..", "/", "1", "5", "-", "1e308", "-1e308", "1e999", "nan", "inf", " ", "1/s", "9",
                        "1000", "1001", "0", "é", "\0", "18446744073709551616", "0x10", ".",
                    ])
                    .prop_map(str::to_owned),
                    any::<char>().prop_map(String::from),
                ],
                0..12,
            ),
            is_sound in any::<bool>(),
        ) {
            let mut text = pieces.concat();
            if is_sound {
                text = format!("law.proportional={text}..1e308 1/s/9");
            }
            match text.parse::<Sweep>() {
                Ok(sweep) => {
                    prop_assert!((2..=MOST_VALUES).contains(&sweep.values.len()));
                    prop_assert!(sweep.values.iter().all(|value| value.is_finite()), "{text:?}");
                }
                Err(refused) => prop_assert!(!refused.to_string().is_empty()),
            }
        }
    }
}
