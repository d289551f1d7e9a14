//! `stillpoint-research train patient`

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use stillpoint_control::channels::{Channel, Channels};
use stillpoint_control::predictor::{Meaning, Predictor};
use stillpoint_train::dataset::{Cut, Dataset};
use stillpoint_train::fit::Options;
use stillpoint_train::patient_card::{PatientCard, predictions};
use stillpoint_train::patients::{Patients, SAMPLE_TIME, SCALE};

use stillpoint::{Ended, Failure};

/// Samples that the network goes over: 12 s, which hold a nod.
const WINDOW: usize = 60;
/// Samples ahead: 0.2 and 0.4 s, about the delay from camera to valve and twice that.
const AHEAD: [usize; 2] = [1, 2];
/// From window to window in samples; neighbours show nearly the same.
const EVERY: usize = 3;

/// Train a network that predicts what patients do, beside predictions without a network.
///
/// Simulated patients breathe, nod, drift and cough, each in an own way. A fifth of them chooses the epoch, and another
/// fifth is predicted by the network, the last pose, the last speed, least squares and tracked tones. The network is
/// written with a card (`.json`, `.md`) and a picture of the losses (`.svg`).
#[derive(Args)]
pub struct Patient {
    /// Where to write, without an ending: `PATH.safetensors`, `PATH.json`, `PATH.md`, `PATH.svg`.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Patients.
    #[arg(long, value_name = "N", default_value_t = 150)]
    patients: usize,
    /// Length of a patient's run, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 100.0)]
    seconds: f64,
    /// The patients' irregularity is drawn from 0 up to this; 0 are sines of fixed frequencies.
    #[arg(long, value_name = "PART", default_value_t = 1.0)]
    irregularity: f64,
    /// Cells of the network.
    #[arg(long, value_name = "N", default_value_t = 32)]
    cells: usize,
    #[command(flatten)]
    descent: super::Descent,
    /// Print the card as JSON.
    #[arg(long)]
    json: bool,
}

impl Patient {
    pub fn execute(&self) -> Ended {
        let patients = Patients {
            count: self.patients,
            seconds: self.seconds,
            irregularity: self.irregularity,
            seed: self.descent.seed,
            ..Patients::default()
        };
        let runs = patients.record().map_err(Failure::failed)?;
        let cut = Cut {
            window: WINDOW,
            ahead: AHEAD.to_vec(),
            every: EVERY,
            from_newest: true,
            test: 0.2,
            ..Cut::default()
        };
        let set = Dataset::new(&runs, cut).map_err(Failure::failed)?;
        let options = Options { hidden: vec![self.cells], ..self.descent.options() };
        let fitted = self.descent.fit(&set, &options)?;
        let meaning = Meaning {
            channels: Channels::new(&[Channel::Z, Channel::Pitch]).map_err(Failure::failed)?,
            scale: SCALE.to_vec(),
            change: set.scale().to_vec(),
            ahead: AHEAD.to_vec(),
            duty_scale: 1.0,
            bladders: 0,
            sample_time: (SAMPLE_TIME * 1e9).round() as u64,
            window: WINDOW,
        };
        let predictor = Predictor::new(fitted.network.clone(), meaning).map_err(Failure::failed)?;
        let bytes = predictor.to_safetensors(&BTreeMap::new());
        let found = predictions(&fitted.network, &set, &patients, &AHEAD).map_err(Failure::failed)?;
        let card = PatientCard {
            program: super::program(),
            command: self.command(),
            sha256: super::sha256(&bytes),
            ..PatientCard::of(&fitted, &set, &patients, &options, found)
        };
        let curves = super::losses("Training of the network that predicts patients", &fitted.epochs)?;
        super::publish(&self.out, bytes, &card, &card.markdown(), curves, self.json)
    }

    /// The command that makes the same model again.
    fn command(&self) -> String {
        format!(
            "stillpoint-research train patient --patients {} --seconds {} --irregularity {} --cells {} {} --out {}",
            self.patients,
            self.seconds,
            self.irregularity,
            self.cells,
            self.descent.words(),
            self.out.display()
        )
    }
}
