//! One incarnation of an operator in a program, behind the trait of all operators.

use std::io;
use std::panic::resume_unwind;

use serde_json::{Value, json};
use stillpoint_operator::params::CheckedParams;
use stillpoint_operator::program::params::{entries_to_json, span};
use stillpoint_operator::program::{frames_to_json, wire::Message};
use stillpoint_operator::{Activation, AdoptError, ErasedOperator, Outputs, Setup, SetupError, StepError};
use stillpoint_samples::Pieces;

use super::describe::{Declared, Given};
use super::process::{Ended, Process};
use crate::operator::{Files, FilesError};

/// An operator whose steps another process does.
pub struct ProgramOperator {
    declared: &'static Declared,
    process: Process,
}

impl ProgramOperator {
    /// Starts a process of the program, and lets it make the operator.
    pub fn new(given: &Given, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let declared = given.declared;
        let refused = |reason: &dyn std::fmt::Display| {
            SetupError(format!("{}: {reason}", declared.described.kind.name))
        };
        let (mut process, _) = declared.program.start().map_err(|e| refused(&e))?;
        let make = json!({
            "op": "make",
            "kind": declared.kind,
            "params": entries_to_json(&given.entries),
            "place": span(given.place),
            "operator": setup.operator,
            "every": setup.every,
            "connected": setup.connected,
            "input_frames": setup.input_frames,
            "output_frames": setup.output_frames,
            "frames": frames_to_json(setup.frames),
        });
        let answer = process.ask(&make, &[], setup.files).map_err(|e| refused(&e))?.head;
        if answer["made"] == true {
            return Ok(Self { declared, process });
        }
        if let Some(panic) = answer["panic"].as_str() {
            return Err(SetupError(format!("it panicked while it was made: {panic}")));
        }
        Err(SetupError(reason(&answer).to_owned()))
    }

    fn stepped(&mut self, activation: &Activation<'_>) -> io::Result<Message> {
        let mut strings = Vec::new();
        let mut inputs = Vec::new();
        for (input, port) in activation.inputs.iter().zip(self.declared.described.kind.inputs) {
            if let Some(Pieces { meta, payload }) = input.sample.map(|sample| sample.pieces) {
                let count = input.sample.map_or(0, |sample| sample.pieces.header().count as usize);
                let length = (count * port.sample.element_size).min(payload.len());
                strings.extend([meta, &payload[..length]]);
            }
            inputs.push(json!({
                "held": input.sample.map(|sample| sample.held), "missed": input.missed, "restarted": input.restarted,
            }));
        }
        let step = json!({
            "op": "step",
            "index": activation.index,
            "time": activation.time,
            "nominal": activation.nominal,
            "tick": activation.tick,
            "origin": activation.origin,
            "cause": activation.cause as u32,
            "port": activation.port,
            "seed": activation.key.seed,
            "operator": activation.key.operator,
            "incarnation": activation.key.incarnation,
            "inputs": inputs,
        });
        self.process.ask(&step, &strings, &Closed)
    }
}

fn reason(answer: &Value) -> &str {
    answer["refused"].as_str().or(answer["error"].as_str()).unwrap_or("it gave no reason")
}

impl ErasedOperator for ProgramOperator {
    fn adopt(&mut self, params: &CheckedParams) -> Result<(), AdoptError> {
        let given = params.value.downcast_ref::<Given>().ok_or_else(|| {
            AdoptError(format!("the parameters are not those of {}", self.declared.described.kind.name))
        })?;
        let adopt =
            json!({ "op": "adopt", "params": entries_to_json(&given.entries), "place": span(given.place) });
        let answer = self.process.ask(&adopt, &[], &Closed).unwrap_or_else(|e| unwind(&e));
        match answer.head["panic"].as_str() {
            Some(panic) => resume_unwind(Box::new(panic.to_owned())),
            None if answer.head["adopted"] == true => Ok(()),
            None => Err(AdoptError(reason(&answer.head).to_owned())),
        }
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let answer = self.stepped(activation).unwrap_or_else(|e| unwind(&e));
        let head = &answer.head;
        if let Some(panic) = head["panic"].as_str() {
            resume_unwind(Box::new(panic.to_owned()));
        }
        take(&answer, outputs)
    }
}

/// The words of an operator whose program a signal has ended. No activation caused that, so a journal does not say so.
pub struct Killed(pub String);

/// A process that is gone has no state any more, as after a panic: the operator begins anew.
fn unwind(error: &io::Error) -> ! {
    let ended = error.get_ref().and_then(|inner| inner.downcast_ref::<Ended>());
    match ended.is_some_and(|ended| ended.by_signal) {
        true => resume_unwind(Box::new(Killed(error.to_string()))),
        false => resume_unwind(Box::new(error.to_string())),
    }
}

/// Takes what a step sent.
fn take(answer: &Message, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let head = &answer.head;
    let Some(sent) = head["sent"].as_array() else { return Err(StepError(reason(head).to_owned())) };
    for (port, pieces) in sent.iter().zip(answer.strings.chunks(2)) {
        if let ([meta, payload], Some(port)) = (pieces, port.as_u64()) {
            outputs.send_pieces(port as usize, Pieces { meta: meta.get(), payload: payload.get() })?;
        }
    }
    if let Some(origin) = head["origin"].as_u64() {
        outputs.acquired_at(origin);
    }
    if head["finished"] == true {
        outputs.finish();
    }
    Ok(())
}

/// A step reads no files.
struct Closed;

impl Files for Closed {
    fn read(&self, _: &str) -> Result<Vec<u8>, FilesError> {
        Err(FilesError::Unavailable("a step reads no files"))
    }

    fn list(&self, _: &str) -> Result<Vec<String>, FilesError> {
        Err(FilesError::Unavailable("a step reads no files"))
    }
}
