//! The card of a model: what it is, what it was trained on, how well it predicts.

use std::fmt::Write;

use serde::Serialize;
use stillpoint_control::predictor::Predictor;

use crate::excite::Excitation;
use crate::fit::{Epoch, Fitted, Options};

/// What people should know of a model before they use it.
#[derive(Clone, Debug, Serialize)]
pub struct Card {
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
    /// The channels, in their order.
    pub channels: Vec<ChannelCard>,
    pub bladders: usize,
    /// From sample to sample, s.
    pub sample_time_s: f64,
    /// Samples that the network goes over.
    pub window: usize,
    /// Where the data come from.
    pub data: Data,
    pub windows: usize,
    /// Windows of other runs, validated on.
    pub validation_windows: usize,
    /// How it was trained.
    pub options: Options,
    /// The epoch whose numbers were kept.
    pub best: Epoch,
    pub epochs: Vec<Epoch>,
}

/// How well a channel is predicted.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelCard {
    pub name: &'static str,
    /// m or rad.
    pub unit: &'static str,
    /// What counts as one.
    pub scale: f64,
    /// Root mean square of its change from sample to sample, in its unit: the error of predicting no motion.
    pub change: f64,
    /// Root mean square of the error of the network, in its unit, over runs that it was not trained on.
    pub error: f64,
    /// The same of least squares over the same windows.
    pub linear_error: f64,
}

/// Where data come from.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Data {
    Rig(Excitation),
    /// Recorded sessions, by name.
    Sessions(Vec<String>),
}

/// What a card says besides what the fit found.
pub struct About {
    /// The program, with its version.
    pub program: String,
    /// The command that makes it again.
    pub command: String,
    /// SHA-256 of the model's file.
    pub sha256: String,
    /// Where the data come from.
    pub data: Data,
    /// Windows trained and validated on.
    pub windows: (usize, usize),
    /// What [least squares](crate::linear::left) leaves of the changes.
    pub linear: Vec<f64>,
}

impl Card {
    /// The card of a model.
    #[must_use]
    pub fn of(predictor: &Predictor, fitted: &Fitted, options: &Options, about: About) -> Self {
        let numbers = predictor.scale().iter().zip(predictor.change()).zip(&fitted.left).zip(&about.linear);
        let channels =
            predictor.channels().iter().zip(numbers).map(|(channel, (((scale, change), left), linear))| {
                let change = change * scale;
                ChannelCard {
                    name: channel.name(),
                    unit: channel.unit(),
                    scale: *scale,
                    change,
                    error: change * left,
                    linear_error: change * linear,
                }
            });
        let best = fitted.epochs.iter().find(|e| e.number == fitted.best).copied();
        Self {
            purpose: "Features of `control.mrac`: the last hidden state of a network that predicts how a head on bladders moves.",
            limits: "Research software, not a medical device. It knows heads of the masses and motions in its data, and no others.",
            program: about.program,
            command: about.command,
            sha256: about.sha256,
            parameters: predictor.network().parameters(),
            channels: channels.collect(),
            bladders: predictor.bladders(),
            sample_time_s: predictor.sample_time(),
            window: predictor.window(),
            data: about.data,
            windows: about.windows.0,
            validation_windows: about.windows.1,
            options: options.clone(),
            best: best.unwrap_or(Epoch { number: 0, training: f64::NAN, validation: f64::NAN }),
            epochs: fitted.epochs.clone(),
        }
    }

    /// The card for people, in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!("# Controller model\n\n{}\n{}\n\n", self.purpose, self.limits);
        let _ = writeln!(text, "Made by {} with\n\n```sh\n{}\n```\n", self.program, self.command);
        let _ = writeln!(text, "SHA-256 of the file: `{}`.\n", self.sha256);
        let names: Vec<&str> = self.channels.iter().map(|c| c.name).collect();
        let _ = writeln!(
            text,
            "A network of long short-term memory, layers of {:?} cells, {} numbers. It goes over {} samples of {} s, each of {} and the duties of {} valves, and says how much the pose changes until the next sample.\n",
            self.options.hidden,
            self.parameters,
            self.window,
            self.sample_time_s,
            names.join(", "),
            2 * self.bladders
        );
        let _ = match &self.data {
            Data::Rig(e) => writeln!(
                text,
                "Trained on {} windows of the simulated rig, validated on {} of other runs: {} runs of {} s, heads of {} to {} kg, multi-sine of {} of full opening, seed {}.\n",
                self.windows,
                self.validation_windows,
                e.runs,
                e.seconds,
                e.mass[0],
                e.mass[1],
                e.amplitude,
                e.seed
            ),
            Data::Sessions(names) => writeln!(
                text,
                "Trained on {} windows of recorded sessions, validated on {} of other ones: {}.\n",
                self.windows,
                self.validation_windows,
                names.join(", ")
            ),
        };
        let o = &self.options;
        let _ = writeln!(
            text,
            "{:?}, learning rate {}, batches of {}, dropout {}; best of {} epochs: {}, loss {:.4} in training (with dropout) and {:.4} in validation.\n",
            o.optimiser,
            o.learning_rate,
            o.batch,
            o.dropout,
            self.epochs.len(),
            self.best.number,
            self.best.training,
            self.best.validation
        );
        let _ = writeln!(
            text,
            "| channel | change per sample, rms | error of the prediction, rms | part explained | error of least squares, rms | part explained |\n| --- | --- | --- | --- | --- | --- |"
        );
        for c in &self.channels {
            let (factor, unit) =
                if c.unit == "m" { (1e3, "mm") } else { (180.0 / std::f64::consts::PI, "degrees") };
            let explained = |error: f64| 100.0 * (1.0 - (error / c.change) * (error / c.change));
            let _ = writeln!(
                text,
                "| {} | {:.4} {unit} | {:.4} {unit} | {:.1} % | {:.4} {unit} | {:.1} % |",
                c.name,
                c.change * factor,
                c.error * factor,
                explained(c.error),
                c.linear_error * factor,
                explained(c.linear_error)
            );
        }
        text
    }
}
