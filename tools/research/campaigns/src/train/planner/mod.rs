//! `stillpoint-research train planner`
//!
//! - `player`, `workers`: the processes that play games, and what starts them
//! - `weights`: the weights in shared memory
//! - `reported`: progress bars and curves

mod player;
mod reported;
mod weights;
mod workers;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use sha2::{Digest, Sha256};
use stillpoint_network::patient::Body;
use stillpoint_network::{Coarseness, Group, Patient, Rules, Sizes};
use stillpoint_train::planner::{About, Card, Options, Pooled, Schedule, train};

use super::publish;
pub use player::Player;
use reported::Bars;
use stillpoint::quantity;
use stillpoint::{Ended, Failure};
use stillpoint::{PoolArgs, print_shares};
use workers::Workers;

/// Number of the first phantom of self-play, beside those of openings.
const FRESH: u64 = 1_000_000;

/// Train the prior of beam angles: a supervised start on sets that are found by search, then self-play.
///
/// In a round of self-play, processes play games: they solve the sets that the network proposes for a new phantom, and sets
/// that a tree search finds from there. They take the weights of the round from shared memory, while the network is trained on
/// the games of the rounds before. Games, weights and a checkpoint are kept in `--data`. The same command resumes a training
/// that was cut off, with the same numbers, for any number of players. With `--pool` the workers of a pool play instead,
/// on other hosts, and the numbers are the same again. The strength is measured on patients that the
/// training never saw.
#[derive(Args)]
pub struct Planner {
    /// Where to write, without an ending: `PATH.safetensors`, `PATH.json`, `PATH.md`, and the curves `PATH.svg` and
    /// `PATH-strength.svg`.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Folder of games, features, weights and the checkpoint.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Train on the case files of this folder, by their names, instead of on phantoms: the first `--train` of them, the
    /// next `--validate`, the next `--test`. Self-play goes over the first ones again and again.
    #[arg(long, value_name = "DIR")]
    cases: Option<PathBuf>,
    /// Number of the first phantom. Pelves and necks take turns.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    first: u64,
    /// Patients of openings, for the supervised start.
    #[arg(long, value_name = "N", default_value_t = 60)]
    train: usize,
    /// Patients that are examined after each round: those behind.
    #[arg(long, value_name = "N", default_value_t = 10)]
    validate: usize,
    /// Patients that are examined at the end: those behind these.
    #[arg(long, value_name = "N", default_value_t = 15)]
    test: usize,
    /// Passes over the openings before the first round.
    #[arg(long, value_name = "N", default_value_t = 24)]
    start: usize,
    /// Rounds of self-play.
    #[arg(long, value_name = "N", default_value_t = 0)]
    rounds: usize,
    /// Games of a round.
    #[arg(long, value_name = "N", default_value_t = 40)]
    games: usize,
    /// Passes over the buffer in a round.
    #[arg(long, value_name = "N", default_value_t = 2)]
    passes: usize,
    /// Passes behind the last round.
    #[arg(long, value_name = "N", default_value_t = 8)]
    end: usize,
    /// Most games in the buffer; the oldest leave it first.
    #[arg(long, value_name = "N", default_value_t = 4000)]
    buffer: usize,
    /// Processes that play. Nothing depends on their number. Default: the number of cores.
    #[arg(long, conflicts_with = "pool")]
    players: Option<NonZeroUsize>,
    #[command(flatten)]
    pool: PoolArgs,
    /// Spacing of the dose grid of games. The width of a bixel should be a multiple of it.
    #[arg(long, value_name = "LENGTH", default_value = "5mm")]
    grid: String,
    /// Width of a bixel in games. The network learns how well the bixels fit the target.
    #[arg(long, value_name = "LENGTH", default_value = "10mm")]
    bixel: String,
    /// Width of a bixel in games of heads and necks. Their targets are large: with bixels of 10 mm a solve takes ten times
    /// as long as that of a pelvis.
    #[arg(long, value_name = "LENGTH", default_value = "20mm")]
    neck_bixel: String,
    /// Learning rate.
    #[arg(long, value_name = "RATE", default_value_t = Options::default().rate)]
    learning_rate: f64,
    /// Seed of the network's first numbers and of all draws.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Groups of features that the network does without, to find out what they are worth.
    #[arg(long, value_name = "GROUP", value_delimiter = ',', value_parser = group)]
    without: Vec<Group>,
    /// Circular convolutions over the angles: the depth of the network, 1 to 4.
    #[arg(long, value_name = "N", default_value_t = Sizes::default().layers)]
    layers: usize,
    /// Print the card as JSON.
    #[arg(long)]
    json: bool,
}

