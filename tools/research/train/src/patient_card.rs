//! The card of a network that predicts patients, beside what predicts them without a network.

use std::fmt::Write;

use serde::Serialize;
use stillpoint_control::lstm::Lstm;

use crate::TrainError;
use crate::dataset::{Batch, Dataset};
use crate::fit::{Epoch, Fitted, Options, errors};
use crate::linear::Linear;
use crate::patients::{Patients, SAMPLE_TIME};

/// The channels of a patient's motion, with units for people.
const CHANNELS: [(&str, &str); 2] = [("height", "mm"), ("pitch", "degrees")];

/// What people should know of a model before they use it.
#[derive(Clone, Debug, Serialize)]
pub struct PatientCard {
    /// What the model is for.
    pub purpose: &'static str,
    /// The limits of use.
    pub limits: &'static str,
    /// The program that trained it, with its version.
    pub program: String,
    /// The command that makes it again.
    pub command: String,
    /// SHA-256 of the model's file.
    pub sha256: String,
    /// Numbers that training set.
    pub parameters: usize,
    /// From sample to sample, s.
    pub sample_time_s: f64,
    /// Samples that the network goes over.
    pub window: usize,
    pub patients: Patients,
    /// Windows trained on, validated on and tested on, each of other patients.
    pub windows: [usize; 3],
    /// How it was trained.
    pub options: Options,
    /// The epoch whose numbers were kept.
    pub best: Option<Epoch>,
    pub epochs: Vec<Epoch>,
    /// How well patients are predicted that nobody was trained on.
    pub predictions: Vec<Prediction>,
}

/// Root mean square errors of the predictions of one channel, mm or degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Which patients, and whether there is a cough in the window or until the predicted pose.
    pub patients: &'static str,
    pub windows: usize,
    pub channel: &'static str,
    /// mm or degrees.
    pub unit: &'static str,
    /// How long ahead, s.
    pub ahead_s: f64,
    /// The pose stays where it was seen last.
    pub hold: f64,
    /// It goes on as from the last sample but one to the last.
    pub velocity: f64,
    /// Least squares over the window.
    pub linear: f64,
    /// Least squares over windows without coughs.
    pub calm: f64,
    pub tones: f64,
    pub network: f64,
}

/// How well all predict the patients to test on.
///
/// # Errors
/// Inputs that are not finite.
pub fn predictions(
    network: &Lstm,
    data: &Dataset,
    patients: &Patients,
    ahead: &[usize],
) -> Result<Vec<Prediction>, TrainError> {
    let (train, test) = (data.training(), data.test());
    let mut tones: Vec<Vec<Vec<f64>>> = vec![Vec::new(); patients.count];
    for (run, _) in &test.ends {
        if tones[*run].is_empty() {
            tones[*run] = patients.tones(*run, ahead)?;
        }
    }
    let mut found = Vec::new();
    let farthest = ahead.iter().copied().max().unwrap_or(0);
    let coughs = |run, last: usize| patients.coughs(run, last + 1 - data.window()..=last + farthest);
    let linear = Linear::new(data, &train)?;
    let calm = Linear::new(data, &train.only(|run, last| !coughs(run, last)))?;
    for (name, nods, coughing) in
        [("breathe", false, false), ("nod and breathe", true, false), ("the same, with a cough", true, true)]
    {
        let batch = test.only(|run, last| Patients::nods(run) == nods && coughs(run, last) == coughing);
        if batch.count == 0 {
            continue;
        }
        let rows = [
            batch.errors(data.outputs(), |_, _, predicted| predicted.fill(0.0)),
            velocity(data, &batch, ahead),
            linear.errors(&batch),
            calm.errors(&batch),
            batch.errors(data.outputs(), |window, _, predicted| {
                let (run, last) = batch.ends[window];
                let changes = tones[run][last].iter().zip(data.scale());
                predicted
                    .iter_mut()
                    .zip(changes)
                    .for_each(|(predicted, (change, scale))| *predicted = change / scale);
            }),
            errors(network, &batch),
        ];
        for (place, scale) in data.scale().iter().enumerate() {
            let (channel, unit) = CHANNELS[place % CHANNELS.len()];
            let [hold, velocity, linear, calm, tones, network] =
                [0, 1, 2, 3, 4, 5].map(|row| rows[row][place] * scale);
            found.push(Prediction {
                patients: name,
                windows: batch.count,
                channel,
                unit,
                ahead_s: SAMPLE_TIME * ahead[place / CHANNELS.len()] as f64,
                hold,
                velocity,
                linear,
                calm,
                tones,
                network,
            });
        }
    }
    Ok(found)
}

