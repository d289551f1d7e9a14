//! Which reader takes a file.

use super::curve::Measured;
use super::error::{MeasuredError, MeasuredFault};
use super::{csv, mcc, w2cad};

/// Most bytes of a file: exports of a water tank have some hundred kilobytes.
const MOST_BYTES: usize = 64 << 20;

/// Reads measured doses: a CSV table, W2CAD or PTW (mcc), by its content.
///
/// # Errors
/// The first fault of the file, with its line.
pub fn read(name: &str, bytes: &[u8]) -> Result<Measured, MeasuredError> {
    let at = |line, fault| MeasuredError { file: name.to_owned(), line, fault };
    if bytes.len() > MOST_BYTES {
        return Err(at(1, MeasuredFault::Large { bytes: bytes.len(), most: MOST_BYTES }));
    }
    let text = std::str::from_utf8(bytes).map_err(|fault| {
        let byte = fault.valid_up_to();
        let line = 1 + bytes[..byte].iter().filter(|byte| **byte == b'\n').count();
        at(line, MeasuredFault::NotText { byte })
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let is_mark = |mark: &str| text.lines().any(|line| line.trim().replace(' ', "").starts_with(mark));
    let measured = if is_mark("BEGIN_SCAN_DATA") {
        mcc::read(name, text)?
    } else if is_mark("$STOM") || is_mark("$NUMS") {
        w2cad::read(name, text)?
    } else {
        csv::read(name, text)?
    };
    if measured.curves.is_empty() && measured.outputs.is_empty() && measured.calibrations.is_empty() {
        return Err(at(1, MeasuredFault::Empty));
    }
    Ok(measured)
}
