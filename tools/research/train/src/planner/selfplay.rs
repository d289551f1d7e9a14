//! Openings, rounds of self-play, and examinations.
//!
//! The players of a round have the weights that the round began with, and the descent has the games of the rounds before: both
//! work at the same time, one round apart (ch. 5.3.1).

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use serde::Serialize;
use stillpoint_network::{Due, Game, Model, Patient, Rules};

use super::exam::{Exam, Summary};
use super::examples::{Example, scales};
use super::features::Features;
use super::plan;
use super::players::{Players, Stored, file};
use super::training::{Options, Pass, Ready, Training, check};
use crate::TrainError;

/// Patients, games and passes of a training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    pub train: Vec<Patient>,
    /// Patients that are examined after each round; nothing is trained on them.
    pub validate: Vec<Patient>,
    /// Patients that are examined at the end.
    pub test: Vec<Patient>,
    /// Patients of the games of self-play, round by round.
    pub rounds: Vec<Vec<Patient>>,
    /// Passes over the openings before the first round.
    pub start: usize,
    /// Passes in a round.
    pub passes: usize,
    /// Passes behind the last round.
    pub end: usize,
    /// Most games in the buffer; the oldest leave it first.
    pub buffer: usize,
    pub opening: Rules,
    pub game: Rules,
    /// Rules of the openings of patients that are examined: they find the best sets that are known.
    pub reference: Rules,
    pub exam: Rules,
    pub seed: u64,
}

/// What a training tells while it goes.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    /// A game has ended, the one of this number of so many of the same kind.
    Game(usize, usize),
    /// Features of a patient are known.
    Features(usize, usize),
    /// A pass over the buffer.
    Pass(Pass),
    /// An examination after so many rounds.
    Strength(usize, Summary),
    /// These games are in doubt: the training begins again without them.
    Doubt(Vec<String>),
}

/// Where a training tells: games and passes at the same time, from two threads.
pub type Report<'a> = &'a (dyn Fn(Progress) + Sync);

#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    pub model: Model,
    pub passes: Vec<Pass>,
    /// Strength on the validated patients after 0, 1, ... rounds, and at the end. The best sets known are those of all
    /// examinations.
    pub strength: Vec<Summary>,
    /// Strength on the tested patients.
    pub tested: Vec<Exam>,
    /// Games and sets that were trained on.
    pub games: usize,
    pub sets: usize,
}

/// Plays and trains. Games, features, the weights of each round and the checkpoint are kept in the folder, and a training that
/// was cut off goes on from there with the same numbers. Where games turn out to be in doubt, they are played again, and all
/// that was trained is trained again.
///
/// # Errors
/// Nothing to train on, an option that cannot be, a game that cannot be played, or a file that cannot be written.
pub fn train(
    schedule: &Schedule,
    options: &Options,
    folder: &Path,
    players: &mut dyn Players,
    report: Report<'_>,
) -> Result<Trained, TrainError> {
    let options = &Options { passes: schedule.all_passes(), ..options.clone() };
    // Before hours of games.
    check(options)?;
    let games = folder.join("games");
    loop {
        let mut run = Run {
            schedule,
            folder,
            games: Stored::new(&games, &mut *players)?,
            features: Features::new(&folder.join("features"))?,
            known: BTreeMap::new(),
            exams: Vec::new(),
            report,
            played: (0, 0),
        };
        let trained = run.all(options);
        let Err(TrainError::Doubtful(names)) = trained else { return trained };
        for path in names.iter().map(|name| file(&games, name)).chain([checkpoint(folder)]) {
            remove(&path)?;
        }
        report(Progress::Doubt(names));
    }
}

fn checkpoint(folder: &Path) -> PathBuf {
    folder.join("training.safetensors")
}

fn remove(path: &Path) -> Result<(), TrainError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(TrainError::File { path: path.to_owned(), why: e.to_string() })
        }
        _ => Ok(()),
    }
}

struct Run<'a> {
    schedule: &'a Schedule,
    folder: &'a Path,
    games: Stored<'a>,
    features: Features,
    /// Least cost that is known of each patient that is examined.
    known: BTreeMap<String, f64>,
    /// Examinations of the validated patients, by rounds.
    exams: Vec<Vec<Game>>,
    report: Report<'a>,
    /// Games and sets that were trained on.
    played: (usize, usize),
}

