//! Texts that a pipeline is read from, and places in them.

/// Most bytes of a pipeline.
pub const MOST_BYTES: usize = 256 * 1024;

/// A place in a source text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span {
    /// Number of the text: 0 is the file, then those that it includes, then the `--set` arguments, each in their order.
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
    /// Whether it is a file, in which a place has a line.
    pub is_file: bool,
}

impl Source {
    /// A file.
    pub fn file(name: &str, text: &str) -> Self {
        Self { name: name.to_owned(), text: text.to_owned(), is_file: true }
    }

    /// An argument of `--set`.
    pub fn argument(text: &str) -> Self {
        Self { name: "--set".to_owned(), text: text.to_owned(), is_file: false }
    }
}

/// The texts that a pipeline is read from: the file, those that it includes, then the `--set` arguments.
#[derive(Clone, Debug, Default)]
pub struct Sources(Vec<Source>);

impl Sources {
    /// The file and the arguments.
    pub fn new(file_name: &str, text: &str, sets: &[String]) -> Self {
        Self::of_files(vec![Source::file(file_name, text)], sets)
    }

    /// Several files and the arguments.
    pub fn of_files(files: Vec<Source>, sets: &[String]) -> Self {
        let sets = sets.iter().map(|set| Source::argument(set));
        Self(files.into_iter().chain(sets).collect())
    }

    /// The text that a place is in.
    pub fn of(&self, span: Span) -> Option<&Source> {
        self.0.get(span.source)
    }

    /// `file.yaml:line:column`, or the `--set` argument.
    pub fn place(&self, span: Span) -> String {
        match self.of(span) {
            Some(s) if s.is_file => format!("{}:{}:{}", s.name, span.line, span.column),
            Some(s) => format!("{} {}", s.name, super::quote::shown(&s.text)),
            None => String::new(),
        }
    }
}
