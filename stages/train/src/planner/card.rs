//! The model card of a prior of beams.

use std::fmt::Write;

use serde::Serialize;
use stillpoint_network::Model;

use super::fit::{Epoch, Fitted, Options};
use super::gather::Gather;
use super::strength::Summary;

/// What people should know of a model before they use it.
#[derive(Clone, Debug, Serialize)]
pub struct Card {
    /// What the model is for.
    pub purpose: &'static str,
    /// The limits of use.
    pub limits: &'static str,
    /// What training does not say of itself.
    #[serde(flatten)]
    pub about: About,
    /// Numbers that training set.
    pub parameters: usize,
    /// How it was trained.
    pub options: Options,
    /// Number of the epoch whose numbers were kept.
    pub best: usize,
    /// All epochs.
    pub epochs: Vec<Epoch>,
}

/// What a card says besides what the fit found.
#[derive(Clone, Debug, Serialize)]
pub struct About {
    /// The program, with its version.
    pub program: String,
    /// The command that makes it again.
    pub command: String,
    /// SHA-256 of the model's file.
    pub sha256: String,
    /// How the sets of each case were found.
    pub gather: Gather,
    /// Seeds trained on, the first and the one behind the last.
    pub trained: [u64; 2],
    /// Seeds validated on.
    pub validated: [u64; 2],
    /// Seeds tested on.
    pub tested: [u64; 2],
    /// Sets in the training data.
    pub sets: usize,
    /// Wall time of training, s.
    pub seconds: f64,
    /// Strength on the tested seeds.
    pub strength: Summary,
}

impl Card {
    /// The card of a model.
    #[must_use]
    pub fn of(model: &Model, fitted: &Fitted, options: &Options, about: About) -> Self {
        Self {
            purpose: "A prior of beam angles: which sets of gantry angles suit a patient, from the geometry alone, before any dose is computed.",
            limits: "Research software, not a medical device. It was trained on synthetic pelves with five beams and the objectives of the shipped table; of other sites, numbers of beams and objectives it knows nothing.",
            about,
            parameters: model.parameters(),
            options: options.clone(),
            best: fitted.best,
            epochs: fitted.epochs.clone(),
        }
    }

    /// The card for people, in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let (a, o, s) = (&self.about, &self.options, &self.about.strength);
        let mut text = format!("# Prior of beams\n\n{}\n{}\n\n", self.purpose, self.limits);
        let _ = writeln!(text, "Made by {} with\n\n```sh\n{}\n```\n", a.program, a.command);
        let _ = writeln!(text, "SHA-256 of the file: `{}`. {} numbers.\n", a.sha256, self.parameters);
        let seeds = |range: [u64; 2]| format!("{} to {}", range[0], range[1].saturating_sub(1));
        let _ = writeln!(
            text,
            "Trained on {} sets of the varied pelves of seeds {}, validated on seeds {}. Doses on a grid of {} mm with bixels of {} mm; sets found by exchange ({} solves), annealing ({}), and at random ({}).\n",
            a.sets,
            seeds(a.trained),
            seeds(a.validated),
            a.gather.coarse.grid_mm,
            a.gather.coarse.bixel_mm,
            a.gather.exchange,
            a.gather.annealing,
            a.gather.random
        );
        let _ = writeln!(
            text,
            "Adam, learning rate {}, loss (5.9) with weights {} (value), {} (policy) and {} (numbers); {} epochs in {:.0} s, the best of them {}.\n",
            o.rate,
            o.weights.mse,
            o.weights.ce,
            o.weights.lambda,
            self.epochs.len(),
            a.seconds,
            self.best
        );
        let _ = writeln!(
            text,
            "Strength on {} varied pelves of seeds {}, which were not trained on, same doses: mean percent above the best set known of each.\n",
            s.cases,
            seeds(a.tested)
        );
        let _ = writeln!(text, "| | solves | percent above the best known |\n| --- | --- | --- |");
        for (name, solves, percent) in [
            ("one rotation of equal beams", 1, s.one_rotation),
            ("best rotation of equal beams", 18, s.rotation),
            ("class set", 1, s.class),
            ("this model", 1, s.model_1),
            ("this model, best of five sets", 5, s.model_5),
        ] {
            let _ = writeln!(text, "| {name} | {solves} | {percent:.1} |");
        }
        let _ = writeln!(
            text,
            "\nThe first set of the model is better than the class set in {} of {} pelves, and better than the best rotation in {}.",
            s.ahead_of_class, s.cases, s.ahead_of_rotation
        );
        text
    }
}
