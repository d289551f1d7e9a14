//! Numbers of a text file, strictly: what is not clearly a number is refused.

use super::error::MeasuredFault;

/// A finite number with a decimal point.
pub(super) fn number(what: &'static str, text: &str) -> Result<f64, MeasuredFault> {
    let text = text.trim();
    if text.contains(',') {
        return Err(MeasuredFault::DecimalComma { what, text: text.to_owned() });
    }
    // `parse` also takes "inf" and "nan", which are not finite.
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(MeasuredFault::NotANumber { what, text: text.chars().take(40).collect() }),
    }
}
