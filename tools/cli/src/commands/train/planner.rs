//! `stillpoint train planner`

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use sha2::{Digest, Sha256};
use stillpoint_train::planner::{
    About, Card, Epoch, Gather, Options, SolvedCase, Summary, examples, fit, gather, strength,
};

use super::{progress, publish};
use crate::exit::{Ended, Exit, Failure};
use stillpoint_report::chart::{Chart, Series, Style};

/// Sets of a model that are solved for its strength.
const TRIED: usize = 5;

/// Train the prior of beam angles, on varied pelves whose best sets of five beams are found by search.
///
/// The sets that were solved are kept in `--data`, so that a second training finds them. A checkpoint is written there after
/// each epoch; the same command resumes a training that was cut off, with the same numbers. The strength is measured on
/// pelves that the training never saw.
#[derive(Args)]
pub struct Planner {
    /// Where to write, without an ending: `PATH.safetensors`, `PATH.json`, `PATH.md`, `PATH.svg`.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Folder of solved pelves and of the checkpoint.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Only solve the pelves of all three ranges; train nothing.
    #[arg(long)]
    only_data: bool,
    /// Seed of the first pelvis.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    first: u64,
    /// Pelves to train on.
    #[arg(long, value_name = "N", default_value_t = 60)]
    train: u64,
    /// Pelves to validate on: those behind.
    #[arg(long, value_name = "N", default_value_t = 8)]
    validate: u64,
    /// Pelves to measure the strength on: those behind these.
    #[arg(long, value_name = "N", default_value_t = 12)]
    test: u64,
    /// Epochs.
    #[arg(long, value_name = "N", default_value_t = Options::default().epochs)]
    epochs: usize,
    /// Learning rate.
    #[arg(long, value_name = "RATE", default_value_t = Options::default().rate)]
    learning_rate: f64,
    /// Seed of the network's first numbers and of all draws.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of threads that solve; nothing depends on it. Default: all cores.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print the card as JSON.
    #[arg(long)]
    json: bool,
}

impl Planner {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let threads =
            self.threads.unwrap_or_else(|| std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN));
        let ends = [self.train, self.validate, self.test];
        let [train, validate, test] = [0, 1, 2].map(|i| {
            let begin = self.first + ends[..i].iter().sum::<u64>();
            begin..begin + ends[i]
        });
        let bar = progress(ends.iter().sum(), "pelvis")?;
        let solved = |seeds: std::ops::Range<u64>| -> Result<Vec<SolvedCase>, Failure> {
            let one = |seed| {
                let found = gather(&self.data, seed, Gather::default(), threads).map_err(Failure::failed);
                bar.inc(1);
                found
            };
            seeds.map(one).collect()
        };
        let (trained, validated, mut tested) =
            (solved(train.clone())?, solved(validate.clone())?, solved(test.clone())?);
        bar.finish_and_clear();
        if self.only_data {
            outln!("{} pelves are solved in {}", ends.iter().sum::<u64>(), self.data.display());
            return Ok(Exit::Done);
        }
        let bar = progress((trained.len() + validated.len()) as u64, "features")?;
        let of = |all: &[SolvedCase]| examples(all, || bar.inc(1)).map_err(Failure::failed);
        let (on, beside) = (of(&trained)?, of(&validated)?);
        bar.finish_and_clear();
        let options =
            Options { rate: self.learning_rate, epochs: self.epochs, seed: self.seed, ..Options::default() };
        let began = Instant::now();
        let bar = progress(self.epochs as u64, "epoch")?;
        let checkpoint = self.data.join("training.safetensors");
        let fitted = fit(&on, &beside, &options, Some(&checkpoint), |epoch| {
            bar.set_message(format!("loss {:.4}, validation {:.4}", epoch.training, epoch.validation));
            bar.set_position(epoch.number as u64);
        })
        .map_err(Failure::failed)?;
        bar.finish_and_clear();
        let seconds = began.elapsed().as_secs_f64();
        let bar = progress(tested.len() as u64, "strength")?;
        let mut all = Vec::new();
        for case in &mut tested {
            all.push(strength(&fitted.model, case, TRIED, threads).map_err(Failure::failed)?);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let bytes = fitted.model.to_safetensors().map_err(Failure::failed)?;
        let range = |seeds: &std::ops::Range<u64>| [seeds.start, seeds.end];
        let about = About {
            program: format!("stillpoint {}", env!("CARGO_PKG_VERSION")),
            command: self.command(),
            sha256: Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect(),
            gather: Gather::default(),
            trained: range(&train),
            validated: range(&validate),
            tested: range(&test),
            sets: trained.iter().map(|case| case.sets.len()).sum(),
            seconds,
            strength: Summary::of(&all),
        };
        let card = Card::of(&fitted.model, &fitted, &options, about);
        publish(&self.out, bytes, &card, &card.markdown(), losses(&fitted.epochs)?, self.json)
    }

    /// The command that makes the same model again.
    fn command(&self) -> String {
        format!(
            "stillpoint train planner --first {} --train {} --validate {} --test {} --epochs {} --learning-rate {} --seed {} --data {} --out {}",
            self.first,
            self.train,
            self.validate,
            self.test,
            self.epochs,
            self.learning_rate,
            self.seed,
            self.data.display(),
            self.out.display()
        )
    }
}

/// The losses over the epochs.
fn losses(epochs: &[Epoch]) -> Result<String, Failure> {
    let series = |name: &str, of: fn(&Epoch) -> f64| Series {
        name: name.to_owned(),
        points: epochs.iter().map(|e| (e.number as f64, of(e))).collect(),
        style: Style::Line,
    };
    let chart = Chart {
        title: "Training of the prior of beams".into(),
        x: "epoch".into(),
        y: "loss (5.9)".into(),
        series: vec![series("training", |e| e.training), series("validation", |e| e.validation)],
    };
    chart.svg(720, 400).map_err(Failure::failed)
}