impl Run<'_> {
    fn all(&mut self, options: &Options) -> Result<Trained, TrainError> {
        let (schedule, report) = (self.schedule, self.report);
        let checkpoint = checkpoint(self.folder);
        let openings = self.play(None, &schedule.openings(&schedule.train, schedule.opening, "opening"))?;
        let validate = schedule.openings(&schedule.validate, schedule.reference, "reference");
        let validate = self.play(None, &validate)?;
        self.know(&validate);
        let examples = self.examples(&openings)?;
        let validation = self.examples(&validate)?;
        self.count(&openings);
        let about = serde_json::to_string(schedule).map_err(plan)?;
        let mut training = Training::new(about, options.clone(), scales(&examples))?;
        let mut buffer = Buffer::new(schedule.buffer);
        buffer.add(&training, examples)?;
        let validation: Vec<Ready> =
            validation.into_iter().map(|e| training.ready(e)).collect::<Result<_, _>>()?;
        match checkpoint.exists() {
            true => training.resume(&checkpoint)?,
            // Weights of another training that had no checkpoint yet.
            false => remove_weights(self.folder)?,
        }
        while training.passes().len() < schedule.start {
            report(Progress::Pass(training.pass(&buffer.all(), &validation)?));
            training.keep(&checkpoint)?;
        }
        for (round, patients) in schedule.rounds.iter().enumerate() {
            // The weights with which a round began stay in a file, so that its games can be read or played again.
            let model = weights(self.folder, round, &training)?;
            let mut due = schedule.games(round, patients);
            due.extend(schedule.exams(round, &schedule.validate));
            let upto = schedule.start + (round + 1) * schedule.passes;
            let descend = || -> Result<(), TrainError> {
                while training.passes().len() < upto {
                    report(Progress::Pass(training.pass(&buffer.all(), &validation)?));
                }
                Ok(())
            };
            let (played, trained) = std::thread::scope(|scope| {
                let trained = scope.spawn(descend);
                (play(&mut self.games, Some(&model), &due, report), trained.join())
            });
            trained.map_err(|_| TrainError::Plan("the thread of the descent panicked".to_owned()))??;
            let mut played = played?;
            training.keep(&checkpoint)?;
            self.examine(round, played.split_off(patients.len()));
            let examples = self.examples(&played)?;
            self.count(&played);
            buffer.add(&training, examples)?;
        }
        while training.passes().len() < schedule.all_passes() {
            report(Progress::Pass(training.pass(&buffer.all(), &validation)?));
            training.keep(&checkpoint)?;
        }
        let (model, last) = (training.model()?, schedule.rounds.len());
        let exams = self.play(Some(&model), &schedule.exams(last, &schedule.validate))?;
        self.examine(last, exams);
        let tests = schedule.openings(&schedule.test, schedule.reference, "reference");
        let tests = self.play(None, &tests)?;
        self.know(&tests);
        let exams = self.play(Some(&model), &schedule.exams(last, &schedule.test))?;
        self.know(&exams);
        Ok(Trained {
            model,
            passes: training.passes().to_vec(),
            strength: self.exams.iter().map(|exams| self.summary(exams)).collect(),
            tested: exams.iter().map(|game| Exam::of(game, self.best(game))).collect(),
            games: self.played.0,
            sets: self.played.1,
        })
    }

    fn play(&mut self, network: Option<&Model>, due: &[Due]) -> Result<Vec<Game>, TrainError> {
        play(&mut self.games, network, due, self.report)
    }

    /// The examples of games that are trained on or validated with.
    fn examples(&mut self, games: &[Game]) -> Result<Vec<Example>, TrainError> {
        let mut all = Vec::new();
        for game in games {
            all.push(Example::new(self.features.of(&game.patient)?, &[game])?);
            (self.report)(Progress::Features(all.len(), games.len()));
        }
        Ok(all)
    }

    fn count(&mut self, games: &[Game]) {
        self.played.0 += games.len();
        self.played.1 += games.iter().map(|game| game.sets.len()).sum::<usize>();
    }

    /// Notes the best sets of these patients.
    fn know(&mut self, games: &[Game]) {
        for game in games {
            let best = self.known.entry(game.patient.name()).or_insert(f64::INFINITY);
            *best = best.min(game.best());
        }
    }

    fn examine(&mut self, rounds: usize, exams: Vec<Game>) {
        self.know(&exams);
        (self.report)(Progress::Strength(rounds, self.summary(&exams)));
        self.exams.push(exams);
    }

    fn best(&self, game: &Game) -> f64 {
        self.known.get(&game.patient.name()).copied().unwrap_or(f64::NAN)
    }

    fn summary(&self, exams: &[Game]) -> Summary {
        Summary::of(&exams.iter().map(|game| Exam::of(game, self.best(game))).collect::<Vec<_>>())
    }
}

