//! The calls of a run as a file: kinds, sizes, times and workers of all calls, and the client's own time between them. A
//! simulation with other workers and another network starts from it; see `simulate`.
//!
//! The file has one JSON object per line: a head with the version, the sizes of contents, calls, rounds, and an end. Times are
//! seconds since the client began.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::Hash;
use crate::call::Kind;

/// Version of the format.
const VERSION: u32 = 1;

/// All calls of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Build of client and workers.
    pub build: String,
    /// Bytes of each content: arguments and answers.
    pub contents: Vec<u64>,
    /// Calls in the order in which they were asked first.
    pub calls: Vec<RecordedCall>,
    /// Rounds of the client.
    pub rounds: Vec<Round>,
    /// What the client spent on messages.
    pub handled: Handled,
}

/// A call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordedCall {
    /// `dose`, `solve`, `price` or `game`.
    pub kind: String,
    /// Bytes of the call itself.
    pub bytes: u64,
    /// Its arguments, by their place among the contents.
    pub inputs: Vec<usize>,
    /// Its answer, by its place among the contents; none if no answer came.
    pub answer: Option<usize>,
    /// The call whose answer had to be there before this one was asked, where it was asked at once behind that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<usize>,
    /// When it was asked first, s.
    pub submitted_s: f64,
    /// Time in which the caller took the answer (a dose goes into a file), s.
    pub taken_s: f64,
    /// Those who computed it.
    pub attempts: Vec<Attempt>,
}

/// One computation of a call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// The worker; none: the client itself.
    pub worker: Option<String>,
    /// When the worker was asked, s.
    pub asked_s: f64,
    /// When its answer was there, s.
    pub answered_s: Option<f64>,
    /// Time in which the worker took messages with contents since its answer before, s.
    pub received_s: f64,
    /// Time in which the worker opened arguments, s.
    pub opened_s: f64,
    /// Time of the computation, s; none if the worker did not report it.
    pub computed_s: Option<f64>,
}

/// Calls that the client asked together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// When it began, s.
    pub begun_s: f64,
    /// When the client went on with its own work, s.
    pub ended_s: f64,
    /// The calls without an answer, in the order of asking.
    pub calls: Vec<usize>,
    /// The calls whose answers the client needed to go on.
    pub needs: Vec<usize>,
}

/// What the client spent on messages of workers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Handled {
    /// Their number.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
    /// The time, s.
    pub seconds: f64,
}

/// Why a record cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A line is not one of a record.
    #[error("line {line} of the record of calls cannot be read: {error}")]
    Line {
        /// Its number, from 1.
        line: usize,
        /// Why not.
        error: serde_json::Error,
    },
    /// The first line is not the head of this version.
    #[error(
        "the record of calls does not begin with the head of version {VERSION}; record it with this build"
    )]
    Version,
    /// The last line is missing: the run did not end.
    #[error("the record of calls has no end: the run that wrote it did not finish")]
    NoEnd,
    /// A number points beyond its list.
    #[error("the record of calls names {what} {place}, and has only {count}")]
    Place {
        /// What is named.
        what: &'static str,
        /// Its place.
        place: usize,
        /// How many there are.
        count: usize,
    },
}

#[derive(Serialize, Deserialize)]
#[serde(tag = "line", rename_all = "snake_case")]
enum Line {
    Head { version: u32, build: String },
    Contents { bytes: Vec<u64> },
    Call(RecordedCall),
    Round(Round),
    End(Handled),
}

impl Record {
    /// The lines of the file.
    pub fn to_text(&self) -> String {
        let head = [
            Line::Head { version: VERSION, build: self.build.clone() },
            Line::Contents { bytes: self.contents.clone() },
        ];
        let calls = self.calls.iter().cloned().map(Line::Call);
        let rounds = self.rounds.iter().cloned().map(Line::Round);
        let lines = head.into_iter().chain(calls).chain(rounds).chain([Line::End(self.handled)]);
        // Names of lines and finite numbers: none fails to be written.
        lines.map(|line| serde_json::to_string(&line).unwrap_or_default() + "\n").collect()
    }

    /// Reads the lines of a file.
    ///
    /// # Errors
    /// A line cannot be read, the file is of another version or has no end, or a number points beyond its list.
    pub fn from_text(text: &str) -> Result<Self, RecordError> {
        let mut record = Self::default();
        let mut has_end = false;
        for (number, line) in text.lines().enumerate() {
            let line = serde_json::from_str(line).map_err(|error| match number {
                0 => RecordError::Version,
                _ => RecordError::Line { line: number + 1, error },
            })?;
            match line {
                Line::Head { version, build } if version == VERSION => record.build = build,
                Line::Head { .. } => return Err(RecordError::Version),
                _ if number == 0 => return Err(RecordError::Version),
                Line::Contents { bytes } => record.contents.extend(bytes),
                Line::Call(call) => record.calls.push(call),
                Line::Round(round) => record.rounds.push(round),
                Line::End(handled) => (record.handled, has_end) = (handled, true),
            }
        }
        if !has_end {
            return Err(RecordError::NoEnd);
        }
        record.check()?;
        Ok(record)
    }

