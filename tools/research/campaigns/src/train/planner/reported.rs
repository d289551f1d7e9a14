//! What a training tells while it goes, and its curves.

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_train::planner::{Pass, Progress, Schedule, Summary};

use stillpoint::Failure;

/// Progress bars on standard error: games and passes go on at the same time.
pub struct Bars {
    games: ProgressBar,
    passes: ProgressBar,
    features: ProgressBar,
}

impl Bars {
    /// Before the first game.
    pub fn new(schedule: &Schedule) -> Result<Self, Failure> {
        let all = MultiProgress::new();
        let bar = |what: &str, length: usize| -> Result<ProgressBar, Failure> {
            let style = ProgressStyle::with_template(&format!(
                "{what:>8} {{pos:>5}}/{{len:5}} {{wide_bar}} {{msg}} {{elapsed}}"
            ));
            let bar = ProgressBar::new(length as u64).with_style(style.map_err(Failure::failed)?);
            Ok(all.add(bar))
        };
        Ok(Self {
            games: bar("games", schedule.train.len())?,
            features: bar("features", schedule.train.len())?,
            passes: bar("passes", schedule.all_passes())?,
        })
    }

    pub fn report(&self, reported: Progress) {
        let show = |bar: &ProgressBar, at: usize, of: usize| {
            bar.set_length(of as u64);
            bar.set_position(at as u64);
        };
        match reported {
            Progress::Game(at, of) => show(&self.games, at, of),
            Progress::Features(at, of) => show(&self.features, at, of),
            Progress::Pass(pass) => {
                self.passes.set_position(pass.number as u64);
                self.passes
                    .set_message(format!("loss {:.4}, validation {:.4}", pass.training, pass.validation));
            }
            Progress::Strength(rounds, summary) => {
                let text = format!(
                    "after {rounds} rounds: the first set of the network is {:.1} % above the best known, the best of five {:.1} %",
                    summary.model_1, summary.model_5
                );
                self.passes.suspend(|| errln!("{text}"));
            }
            Progress::Doubt(names) => self.passes.suspend(|| {
                errln!(
                    "pool: the training begins again without these games of a worker that was shut out: {}",
                    names.join(", ")
                );
            }),
        }
    }

    /// Tells what happens to workers of a pool.
    pub fn news(&self) -> impl FnMut(&str) + 'static {
        let bar = self.passes.clone();
        move |text| bar.suspend(|| errln!("pool: {text}"))
    }

    /// Takes the bars away.
    pub fn finish(&self) {
        [&self.games, &self.features, &self.passes].into_iter().for_each(ProgressBar::finish_and_clear);
    }
}

/// The losses over the passes.
pub fn losses(passes: &[Pass]) -> Result<String, Failure> {
    let series = |name: &str, of: fn(&Pass) -> f64| Series {
        name: name.to_owned(),
        points: passes.iter().map(|p| (p.number as f64, of(p))).collect(),
        style: Style::Line,
    };
    let chart = Chart {
        title: "Training of the prior of beams".into(),
        x: "pass".into(),
        y: "loss (5.9)".into(),
        series: vec![series("training", |p| p.training), series("validation", |p| p.validation)],
    };
    chart.svg(720, 400).map_err(Failure::failed)
}

/// The strength over the rounds.
pub fn strength(rounds: &[Summary]) -> Result<String, Failure> {
    let series = |name: &str, of: fn(&Summary) -> f64, style| Series {
        name: name.to_owned(),
        points: rounds.iter().enumerate().map(|(round, s)| (round as f64, of(s))).collect(),
        style,
    };
    let chart = Chart {
        title: "Strength on patients that are not trained on".into(),
        x: "rounds of self-play".into(),
        y: "percent above the best known".into(),
        series: vec![
            series("first set of the network, 1 solve", |s| s.model_1, Style::Line),
            series("best of its five sets, 5 solves", |s| s.model_5, Style::Line),
            series("best rotation of equal beams, 18 solves", |s| s.rotation, Style::Dashed),
        ],
    };
    chart.svg_with_legend_aside(860, 400, &[0, 1, 2]).map_err(Failure::failed)
}
