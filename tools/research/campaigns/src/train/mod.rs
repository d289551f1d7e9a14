//! `stillpoint-research train`

mod patient;
mod planner;
mod sessions;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use serde_json::json;
use sha2::{Digest, Sha256};
use stillpoint_control::channels::{Channel, Channels};
use stillpoint_control::predictor::{Meaning, Predictor};
use stillpoint_train::card::{About, Card, Data};
use stillpoint_train::dataset::{Cut, Dataset, Sample};
use stillpoint_train::excite::{Excitation, SCALE, record};
use stillpoint_train::fit::{Epoch, Fitted, Optimiser, Options, fit};
use stillpoint_train::linear::left;

use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_report::chart::{Chart, Series, Style};

/// Train what is learned offline.
#[derive(Args)]
pub struct Train {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Train the network whose features `control.mrac` adapts over.
    Controller(Controller),
    /// Train a network that predicts what patients do, beside predictions without a network.
    Patient(patient::Patient),
    /// Train the prior of beam angles that `plan --prior network` uses.
    Planner(Box<planner::Planner>),
    #[command(hide = true)]
    Player(planner::Player),
}

impl Train {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.what {
            What::Controller(controller) => controller.execute(),
            What::Patient(patient) => patient.execute(),
            What::Planner(planner) => planner.execute(),
            What::Player(player) => player.execute(),
        }
    }
}

/// Duties in parts of this go into the network: what valves do in control is small.
const DUTY_SCALE: f64 = 0.1;
/// Samples that the network goes over: they cover the lags of (4.26).
const WINDOW: usize = 6;

/// Train the network whose features `control.mrac` adapts over, on data of the simulated rig or of sessions.
///
/// It predicts how height, pitch and roll change from sample to sample. A fifth of the runs is kept for validation, and
/// the numbers of the best epoch are written, with a card (`.json`, `.md`) and a picture of the losses (`.svg`).
#[derive(Args)]
struct Controller {
    /// Where to write, without an ending: `PATH.safetensors`, `PATH.json`, `PATH.md`, `PATH.svg`.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Train on this session in place of the rig; may be given again. It must have kept `--state` and `--duties`.
    #[arg(long, value_name = "SESSION")]
    session: Vec<PathBuf>,
    /// Of sessions: where the head is, a topic of tracks.
    #[arg(long, value_name = "TOPIC", default_value = "filter.state")]
    state: String,
    /// Of sessions: what the valves were told, a topic of duties.
    #[arg(long, value_name = "TOPIC", default_value = "law.duties")]
    duties: String,
    #[command(flatten)]
    descent: Descent,
    /// Runs of the rig.
    #[arg(long, value_name = "N", default_value_t = 30)]
    runs: usize,
    /// Length of a run, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    seconds: f64,
    /// Print the card as JSON.
    #[arg(long)]
    json: bool,
}

/// How a network of long short-term memory is trained.
#[derive(Args)]
struct Descent {
    /// How the gradient is followed.
    #[arg(long, value_enum, default_value_t)]
    optimiser: Follow,
    /// Learning rate.
    #[arg(long, value_name = "RATE", default_value_t = 5e-3)]
    learning_rate: f64,
    /// Windows of a batch.
    #[arg(long, value_name = "N", default_value_t = 50)]
    batch: usize,
    /// Probability with which a number between layers is dropped in training.
    #[arg(long, value_name = "PART", default_value_t = 0.3)]
    dropout: f64,
    /// Most epochs.
    #[arg(long, value_name = "N", default_value_t = 200)]
    epochs: usize,
    /// Epochs without a better validation after which training stops.
    #[arg(long, value_name = "N", default_value_t = 20)]
    patience: usize,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Follow {
    /// Stochastic gradient descent.
    #[default]
    Sgd,
    /// Adam with decay of the weights.
    Adamw,
}

impl Descent {
    fn options(&self) -> Options {
        Options {
            optimiser: if self.optimiser == Follow::Sgd { Optimiser::Sgd } else { Optimiser::AdamW },
            learning_rate: self.learning_rate,
            batch: self.batch,
            dropout: self.dropout,
            epochs: self.epochs,
            patience: self.patience,
            seed: self.seed,
            ..Options::default()
        }
    }

    /// Trains with a bar.
    fn fit(&self, set: &Dataset, options: &Options) -> Result<Fitted, Failure> {
        let bar = progress(self.epochs as u64, "epoch")?;
        let fitted = fit(set, options, |epoch| {
            bar.set_message(format!("loss {:.4}, validation {:.4}", epoch.training, epoch.validation));
            bar.inc(1);
        })
        .map_err(Failure::failed)?;
        bar.finish_and_clear();
        Ok(fitted)
    }