    fn check(&self) -> Result<(), RecordError> {
        let within = |what, place: &usize, count| match *place < count {
            true => Ok(()),
            false => Err(RecordError::Place { what, place: *place, count }),
        };
        let mut contents = self.calls.iter().flat_map(|call| call.inputs.iter().chain(&call.answer));
        contents.try_for_each(|place| within("content", place, self.contents.len()))?;
        let mut calls = self.rounds.iter().flat_map(|round| round.calls.iter().chain(&round.needs));
        let mut before = self.calls.iter().filter_map(|call| call.after.as_ref());
        before.try_for_each(|place| within("call", place, self.calls.len()))?;
        calls.try_for_each(|place| within("call", place, self.calls.len()))
    }

    /// Time of the calls from the begin of the first round to the end of the last one, s.
    pub fn seconds(&self) -> f64 {
        let first = self.rounds.first().map_or(0.0, |round| round.begun_s);
        self.rounds.last().map_or(0.0, |round| round.ended_s - first)
    }

    /// Computation of all different calls, s.
    pub fn work_s(&self) -> f64 {
        self.calls.iter().filter_map(RecordedCall::computed_s).sum()
    }
}

impl RecordedCall {
    /// Time of its computation, by the first who reported it, s.
    pub fn computed_s(&self) -> Option<f64> {
        self.attempts.iter().find_map(|attempt| attempt.computed_s)
    }
}

/// Writes down what a client asks and gets.
#[derive(Default)]
pub struct Recorder {
    record: Record,
    calls: BTreeMap<Hash, usize>,
    contents: BTreeMap<Hash, usize>,
    /// The calls of the next round whose answers are needed, where these are not the first of them.
    needs: Option<Vec<Hash>>,
}

impl Recorder {
    /// Of a client of this build.
    pub fn new(build: &str) -> Self {
        Self { record: Record { build: build.to_owned(), ..Record::default() }, ..Self::default() }
    }

    /// What was written down.
    pub fn into_record(self) -> Record {
        self.record
    }

    /// Whether the size of this content is known.
    pub fn has(&self, content: &Hash) -> bool {
        self.contents.get(content).is_some_and(|place| self.record.contents[*place] > 0)
    }

    /// The size of a content.
    pub fn content(&mut self, name: Hash, bytes: u64) -> usize {
        let contents = &mut self.record.contents;
        let place = *self.contents.entry(name).or_insert_with(|| {
            contents.push(0);
            contents.len() - 1
        });
        contents[place] = contents[place].max(bytes);
        place
    }

    /// A call was asked.
    pub fn submitted(&mut self, now: u64, key: Hash, (kind, bytes, inputs): (Kind, u64, &[Hash])) {
        if self.calls.contains_key(&key) {
            return;
        }
        self.calls.insert(key, self.record.calls.len());
        let inputs = inputs.iter().map(|input| self.content(*input, 0)).collect();
        self.record.calls.push(RecordedCall {
            kind: kind.word().to_owned(),
            bytes,
            inputs,
            answer: None,
            after: None,
            submitted_s: seconds(now),
            taken_s: 0.0,
            attempts: Vec::new(),
        });
    }

    /// These calls were asked because the answer of another one was there.
    pub fn follow(&mut self, keys: &[Hash], after: &Hash) {
        let after = self.calls.get(after).copied();
        for key in keys {
            if let Some(call) = self.call(key) {
                call.after = after;
            }
        }
    }

    fn call(&mut self, key: &Hash) -> Option<&mut RecordedCall> {
        self.record.calls.get_mut(*self.calls.get(key)?)
    }

    /// A worker was asked.
    pub fn asked(&mut self, now: u64, key: &Hash, worker: &str) {
        if let Some(call) = self.call(key) {
            call.attempts.push(Attempt {
                worker: Some(worker.to_owned()),
                asked_s: seconds(now),
                answered_s: None,
                received_s: 0.0,
                opened_s: 0.0,
                computed_s: None,
            });
        }
    }

    /// A worker reports its times.
    pub fn spent(&mut self, key: &Hash, worker: &str, spent: &crate::Spent) {
        if let Some(attempt) = self.attempt(key, worker) {
            attempt.received_s = seconds(spent.received);
            attempt.opened_s = seconds(spent.opened);
            attempt.computed_s = Some(seconds(spent.computed));
        }
    }

