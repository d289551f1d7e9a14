//! From the bytes of a file to its text.

use super::faults::{Code, Faults, Findings};
use super::source::{MOST_BYTES, Sources, Span};

/// The text of a file, or the fault that it is none.
pub fn text(bytes: Vec<u8>, file_name: &str) -> Result<String, Faults> {
    // Where it was cut there may be half a character: what is wrong with it is its length.
    if bytes.len() > MOST_BYTES {
        return Ok(String::from_utf8_lossy(&bytes).into_owned());
    }
    let error = match String::from_utf8(bytes) {
        Ok(text) => return Ok(text),
        Err(error) => error,
    };
    let good = error.utf8_error().valid_up_to();
    let byte = error.as_bytes()[good];
    // What stands behind the fault on its line need not be text either.
    let shown = String::from_utf8_lossy(error.as_bytes()).into_owned();
    let before = &shown[..good];
    let line = before.rsplit('\n').next().unwrap_or_default();
    let span = Span {
        source: 0,
        start: good,
        end: good + char::REPLACEMENT_CHARACTER.len_utf8(),
        line: 1 + before.matches('\n').count(),
        column: 1 + line.chars().count(),
    };
    let findings = Findings::default();
    findings.say(
        span,
        Code::Syntax,
        format!("the byte 0x{byte:02x} is here, which is not UTF-8 text"),
        "save the file as UTF-8 text; is this the file of a pipeline?",
    );
    Err(findings.into_faults(Sources::new(file_name, &shown, &[])))
}