    /// The flags that make the same model again.
    fn words(&self) -> String {
        let optimiser = if self.optimiser == Follow::Sgd { "sgd" } else { "adamw" };
        format!(
            "--optimiser {optimiser} --learning-rate {} --batch {} --dropout {} --epochs {} --patience {} --seed {}",
            self.learning_rate, self.batch, self.dropout, self.epochs, self.patience, self.seed
        )
    }
}

impl Controller {
    fn execute(&self) -> Ended {
        let sample_time = Excitation::default().sample_time;
        let (runs, data) = self.data(sample_time)?;
        let options = self.descent.options();
        let set = Dataset::new(&runs, Cut { window: WINDOW, duty_scale: DUTY_SCALE, ..Cut::default() })
            .map_err(Failure::failed)?;
        let fitted = self.descent.fit(&set, &options)?;
        let channels =
            Channels::new(&[Channel::Z, Channel::Pitch, Channel::Roll]).map_err(Failure::failed)?;
        let meaning = Meaning {
            channels,
            scale: SCALE.to_vec(),
            change: set.scale().to_vec(),
            ahead: vec![1],
            duty_scale: DUTY_SCALE,
            bladders: 3,
            sample_time: (sample_time * 1e9).round() as u64,
            window: WINDOW,
        };
        let predictor = Predictor::new(fitted.network.clone(), meaning).map_err(Failure::failed)?;
        let bytes = predictor.to_safetensors(&Default::default());
        let about = About {
            program: program(),
            command: self.command(),
            sha256: sha256(&bytes),
            data,
            windows: set.counts(),
            linear: left(&set).map_err(Failure::failed)?,
        };
        let card = Card::of(&predictor, &fitted, &options, about);
        publish(
            &self.out,
            bytes,
            &card,
            &card.markdown(),
            losses("Training of the controller's network", &fitted.epochs)?,
            self.json,
        )
    }

    fn data(&self, sample_time: f64) -> Result<(Vec<Vec<Sample>>, Data), Failure> {
        if !self.session.is_empty() {
            let mut runs = Vec::new();
            for path in &self.session {
                runs.extend(sessions::runs(path, &self.state, &self.duties, sample_time)?);
            }
            let names = self.session.iter().map(|p| p.display().to_string()).collect();
            return Ok((runs, Data::Sessions(names)));
        }
        let excitation = Excitation {
            runs: self.runs,
            seconds: self.seconds,
            sample_time,
            seed: self.descent.seed,
            ..Excitation::default()
        };
        let bar = progress(self.runs as u64, "run of the rig")?;
        let runs = record(&excitation, |_| bar.inc(1)).map_err(Failure::failed)?;
        bar.finish_and_clear();
        Ok((runs, Data::Rig(excitation)))
    }

    /// The command that makes the same model again.
    fn command(&self) -> String {
        let mut words = vec!["stillpoint-research train controller".to_owned()];
        words.extend(self.session.iter().map(|p| format!("--session {}", p.display())));
        match self.session.is_empty() {
            true => words.push(format!("--runs {} --seconds {}", self.runs, self.seconds)),
            false => words.push(format!("--state {} --duties {}", self.state, self.duties)),
        }
        words.push(self.descent.words());
        words.push(format!("--out {}", self.out.display()));
        words.join(" ")
    }
}

fn program() -> String {
    format!("stillpoint-research {}", env!("CARGO_PKG_VERSION"))
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

fn progress(length: u64, what: &str) -> Result<ProgressBar, Failure> {
    let style = ProgressStyle::with_template(&format!("{what} {{pos}}/{{len}} {{wide_bar}} {{msg}} {{eta}}"));
    Ok(ProgressBar::new(length).with_style(style.map_err(Failure::failed)?))
}

/// Writes a trained model, its card and its curves, and prints the card.
fn publish(
    out: &Path,
    model: Vec<u8>,
    card: &impl Serialize,
    text: &str,
    curves: String,
    json: bool,
) -> Ended {
    let numbers = serde_json::to_string_pretty(card).map_err(Failure::failed)? + "\n";
    write(out, ".safetensors", &model)?;
    write(out, ".json", numbers.as_bytes())?;
    write(out, ".md", text.as_bytes())?;
    write(out, ".svg", curves.as_bytes())?;
    if json {
        print_json(&json!(card))?;
    } else {
        out!("{text}");
        outln!("\nwritten: {}.safetensors, .json, .md, .svg", out.display());
    }
    Ok(Exit::Done)
}

fn write(out: &Path, ending: &str, content: &[u8]) -> Result<(), Failure> {
    let mut path = out.as_os_str().to_owned();
    path.push(ending);
    let path = PathBuf::from(path);
    std::fs::write(&path, content).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))
}

/// The losses over the epochs.
fn losses(title: &str, epochs: &[Epoch]) -> Result<String, Failure> {
    let series = |name: &str, style, of: fn(&Epoch) -> f64| Series {
        name: name.to_owned(),
        points: epochs.iter().map(|e| (e.number as f64, of(e))).collect(),
        style,
    };
    let chart = Chart {
        title: title.into(),
        x: "epoch".into(),
        y: "half the mean sum of squares".into(),
        series: vec![
            series("training, with dropout", Style::Line, |e| e.training),
            series("validation", Style::Line, |e| e.validation),
        ],
    };
    chart.svg(720, 400).map_err(Failure::failed)
}
