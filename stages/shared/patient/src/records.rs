//! What all readers of files and messages share: numbers of text files, the end of the records, and quotes in errors.

/// The most characters of a file or a message that an error quotes.
pub const MOST_QUOTED: usize = 60;

/// Bytes behind the last record of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the header says {expected} {items}, and {bytes} bytes of data follow the last one: correct the header"
)]
pub struct Surplus {
    /// What the header counts.
    pub items: &'static str,
    /// How many the header says.
    pub expected: usize,
    /// Bytes behind the last.
    pub bytes: usize,
}

/// Refuses bytes behind the last record of a file, other than padding by zeros or white space.
///
/// # Errors
/// How many bytes there are.
pub fn surplus(rest: &[u8], expected: usize) -> Result<(), Surplus> {
    match rest.iter().all(|b| *b == 0 || b.is_ascii_whitespace()) {
        true => Ok(()),
        false => Err(Surplus { items: "records", expected, bytes: rest.len() }),
    }
}

/// A number of a text file. Programs write a missing number in many ways: `nan`, `-nan(ind)`, `1.#QNAN`, `inf`.
#[must_use]
pub fn number(word: &[u8]) -> Option<f32> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| is_missing(text).then_some(f32::NAN))
}

/// The same in 64 bits.
#[must_use]
pub fn double(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| is_missing(text).then_some(f64::NAN))
}

/// Whether a word marks a missing number as the C library of a compiler does.
fn is_missing(text: &str) -> bool {
    let bare = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    bare.starts_with("nan(") && bare.ends_with(')')
        || ["1.#qnan", "1.#snan", "1.#ind", "1.#inf"].iter().any(|start| {
            // The C library of Windows fills up the digits with zeros.
            bare.strip_prefix(start).is_some_and(|rest| rest.bytes().all(|b| b == b'0'))
        })
}

/// A piece of a file or a message for an error: at most [`MOST_QUOTED`] characters, on one line.
#[must_use]
pub fn quoted(text: &str) -> String {
    let mut shown: String =
        text.chars().take(MOST_QUOTED).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(MOST_QUOTED).is_some() {
        shown.push_str("...");
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_all_programs_are_read() {
        for word in ["nan", "-nan", "NaN", "-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND00", "1.#INF", "inf"]
        {
            assert!(number(word.as_bytes()).is_some_and(|n| !n.is_finite()), "{word}");
        }
        assert_eq!(number(b"+.5"), Some(0.5));
        for word in ["0,5", "1.#", "nano", "x", ""] {
            assert_eq!(number(word.as_bytes()), None, "{word}");
        }
    }

    #[test]
    fn quotes_are_short_and_on_one_line() {
        let shown = quoted(&"a\n".repeat(30_000));
        assert!(shown.len() <= MOST_QUOTED + 3 && !shown.contains('\n'));
    }
}