/// The newest games, ready for the descent.
struct Buffer {
    ready: VecDeque<Ready>,
    most: usize,
}

impl Buffer {
    fn new(most: usize) -> Self {
        Self { ready: VecDeque::new(), most: most.max(1) }
    }

    fn add(&mut self, training: &Training, examples: Vec<Example>) -> Result<(), TrainError> {
        for example in examples {
            self.ready.push_back(training.ready(example)?);
        }
        while self.ready.len() > self.most {
            self.ready.pop_front();
        }
        Ok(())
    }

    fn all(&self) -> Vec<&Ready> {
        self.ready.iter().collect()
    }
}

impl Schedule {
    pub fn all_passes(&self) -> usize {
        self.start + self.rounds.len() * self.passes + self.end
    }

    fn openings(&self, patients: &[Patient], rules: Rules, kind: &str) -> Vec<Due> {
        let due = |patient: &Patient| self.due(format!("{kind}-{}", patient.name()), patient, 0, rules);
        patients.iter().map(due).collect()
    }

    fn games(&self, round: usize, patients: &[Patient]) -> Vec<Due> {
        let due = |(place, patient): (usize, &Patient)| {
            let number = ((round as u64) << 32) + place as u64 + 1;
            self.due(format!("round-{round:03}-{place:04}"), patient, number, self.game)
        };
        patients.iter().enumerate().map(due).collect()
    }

    fn exams(&self, rounds: usize, patients: &[Patient]) -> Vec<Due> {
        let due = |patient: &Patient| {
            self.due(format!("exam-{rounds:03}-{}", patient.name()), patient, 0, self.exam)
        };
        patients.iter().map(due).collect()
    }

    fn due(&self, name: String, patient: &Patient, number: u64, rules: Rules) -> Due {
        // Games of different numbers draw from different streams, and so do trainings of different seeds.
        let seed = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(number);
        Due { name, patient: patient.clone(), seed, rules }
    }
}

/// Plays these games, and gives them in their order.
fn play(
    players: &mut Stored<'_>,
    network: Option<&Model>,
    due: &[Due],
    report: Report<'_>,
) -> Result<Vec<Game>, TrainError> {
    let mut games: Vec<Option<Game>> = vec![None; due.len()];
    players.play(network, due, &mut |place, game| {
        games[place] = Some(game);
        report(Progress::Game(games.iter().flatten().count(), due.len()));
        Ok(())
    })?;
    let missing = || TrainError::Plan("the players left a game out".to_owned());
    games.into_iter().map(|game| game.ok_or_else(missing)).collect()
}

/// File of the weights with which a round begins.
fn weights_file(folder: &Path, round: usize) -> PathBuf {
    folder.join(format!("weights-{round:03}.safetensors"))
}

fn remove_weights(folder: &Path) -> Result<(), TrainError> {
    (0..)
        .map(|round| weights_file(folder, round))
        .take_while(|path| path.exists())
        .try_for_each(|path| remove(&path))
}

/// The weights with which a round begins: from their file, else as the descent stands, and then kept.
fn weights(folder: &Path, round: usize, training: &Training) -> Result<Model, TrainError> {
    let path = weights_file(folder, round);
    if let Ok(bytes) = std::fs::read(&path) {
        return Model::from_safetensors(&bytes).map_err(|e| TrainError::File { path, why: e.to_string() });
    }
    let model = training.model()?;
    let bytes = model.to_safetensors().map_err(plan)?;
    let part = path.with_extension("part");
    std::fs::write(&part, bytes)
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|e| TrainError::File { path, why: e.to_string() })?;
    Ok(model)
}
