//! What the sets of a model cost beside the sets of habit, on patients outside of training.

use serde::Serialize;
use stillpoint_network::Game;

/// Costs of one patient, in percent above the best set that is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exam {
    /// Name of the patient.
    pub patient: String,
    /// The class set of the pelvis, one solve.
    pub class: Option<f64>,
    /// The best rotation of equal beams, 18 solves.
    pub rotation: f64,
    /// Mean over the rotations: what one rotation costs, one solve.
    pub one_rotation: f64,
    /// The model's sets, the one of the best value first.
    pub model: Vec<f64>,
}

/// Means over patients, in percent above the best known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    pub patients: usize,
    /// The class set, where all of them have one.
    pub class: Option<f64>,
    pub rotation: f64,
    pub one_rotation: f64,
    /// The model's first set.
    pub model_1: f64,
    /// The best of the model's first five sets.
    pub model_5: f64,
    /// Patients in which the model's first set beats the best rotation.
    pub ahead_of_rotation: usize,
    /// Mean percent by which the model's first set costs more than the best rotation; below 0 where it costs less.
    pub over_rotation: f64,
}

impl Exam {
    /// Of an examination; `best` is the least cost that is known of the patient.
    pub fn of(game: &Game, best: f64) -> Self {
        let above = |cost: f64| 100.0 * (cost / best - 1.0);
        let rotations: Vec<f64> = game.rotations.iter().map(|cost| above(*cost)).collect();
        Self {
            patient: game.patient.name(),
            class: game.class.map(above),
            rotation: rotations.iter().copied().fold(f64::INFINITY, f64::min),
            one_rotation: mean(rotations.iter().copied()),
            model: game.proposed.iter().map(|cost| above(*cost)).collect(),
        }
    }

    fn first(&self) -> f64 {
        self.model.first().copied().unwrap_or(f64::NAN)
    }
}

impl Summary {
    pub fn of(all: &[Exam]) -> Self {
        let five = |exam: &Exam| exam.model.iter().take(5).copied().fold(f64::INFINITY, f64::min);
        let over_rotation = |exam: &Exam| 100.0 * ((100.0 + exam.first()) / (100.0 + exam.rotation) - 1.0);
        let classes: Option<Vec<f64>> = all.iter().map(|exam| exam.class).collect();
        Self {
            patients: all.len(),
            class: classes.map(|classes| mean(classes.into_iter())),
            rotation: mean(all.iter().map(|exam| exam.rotation)),
            one_rotation: mean(all.iter().map(|exam| exam.one_rotation)),
            model_1: mean(all.iter().map(Exam::first)),
            model_5: mean(all.iter().map(five)),
            ahead_of_rotation: all.iter().filter(|exam| exam.first() < exam.rotation).count(),
            over_rotation: mean(all.iter().map(over_rotation)),
        }
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}
