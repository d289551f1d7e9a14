//! The model card of a prior of beams.

use std::fmt::Write;

use serde::Serialize;
use stillpoint_network::patient::{Body, Patient, Table};
use stillpoint_network::{Coarseness, Rules, Sizes};

use super::exam::{Exam, Summary};
use super::selfplay::{Schedule, Trained};
use super::training::{Options, Pass};

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
    /// Patients of openings, the first and the last.
    pub trained: [String; 2],
    /// Doses of the patients.
    pub doses: String,
    /// Number of patients: openings, validation, test.
    pub patients: [usize; 3],
    /// Rounds of self-play, and games of each.
    pub rounds: Vec<usize>,
    /// Rules of openings, games, references and examinations.
    pub rules: [Rules; 4],
    /// Games and sets that were trained on.
    pub games: usize,
    pub sets: usize,
    pub passes: Vec<Pass>,
    /// Strength on the validated patients, after each round.
    pub strength: Vec<Summary>,
    /// Strength on the tested patients, by kinds.
    pub tested: Vec<(String, Summary)>,
    pub exams: Vec<Exam>,
}

/// What a card says besides what the training found.
#[derive(Clone, Debug, Serialize)]
pub struct About {
    /// The program, with its version.
    pub program: String,
    /// The command that makes it again.
    pub command: String,
    /// SHA-256 of the model's file.
    pub sha256: String,
    /// Wall time of the command, s; games that were kept took theirs before.
    pub seconds: f64,
}

/// The kinds of patients, in the order of tables.
fn kind(patient: &Patient) -> &'static str {
    match (&patient.body, patient.table) {
        (Body::Pelvis(_), Table::Plain) => "pelves, plain objectives",
        (Body::Pelvis(_), Table::Shipped) => "pelves, shipped objectives",
        (Body::Varied(_), Table::Plain) => "varied pelves, plain objectives",
        (Body::Varied(_), Table::Shipped) => "varied pelves, shipped objectives",
        (Body::Neck(_), _) => "heads and necks",
        (Body::File(_), _) => "case files",
    }
}

impl Card {
    /// The card of a model.
    #[must_use]
    pub fn of(trained: &Trained, schedule: &Schedule, options: &Options, about: About) -> Self {
        let mut kinds: Vec<&str> = schedule.test.iter().map(kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let of_kind = |name: &&str| {
            let of = schedule.test.iter().zip(&trained.tested).filter(|(patient, _)| kind(patient) == *name);
            ((*name).to_owned(), Summary::of(&of.map(|(_, exam)| exam.clone()).collect::<Vec<_>>()))
        };
        let mut doses: Vec<String> = Vec::new();
        for Coarseness { grid_mm, bixel_mm } in schedule.train.iter().map(|patient| patient.coarse) {
            let text = format!("grid of {grid_mm} mm with bixels of {bixel_mm} mm");
            if !doses.contains(&text) {
                doses.push(text);
            }
        }
        let ends = [schedule.train.first(), schedule.train.last()];
        Self {
            purpose: "A prior of beam angles: which sets of gantry angles suit a patient, from the geometry alone, before any dose is computed.",
            limits: "Research software, not a medical device. It knows the kinds of patients and the objectives below, and sets of five beams; of other sites, objectives and numbers of beams it knows nothing.",
            about,
            parameters: trained.model.parameters(),
            options: Options { passes: schedule.all_passes(), ..options.clone() },
            trained: ends.map(|patient| patient.map_or_else(String::new, Patient::name)),
            doses: format!("Doses: {}", doses.join(", ")),
            patients: [schedule.train.len(), schedule.validate.len(), schedule.test.len()],
            rounds: schedule.rounds.iter().map(Vec::len).collect(),
            rules: [schedule.opening, schedule.game, schedule.reference, schedule.exam],
            games: trained.games,
            sets: trained.sets,
            passes: trained.passes.clone(),
            strength: trained.strength.clone(),
            tested: kinds.iter().map(of_kind).collect(),
            exams: trained.tested.clone(),
        }
    }

    /// The card for people, in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let (a, o) = (&self.about, &self.options);
        let mut text = format!("# Prior of beams\n\n{}\n{}\n\n", self.purpose, self.limits);
        let _ = writeln!(text, "Made by {} with\n\n```sh\n{}\n```\n", a.program, a.command);
        let _ = writeln!(text, "SHA-256 of the file: `{}`. {} numbers.\n", a.sha256, self.parameters);
        if !o.without.is_empty() {
            let names: Vec<&str> = o.without.iter().map(|group| group.name()).collect();
            let _ = writeln!(text, "Trained without these features: {}.\n", names.join(", "));
        }
        if o.sizes.layers != Sizes::default().layers {
            let _ = writeln!(text, "It has {} convolutions over the angles.\n", o.sizes.layers);
        }
        let [opening, game, ..] = &self.rules;
        let _ = writeln!(
            text,
            "Supervised start: openings of {} patients, `{}` to `{}`: rotations of equal beams, {} solves of exchange, {} random sets. Self-play: {} rounds with {} games in all: {} sets of the network, {} solves of a tree search that it guides, {} random sets. {}. {} sets were trained on.\n",
            self.patients[0],
            self.trained[0],
            self.trained[1],
            opening.search,
            opening.random,
            self.rounds.len(),
            self.rounds.iter().sum::<usize>(),
            game.proposed,
            game.search,
            game.random,
            self.doses,
            self.sets
        );
        let _ = writeln!(
            text,
            "Adam, learning rate {}, loss (5.9) with weights {} (value), {} (policy) and {} (numbers); {} passes; this command took {:.0} s.\n",
            o.rate,
            o.weights.mse,
            o.weights.ce,
            o.weights.lambda,
            self.passes.len(),
            a.seconds
        );
        let _ = writeln!(
            text,
            "Strength on {} patients that were not trained on, same doses: mean percent above the best set known of each. The best sets known are those of {} solves of exchange, all rotations and the sets of this model.\n",
            self.patients[2], self.rules[2].search
        );
        let _ = writeln!(
            text,
            "| patients | | this model, 1 solve | best of its 5 sets | class set, 1 solve | one rotation, 1 solve | best rotation, 18 solves | first set against the best rotation |\n| --- | --- | --- | --- | --- | --- | --- | --- |"
        );
        for (kind, s) in &self.tested {
            let class = s.class.map_or_else(|| "-".to_owned(), |class| format!("{class:.1}"));
            let _ = writeln!(
                text,
                "| {kind} | {} | {:.1} | {:.1} | {class} | {:.1} | {:.1} | {:+.1} %, better in {} |",
                s.patients,
                s.model_1,
                s.model_5,
                s.one_rotation,
                s.rotation,
                s.over_rotation,
                s.ahead_of_rotation
            );
        }
        if self.strength.len() > 1 {
            let _ = writeln!(
                text,
                "\nStrength over the rounds, on {} other patients: percent above the best known of the first set, and of the best of five.\n\n| rounds | 1 solve | 5 solves |\n| --- | --- | --- |",
                self.patients[1]
            );
            for (rounds, s) in self.strength.iter().enumerate() {
                let last = if rounds + 1 == self.strength.len() { ", and the last passes" } else { "" };
                let rounds = rounds.min(self.rounds.len());
                let _ = writeln!(text, "| {rounds}{last} | {:.1} | {:.1} |", s.model_1, s.model_5);
            }
        }
        text
    }
}