/// The errors of the pose going on as in the last interval.
fn velocity(data: &Dataset, batch: &Batch, ahead: &[usize]) -> Vec<f64> {
    let n = CHANNELS.len();
    batch.errors(data.outputs(), |_, window, predicted| {
        let (rest, newest) = window.split_at(window.len() - n);
        let before = &rest[rest.len() - n..];
        for (place, (predicted, scale)) in predicted.iter_mut().zip(data.scale()).enumerate() {
            let change = f64::from(newest[place % n]) - f64::from(before[place % n]);
            *predicted = change * ahead[place / n] as f64 / scale;
        }
    })
}

impl PatientCard {
    /// The card of a network that was trained on these patients.
    #[must_use]
    pub fn of(
        fitted: &Fitted,
        data: &Dataset,
        patients: &Patients,
        options: &Options,
        predictions: Vec<Prediction>,
    ) -> Self {
        let (train, validate) = data.counts();
        Self {
            purpose: "Predicts height and pitch of a head that nothing moves but its patient. No operator uses it: it is a comparison.",
            limits: "Research software, not a medical device. It knows simulated patients, and no others.",
            program: String::new(),
            command: String::new(),
            sha256: String::new(),
            parameters: fitted.network.parameters(),
            sample_time_s: SAMPLE_TIME,
            window: data.window(),
            patients: patients.clone(),
            windows: [train, validate, data.test().count],
            options: options.clone(),
            best: fitted.epochs.iter().find(|e| e.number == fitted.best).copied(),
            epochs: fitted.epochs.clone(),
            predictions,
        }
    }

    /// The card for people, in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!("# Patient model\n\n{}\n{}\n\n", self.purpose, self.limits);
        let _ = writeln!(text, "Made by {} with\n\n```sh\n{}\n```\n", self.program, self.command);
        let _ = writeln!(text, "SHA-256 of the file: `{}`.\n", self.sha256);
        let _ = writeln!(
            text,
            "A network of long short-term memory, layers of {:?} cells, {} numbers. It goes over {} samples of {} s of height and pitch, counted from the newest.\n",
            self.options.hidden, self.parameters, self.window, self.sample_time_s
        );
        let (p, [train, validate, test]) = (&self.patients, self.windows);
        let _ = writeln!(
            text,
            "{} patients of the rigs, {} s each, seed {}, irregularity from 0 to {}, noise of {} mm and {} degrees in every pose, the predicted ones too. {train} windows to train on, {validate} of other patients to choose the epoch, {test} of others again for the table.\n",
            p.count, p.seconds, p.seed, p.irregularity, p.noise[0], p.noise[1]
        );
        let o = &self.options;
        if let Some(best) = &self.best {
            let _ = writeln!(
                text,
                "{:?}, learning rate {}, batches of {}; best of {} epochs: {}, loss {:.4} in training and {:.4} in validation.\n",
                o.optimiser,
                o.learning_rate,
                o.batch,
                self.epochs.len(),
                best.number,
                best.training,
                best.validation
            );
        }
        text.push_str("Root mean square error, and part of the change's squares that is explained:\n\n| patients | channel | ahead | pose stays | speed stays | least squares | least squares without coughs | tracked tones | network |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
        for p in &self.predictions {
            let cell = |error: f64| {
                format!("{error:.4}, {:.1} %", 100.0 * (1.0 - (error / p.hold) * (error / p.hold)))
            };
            let _ = writeln!(
                text,
                "| {} | {}, {} | {:.1} s | {:.4} | {} | {} | {} | {} | {} |",
                p.patients,
                p.channel,
                p.unit,
                p.ahead_s,
                p.hold,
                cell(p.velocity),
                cell(p.linear),
                cell(p.calm),
                cell(p.tones),
                cell(p.network)
            );
        }
        text
    }
}
