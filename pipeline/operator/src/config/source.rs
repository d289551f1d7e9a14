//! Texts that a pipeline is read from, and places in them.

/// Most bytes of a pipeline.
pub const MOST_BYTES: usize = 256 * 1024;

/// A place in a source text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span {
    /// Number of the text: 0 is the file, then the `--set` arguments in their order.
    pub source: usize,
    /// First byte.
    pub start: usize,
    /// Byte behind the last.
    pub end: usize,
    /// Line of the first byte, from 1.
    pub line: usize,
    /// Column of the first byte in characters, from 1.
    pub column: usize,
}

impl Span {
    /// The place of the first `bytes` bytes of this one.
    pub fn first(self, bytes: usize) -> Self {
        Self { end: self.end.min(self.start + bytes), ..self }
    }
}

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Marked<T> {
    /// The value.
    pub value: T,
    /// Place in the text.
    pub span: Span,
}

impl<T> Marked<T> {
    /// A value at a place.
    pub fn new(value: T, span: Span) -> Self {
        Self { value, span }
    }
}

/// A text that a pipeline is read from.
#[derive(Clone, Debug)]
pub struct Source {
    /// Name as people see it: the file, or `--set` with its argument.
    pub name: String,
    /// The text.
    pub text: String,
}

/// The texts that a pipeline is read from: the file, then the `--set` arguments.
#[derive(Clone, Debug, Default)]
pub struct Sources(Vec<Source>);

impl Sources {
    /// The file and the arguments.
    pub fn new(file_name: &str, text: &str, sets: &[String]) -> Self {
        let file = Source { name: file_name.to_owned(), text: text.to_owned() };
        let sets = sets.iter().map(|s| Source { name: "--set".into(), text: s.clone() });
        Self(std::iter::once(file).chain(sets).collect())
    }

    /// The text that a place is in.
    pub fn of(&self, span: Span) -> Option<&Source> {
        self.0.get(span.source)
    }

    /// `file.yaml:line:column`, or the `--set` argument.
    pub fn place(&self, span: Span) -> String {
        match self.of(span) {
            Some(s) if span.source == 0 => format!("{}:{}:{}", s.name, span.line, span.column),
            Some(s) => format!("{} {}", s.name, super::quote::shown(&s.text)),
            None => String::new(),
        }
    }
}
