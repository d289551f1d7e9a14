//! Faults for people and for programs: underlined text, and JSON.

use std::fmt::{self, Display, Formatter};

use serde_json::{Value, json};

use super::faults::{Fault, Faults};
use super::source::{Source, Span};

/// Characters of a source line that are shown; a longer line is cut around the fault.
const WIDTH: usize = 120;

impl Display for Faults {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (i, fault) in self.list.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            self.show(f, fault)?;
        }
        if self.more > 0 {
            write!(f, "\nand {} more: mend these first\n", self.more)?;
        }
        Ok(())
    }
}

impl Faults {
    fn show(&self, f: &mut Formatter<'_>, fault: &Fault) -> fmt::Result {
        writeln!(f, "{}: {}", self.sources.place(fault.span), fault.message)?;
        if let Some(source) = self.sources.of(fault.span) {
            let (line, under) = excerpt(source, fault.span);
            let number = if source.is_file { fault.span.line.to_string() } else { String::new() };
            let gap = " ".repeat(number.len());
            writeln!(f, " {number} | {line}")?;
            writeln!(f, " {gap} | {under}")?;
        }
        writeln!(f, "  help: {}", fault.help)
    }

    /// The faults as a JSON list; lines and columns count from 1, columns in characters.
    pub fn to_json(&self) -> Value {
        let place = |f: &Fault| self.sources.of(f.span).map_or("", |s| s.name.as_str()).to_owned();
        self.list
            .iter()
            .map(|f| {
                json!({
                    "file": place(f), "line": f.span.line, "column": f.span.column,
                    "start": f.span.start, "end": f.span.end,
                    "code": f.code.name(), "message": f.message, "help": f.help,
                })
            })
            .collect()
    }
}

/// The line of a place, cut to `WIDTH`, and the marks under the place.
fn excerpt(source: &Source, span: Span) -> (String, String) {
    let text = &source.text;
    let start = floor(text, span.start);
    let end = floor(text, span.end).max(start);
    let is_break = |c: char| c == '\n' || c == '\r';
    let from = text[..start].rfind(is_break).map_or(0, |i| i + 1);
    let to = text[start..].find(is_break).map_or(text.len(), |i| start + i);
    let before = text[from..start].chars().count();
    let marked = text[start..end.min(to)].chars().count().max(1);
    let line = &text[from..to];
    let skip = if before + marked.min(40) > WIDTH { before.saturating_sub(WIDTH / 2) } else { 0 };
    let mut shown: String = line.chars().skip(skip).take(WIDTH).map(visible).collect();
    if line.chars().nth(skip + WIDTH).is_some() {
        shown.push('…');
    }
    let mut lead = before - skip;
    if skip > 0 {
        shown.insert(0, '…');
        lead += 1;
    }
    let marks = marked.min((WIDTH + 1).saturating_sub(lead).max(1));
    (shown.trim_end().to_owned(), format!("{}{}", " ".repeat(lead), "^".repeat(marks)))
}

/// The greatest character boundary that is not beyond `at`.
fn floor(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// A tab would shift the marks, a control character could drive a terminal.
fn visible(c: char) -> char {
    match c {
        '\t' => ' ',
        c if c.is_control() => '\u{fffd}',
        c => c,
    }
}