impl Planner {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let schedule = self.schedule()?;
        let mut without = self.without.clone();
        without.sort_unstable();
        without.dedup();
        let options = Options {
            sizes: Sizes { layers: self.layers, ..Sizes::default() },
            rate: self.learning_rate,
            seed: self.seed,
            without,
            ..Options::default()
        };
        let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let began = Instant::now();
        let bars = Bars::new(&schedule)?;
        let report = |reported| bars.report(reported);
        let trained = match self.pool.open()? {
            Some(pool) => {
                let mut players = Pooled::new(pool.telling(bars.news()), cores());
                let trained = train(&schedule, &options, &self.data, &mut players, &report);
                bars.finish();
                if !self.json {
                    print_shares(players.pool());
                }
                trained
            }
            None => {
                let mut workers = Workers::new(self.players.unwrap_or_else(cores))?;
                train(&schedule, &options, &self.data, &mut workers, &report)
            }
        };
        bars.finish();
        let trained = trained.map_err(Failure::failed)?;
        let bytes = trained.model.to_safetensors().map_err(Failure::failed)?;
        let about = About {
            program: format!("stillpoint-research {}", env!("CARGO_PKG_VERSION")),
            command: self.command(),
            sha256: Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect(),
            seconds: began.elapsed().as_secs_f64(),
        };
        let card = Card::of(&trained, &schedule, &options, about);
        let strength = reported::strength(&trained.strength)?;
        super::write(&self.out, "-strength.svg", strength.as_bytes())?;
        publish(&self.out, bytes, &card, &card.markdown(), reported::losses(&trained.passes)?, self.json)
    }

    fn schedule(&self) -> Result<Schedule, Failure> {
        let length = |name: &str, text: &str| quantity(text, "mm", &format!("--{name} {text}"));
        let (grid_mm, bixel_mm) = (length("grid", &self.grid)?, length("bixel", &self.bixel)?);
        let usual = Coarseness { grid_mm, bixel_mm };
        let of_neck = Coarseness { bixel_mm: length("neck-bixel", &self.neck_bixel)?, ..usual };
        let phantom = |number: u64| {
            let patient = Patient::of_number(number, usual);
            match patient.body {
                Body::Neck(_) => Patient { coarse: of_neck, ..patient },
                _ => patient,
            }
        };
        let whole = self.train + self.validate + self.test;
        let mut patients: Vec<Patient> = match &self.cases {
            None => (self.first..).take(whole).map(phantom).collect(),
            Some(folder) => case_files(folder)?.iter().map(|path| Patient::of_file(path, usual)).collect(),
        };
        if patients.len() < whole {
            return Err(Failure::wrong(format!(
                "--cases: there are {} case files, and {whole} patients to train on, to validate with and to test",
                patients.len()
            )));
        }
        let mut test = patients.split_off(self.train + self.validate);
        test.truncate(self.test);
        let validate = patients.split_off(self.train);
        let game = |round: usize, place: usize| {
            let number = round * self.games + place;
            match self.cases {
                Some(_) => patients[number % patients.len()].clone(),
                None => phantom(self.first + FRESH + number as u64),
            }
        };
        if patients.is_empty() || validate.is_empty() {
            return Err(Failure::wrong("give at least one patient to --train and to --validate"));
        }
        let rounds =
            (0..self.rounds).map(|round| (0..self.games).map(|place| game(round, place)).collect()).collect();
        Ok(Schedule {
            train: patients,
            validate,
            test,
            rounds,
            start: self.start,
            passes: self.passes,
            end: self.end,
            buffer: self.buffer,
            opening: Rules::OPENING,
            game: Rules::SELF_PLAY,
            reference: Rules::REFERENCE,
            exam: Rules::EXAM,
            seed: self.seed,
        })
    }

    /// The command that makes the same model again.
    fn command(&self) -> String {
        let cases = self.cases.as_ref().map_or_else(
            || format!("--first {}", self.first),
            |folder| format!("--cases {}", folder.display()),
        );
        let mut changed = String::new();
        for group in &self.without {
            changed += &format!(" --without {}", group.name());
        }
        if self.layers != Sizes::default().layers {
            changed += &format!(" --layers {}", self.layers);
        }
        format!(
            "stillpoint-research train planner {cases}{changed} --train {} --validate {} --test {} --start {} --rounds {} --games {} --passes {} --end {} --buffer {} --grid {} --bixel {} --neck-bixel {} --learning-rate {} --seed {} --data {} --out {}",
            self.train,
            self.validate,
            self.test,
            self.start,
            self.rounds,
            self.games,
            self.passes,
            self.end,
            self.buffer,
            self.grid,
            self.bixel,
            self.neck_bixel,
            self.learning_rate,
            self.seed,
            self.data.display(),
            self.out.display()
        )
    }
}

/// A name that no group of features has.
#[derive(Debug, thiserror::Error)]
#[error("the groups of features are {}", Group::ALL.map(Group::name).join(", "))]
struct NoGroup;

/// A group of features by its name.
fn group(text: &str) -> Result<Group, NoGroup> {
    let found = Group::ALL.into_iter().find(|group| group.name() == text);
    found.ok_or(NoGroup)
}

/// The case files of a folder, by the numbers and words of their names.
fn case_files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let fault = |e: std::io::Error| Failure::wrong(format!("--cases {}: {e}", folder.display()));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        if path.extension().is_some_and(|ending| ending == "case") {
            files.push(path);
        }
    }
    // openkbp_9 stands before openkbp_10.
    files.sort_by_key(|path| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        (name.len(), name)
    });
    Ok(files)
}