    fn attempt(&mut self, key: &Hash, worker: &str) -> Option<&mut Attempt> {
        let of = |attempt: &&mut Attempt| attempt.worker.as_deref() == Some(worker);
        self.call(key)?.attempts.iter_mut().rev().find(of)
    }

    /// The answer of a worker is there.
    pub fn answered(&mut self, now: u64, key: &Hash, worker: &str, answer: &[u8]) {
        if let Some(attempt) = self.attempt(key, worker) {
            attempt.answered_s = Some(seconds(now));
        }
        self.answer(key, answer);
    }

    /// This process computed the answer.
    pub fn computed_here(&mut self, (begun, ended): (u64, u64), key: &Hash, answer: &[u8]) {
        if let Some(call) = self.call(key) {
            call.attempts.push(Attempt {
                worker: None,
                asked_s: seconds(begun),
                answered_s: Some(seconds(ended)),
                received_s: 0.0,
                opened_s: 0.0,
                computed_s: Some(seconds(ended.saturating_sub(begun))),
            });
        }
        self.answer(key, answer);
    }

    fn answer(&mut self, key: &Hash, answer: &[u8]) {
        if self.call(key).is_none_or(|call| call.answer.is_some()) {
            return;
        }
        let place = self.content(Hash::of(answer), answer.len() as u64);
        if let Some(call) = self.call(key) {
            call.answer = Some(place);
        }
    }

    /// The next round needs the answers of these calls.
    pub fn needs(&mut self, keys: &[Hash]) {
        self.needs = Some(keys.to_vec());
    }

    /// A round begins: calls, and how many of the first of them are needed.
    pub fn begin_round(&mut self, now: u64, keys: &[Hash], awaited: usize) {
        let needs = self.needs.take().unwrap_or_else(|| keys[..awaited.min(keys.len())].to_vec());
        let places = |keys: &[Hash]| keys.iter().filter_map(|key| self.calls.get(key).copied()).collect();
        let (begun_s, calls, needs) = (seconds(now), places(keys), places(&needs));
        self.record.rounds.push(Round { begun_s, ended_s: begun_s, calls, needs });
    }

    /// The round ends.
    pub fn end_round(&mut self, now: u64) {
        if let Some(round) = self.record.rounds.last_mut() {
            round.ended_s = seconds(now);
        }
    }

    /// The caller took an answer for so long.
    pub fn taken(&mut self, key: &Hash, time: u64) {
        if let Some(call) = self.call(key) {
            call.taken_s += seconds(time);
        }
    }

    /// A message of a worker was taken.
    pub fn handled(&mut self, bytes: usize, time: u64) {
        let handled = &mut self.record.handled;
        handled.messages += 1;
        handled.bytes += bytes as u64;
        handled.seconds += seconds(time);
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        let mut recorder = Recorder::new("a build");
        let [key, other, input] = [b"key".as_slice(), b"other", b"input"].map(Hash::of);
        recorder.content(input, 70);
        recorder.submitted(1_000_000_000, key, (Kind::Solve, 99, &[input]));
        recorder.submitted(1_000_000_000, other, (Kind::Price, 40, &[input]));
        recorder.begin_round(1_000_000_000, &[key, other], 1);
        recorder.asked(1_500_000_000, &key, "w");
        let spent = crate::Spent { received: 1, opened: 2, computed: 3_000_000_000, length: 6 };
        recorder.spent(&key, "w", &spent);
        recorder.answered(5_000_000_000, &key, "w", b"answer");
        recorder.taken(&key, 250_000_000);
        recorder.handled(128, 1000);
        recorder.end_round(5_500_000_000);
        recorder.into_record()
    }

    #[test]
    fn a_record_is_read_as_it_is_written_and_has_the_times_of_its_calls() {
        let record = record();
        assert_eq!(Record::from_text(&record.to_text()).unwrap(), record);
        assert_eq!((record.seconds(), record.work_s()), (4.5, 3.0));
        assert_eq!(record.rounds[0].needs, [0]);
        assert_eq!(record.calls[0].answer.map(|answer| record.contents[answer]), Some(6));
    }

    #[test]
    fn a_record_of_another_version_without_an_end_or_with_a_wrong_place_is_refused() {
        let text = record().to_text();
        let other = text.replacen("\"version\":1", "\"version\":2", 1);
        assert!(matches!(Record::from_text(&other), Err(RecordError::Version)));
        assert!(matches!(Record::from_text("not a record"), Err(RecordError::Version)));
        let cut: String = text.lines().take(3).map(|line| format!("{line}\n")).collect();
        assert!(matches!(Record::from_text(&cut), Err(RecordError::NoEnd)));
        let wrong = text.replace("\"needs\":[0]", "\"needs\":[2]");
        let error = Record::from_text(&wrong).unwrap_err().to_string();
        assert_eq!(error, "the record of calls names call 2, and has only 2");
    }
}
