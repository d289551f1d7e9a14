//! Decimal numbers as they are written, before they become binary.

/// Most characters of a quantity.
const LONGEST: usize = 64;

/// A decimal number as written.
pub struct Decimal<'t> {
    negative: bool,
    whole: &'t str,
    fraction: &'t str,
    exponent: i32,
}

impl Decimal<'_> {
    /// The number times ten to `shift`, as a text that becomes the nearest double.
    pub fn text(&self, shift: i32) -> String {
        let sign = if self.negative { "-" } else { "" };
        format!("{sign}{}.{}e{}", self.whole, self.fraction, self.exponent + shift)
    }

    /// The digits as a whole number, and the power of ten that goes with it.
    pub fn digits(&self) -> Option<(i128, i32)> {
        let digits = format!("0{}{}", self.whole, self.fraction.trim_end_matches('0'));
        let dropped = self.fraction.len() - self.fraction.trim_end_matches('0').len();
        let value: i128 = digits.parse().ok()?;
        let power = self.exponent - (self.fraction.len() - dropped) as i32;
        Some((if self.negative { -value } else { value }, power))
    }

    /// Whether it is larger than what is counted anywhere.
    pub fn is_huge(&self) -> bool {
        self.text(0).parse().is_ok_and(|value: f64| value.abs() > 1e18)
    }

    /// The decimal times `factor` times ten to `shift`, where that is a whole number.
    pub fn shifted(&self, shift: i32, factor: i128) -> Option<i128> {
        let (digits, power) = self.digits()?;
        let mut value = digits.checked_mul(factor)?;
        let power = power + shift;
        for _ in 0..power.unsigned_abs() {
            if value == 0 {
                break;
            }
            if power > 0 {
                value = value.checked_mul(10)?;
            } else if value % 10 == 0 {
                value /= 10;
            } else {
                return None;
            }
        }
        Some(value)
    }
}

/// Splits a text into its number and the rest.
pub fn split(text: &str) -> Option<(Decimal<'_>, &str)> {
    let text = text.trim();
    if text.len() > LONGEST {
        return None;
    }
    let (negative, body) = match text.as_bytes().first()? {
        b'-' => (true, &text[1..]),
        b'+' => (false, &text[1..]),
        _ => (false, text),
    };
    let run = |s: &str| s.bytes().take_while(u8::is_ascii_digit).count();
    let (whole, mut rest) = body.split_at(run(body));
    let mut fraction = "";
    if let Some(after) = rest.strip_prefix('.') {
        (fraction, rest) = after.split_at(run(after));
    }
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut exponent = 0;
    if let Some(after) = rest.strip_prefix(['e', 'E']) {
        let signed = after.strip_prefix(['-', '+']).unwrap_or(after);
        let digits = run(signed);
        if digits > 0 {
            let end = after.len() - signed.len() + digits;
            exponent = after[..end].parse().ok().filter(|e: &i32| e.abs() <= 400)?;
            rest = &after[end..];
        }
    }
    Some((Decimal { negative, whole, fraction, exponent }, rest.trim()))
}
