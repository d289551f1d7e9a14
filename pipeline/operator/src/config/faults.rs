//! Faults of a pipeline: what is wrong, where, and what to write instead.

use std::cell::RefCell;

use super::source::{Sources, Span};

/// Further faults are counted but not kept.
pub const MOST_FAULTS: usize = 200;

/// Kind of a fault, for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs)]
pub enum Code {
    Syntax,
    NotSupported,
    TooLarge,
    DuplicateName,
    UnknownKey,
    MissingKey,
    WrongShape,
    BadName,
    WrongVersion,
    UnknownOperator,
    UnknownKind,
    UnknownPort,
    UnknownFrame,
    UnknownChoice,
    UnknownUnit,
    UnknownTopic,
    Measured,
    MissingUnit,
    WrongUnit,
    NotANumber,
    OutOfRange,
    TypeMismatch,
    FrameMismatch,
    FrameMissing,
    FrameNotTaken,
    FrameCycle,
    MissingInput,
    MissingParam,
    TimerMissing,
    TimerForbidden,
    NeverActivated,
    Cycle,
    FileMissing,
    ProcessShared,
    CoreMissing,
    Host,
    Policy,
    Set,
    Variable,
    Include,
}

impl Code {
    /// All kinds, in their order.
    pub const ALL: &'static [Code] = &[
        Code::Syntax,
        Code::NotSupported,
        Code::TooLarge,
        Code::DuplicateName,
        Code::UnknownKey,
        Code::MissingKey,
        Code::WrongShape,
        Code::BadName,
        Code::WrongVersion,
        Code::UnknownOperator,
        Code::UnknownKind,
        Code::UnknownPort,
        Code::UnknownFrame,
        Code::UnknownChoice,
        Code::UnknownUnit,
        Code::UnknownTopic,
        Code::Measured,
        Code::MissingUnit,
        Code::WrongUnit,
        Code::NotANumber,
        Code::OutOfRange,
        Code::TypeMismatch,
        Code::FrameMismatch,
        Code::FrameMissing,
        Code::FrameNotTaken,
        Code::FrameCycle,
        Code::MissingInput,
        Code::MissingParam,
        Code::TimerMissing,
        Code::TimerForbidden,
        Code::NeverActivated,
        Code::Cycle,
        Code::FileMissing,
        Code::ProcessShared,
        Code::CoreMissing,
        Code::Host,
        Code::Policy,
        Code::Set,
        Code::Variable,
        Code::Include,
    ];

    /// The kind as it stands in JSON: `unknown-key`.
    pub fn name(self) -> String {
        let mut name = String::new();
        for c in format!("{self:?}").chars() {
            if c.is_uppercase() && !name.is_empty() {
                name.push('-');
            }
            name.extend(c.to_lowercase());
        }
        name
    }
}

/// What is wrong and what to write instead, without the place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// Kind of the fault.
    pub code: Code,
    /// What is wrong and why, in a sentence.
    pub message: String,
    /// What to write instead.
    pub help: String,
}

impl Complaint {
    /// A complaint.
    pub fn new(code: Code, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { code, message: message.into(), help: help.into() }
    }

    /// The complaint with the key that it is about.
    pub fn about(mut self, key: &str) -> Self {
        self.message = format!("`{key}`: {}", self.message);
        self
    }
}

/// A fault: a complaint and its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Place in the text.
    pub span: Span,
    /// Kind of the fault.
    pub code: Code,
    /// What is wrong and why, in a sentence.
    pub message: String,
    /// What to write instead.
    pub help: String,
}

/// Faults as they are found.
#[derive(Debug, Default)]
pub struct Findings {
    retained: RefCell<Vec<Fault>>,
    more: std::cell::Cell<usize>,
}

impl Findings {
    /// Adds a fault.
    pub fn add(&self, span: Span, complaint: Complaint) {
        let mut retained = self.retained.borrow_mut();
        if retained.len() == MOST_FAULTS {
            self.more.set(self.more.get() + 1);
            return;
        }
        let Complaint { code, message, help } = complaint;
        retained.push(Fault { span, code, message, help });
    }

    /// Adds a fault in parts.
    pub fn say(&self, span: Span, code: Code, message: impl Into<String>, help: impl Into<String>) {
        self.add(span, Complaint::new(code, message, help));
    }

    /// Whether more faults would only be counted, so that looking for suggestions is idle.
    pub fn is_full(&self) -> bool {
        self.retained.borrow().len() >= MOST_FAULTS
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.retained.borrow().is_empty()
    }

    /// Whether there is one within a place.
    pub fn any_within(&self, span: Span) -> bool {
        let within =
            |f: &Fault| f.span.source == span.source && f.span.start >= span.start && f.span.end <= span.end;
        self.retained.borrow().iter().any(within)
    }

    /// The faults in the order of their places.
    pub fn into_faults(self, sources: Sources) -> Faults {
        let mut list = self.retained.into_inner();
        list.sort_by(|a, b| (a.span, a.code, &a.message).cmp(&(b.span, b.code, &b.message)));
        list.dedup();
        Faults { sources, list, more: self.more.get() }
    }
}

/// All faults of a pipeline, in the order of their places. `Display` shows them to people.
#[derive(Clone, Debug)]
pub struct Faults {
    pub(super) sources: Sources,
    pub(super) list: Vec<Fault>,
    pub(super) more: usize,
}

impl std::error::Error for Faults {}

impl Faults {
    /// The faults.
    pub fn list(&self) -> &[Fault] {
        &self.list
    }

    /// The texts that they are in.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// Number of faults, those that were only counted included.
    pub fn count(&self) -> usize {
        self.list.len() + self.more
    }
}
