//! Character positions of the parser as places in a text.

use saphyr_parser::Marker;

use super::source::{MOST_BYTES, Span};

/// Character positions as places: the parser counts characters, a place counts bytes.
pub(super) struct Places<'t> {
    pub(super) text: &'t str,
    bytes: Option<Vec<usize>>,
    source: usize,
    pub(super) offset: usize,
}

impl<'t> Places<'t> {
    pub(super) fn new(text: &'t str, source: usize, offset: usize) -> Self {
        let bytes = (!text.is_ascii() && text.len() <= MOST_BYTES)
            .then(|| text.char_indices().map(|(i, _)| i).chain([text.len()]).collect());
        Self { text, bytes, source, offset }
    }

    pub(super) fn byte(&self, index: usize) -> usize {
        match &self.bytes {
            Some(b) => b.get(index).copied().unwrap_or(self.text.len()),
            None => index.min(self.text.len()),
        }
    }

    /// The place of these bytes, on a line from 1, behind so many characters of it.
    pub(super) fn at(&self, start: usize, end: usize, line: usize, column: usize) -> Span {
        let shift = if line <= 1 { self.offset } else { 0 };
        Span {
            source: self.source,
            start: start + self.offset,
            end: end.max(start) + self.offset,
            line: line.max(1),
            column: column + 1 + shift,
        }
    }

    pub(super) fn between(&self, start: Marker, end: Marker) -> Span {
        self.at(self.byte(start.index()), self.byte(end.index()), start.line(), start.col())
    }
}
