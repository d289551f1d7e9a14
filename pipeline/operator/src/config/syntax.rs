//! Messages for a text that is not YAML: the most likely mistake, at its place. The scanner notices some mistakes a
//! line later.

use super::near::shown;
use super::places::Places;
use super::source::Span;

/// A text in which the scanner found no YAML.
pub(super) struct Mistake<'t> {
    places: &'t Places<'t>,
    /// The scanner's message.
    info: &'t str,
    /// The place that the scanner reports.
    noticed: Span,
    /// The line at that place.
    line: &'t str,
    /// The innermost bracket that is still open.
    open: Option<(Span, char)>,
}

/// The fault that is reported.
pub(super) struct Diagnosis {
    pub at: Span,
    pub message: String,
    pub help: String,
}

impl<'t> Mistake<'t> {
    pub fn new(places: &'t Places<'t>, info: &'t str, noticed: Span, open: Option<(Span, char)>) -> Self {
        let line = places.text.lines().nth(noticed.line - 1).unwrap_or("");
        Self { places, info, noticed, line, open }
    }

    /// The likeliest mistake.
    pub fn found(&self) -> Diagnosis {
        self.tab()
            .or_else(|| self.anchor())
            .or_else(|| self.variable())
            .or_else(|| self.unprintable())
            .or_else(|| self.quote())
            .or_else(|| self.no_key())
            .or_else(|| self.unclosed())
            .unwrap_or_else(|| self.other())
    }

    fn here(&self, message: impl Into<String>, help: impl Into<String>) -> Diagnosis {
        Diagnosis { at: self.noticed, message: message.into(), help: help.into() }
    }

    fn not_yaml(&self, help: &str) -> Diagnosis {
        self.here(format!("this is not YAML: {}", self.info), help)
    }

    fn tab(&self) -> Option<Diagnosis> {
        let mut indent = self.line.chars().take_while(|c| c.is_whitespace());
        indent
            .any(|c| c == '\t')
            .then(|| self.here("a tab indents this line, which YAML forbids", "indent with spaces"))
    }

    /// An alias, or a pattern without quotes.
    fn anchor(&self) -> Option<Diagnosis> {
        if !self.info.contains("anchor") {
            return None;
        }
        let behind = self.line.chars().skip(self.noticed.column - 1);
        let text: String = behind.take_while(|c| !matches!(c, ',' | ']' | '}' | ' ')).collect();
        let help = match text.strip_prefix('*') {
            Some(rest) if rest.chars().any(|c| !c.is_alphanumeric() && c != '_') => {
                format!("if it is a text, put it in quotes: `\"{text}\"`")
            }
            _ => "write the value itself".into(),
        };
        Some(self.here("this names an anchor, which a pipeline does not have", help))
    }

    /// A variable of the environment between brackets, without quotes.
    fn variable(&self) -> Option<Diagnosis> {
        let behind = self.open.is_some()
            && self.line.chars().skip(self.noticed.column - 1).collect::<String>().starts_with('{');
        let before = self.line.chars().nth(self.noticed.column.checked_sub(2)?)?;
        (behind && before == '$').then(|| {
            self.here(
                "`${` is here, and between brackets YAML takes its `{` for a mapping",
                "put the path in quotes: `\"${NAME}/file\"`",
            )
        })
    }

    fn unprintable(&self) -> Option<Diagnosis> {
        let behind = || &self.places.text[self.noticed.start - self.places.offset..];
        self.info.contains("unprintable").then(|| {
            let found = behind().chars().next().unwrap_or('\0');
            self.here(
                format!("the character U+{:04X} is here, which YAML text does not allow", found as u32),
                "remove it; is this the file of a pipeline?",
            )
        })
    }

    /// Quotes that are not closed, or are missing.
    fn quote(&self) -> Option<Diagnosis> {
        if self.info.contains("quote") {
            return Some(self.not_yaml("close the quotes"));
        }
        let odd = self.info.contains("unexpected character");
        odd.then(|| self.not_yaml("put the text that it belongs to in quotes"))
    }

    /// The line before, where that was to be a key with its value and is none.
    fn no_key(&self) -> Option<Diagnosis> {
        let may_be = self.info.contains("simple key") || self.info.contains("mapping values");
        if self.open.is_some() || !may_be {
            return None;
        }
        let lines = self.places.text.split_inclusive('\n').enumerate().take(self.noticed.line - 1);
        let has_text = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
        let (number, line) = lines.filter(|(_, line)| has_text(line)).last()?;
        let text = line.trim();
        if text.ends_with(':') || text.contains(": ") || text.starts_with(['-', '"', '\'']) {
            return None;
        }
        let indent = line.len() - line.trim_start().len();
        let before = self.places.text.split_inclusive('\n').take(number).map(str::len).sum::<usize>();
        let start = before + indent;
        let at = self.places.at(start, start + text.len(), number + 1, line[..indent].chars().count());
        let (message, key, value) = match text.split_once(':') {
            Some((key, value)) => ("a space is missing behind this `:`", key, value),
            None => {
                let (key, value) = text.split_once(' ').unwrap_or((text, "..."));
                ("this line has no `:` behind its key", key, value)
            }
        };
        let help = format!("write {}", shown(&format!("{key}: {}", value.trim())));
        Some(Diagnosis { at, message: message.into(), help })
    }

    /// A bracket of a line before.
    fn unclosed(&self) -> Option<Diagnosis> {
        let (at, bracket) = self.open.filter(|(at, _)| at.line < self.noticed.line)?;
        let close = if bracket == '{' { '}' } else { ']' };
        Some(Diagnosis {
            at: at.first(1),
            message: format!("this `{bracket}` is not closed where a `,` or `{close}` is expected"),
            help: format!("close it with `{close}`, or put a `,` between its entries"),
        })
    }

    fn other(&self) -> Diagnosis {
        let is_of_keys = self.info.contains("mapping values") || self.info.contains("block mapping");
        self.not_yaml(match (is_of_keys, self.open) {
            (true, _) => "indent the keys of one mapping alike, and put each on a line of its own",
            (false, Some(_)) => "put a `,` between the entries, and close each bracket",
            (false, None) => {
                "look for a missing colon, bracket, quote or indent in this line or the one before"
            }
        })
    }
}
