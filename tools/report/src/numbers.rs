//! Numbers, times and sizes as text.

use stillpoint_recorder::Session;

/// The text for a missing number.
pub const NONE: &str = "–";

/// A number with this number of decimals.
pub fn fixed(value: impl Into<Option<f64>>, digits: usize) -> String {
    match value.into() {
        Some(v) if v.is_finite() => {
            let text = format!("{v:.digits$}");
            // What rounds to nothing has no sign.
            let is_zero = text.starts_with('-') && text.bytes().all(|b| b"-0.".contains(&b));
            if is_zero { text[1..].to_owned() } else { text }
        }
        Some(v) if v.is_infinite() => "∞".to_owned(),
        _ => NONE.to_owned(),
    }
}

/// A number with four significant digits.
pub fn short(value: impl Into<Option<f64>>) -> String {
    match value.into() {
        None => NONE.to_owned(),
        Some(v) if !v.is_finite() => fixed(v, 0),
        Some(v) if v == v.trunc() && v.abs() < 1e9 => format!("{v:.0}"),
        Some(v) if (1e-3..1e5).contains(&v.abs()) => {
            let digits = (3 - libm::log10(v.abs()).floor() as i64).clamp(0, 6) as usize;
            format!("{v:.digits$}")
        }
        Some(v) => format!("{v:.3e}"),
    }
}

/// A part as per cent.
pub fn percent(part: impl Into<Option<f64>>) -> String {
    match part.into() {
        Some(v) if v.is_finite() => format!("{} %", fixed(v * 100.0, 1)),
        _ => NONE.to_owned(),
    }
}

/// A count with spaces between its thousands.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let first = digits.len() % 3;
    let (head, tail) = digits.split_at(first);
    let mut groups: Vec<&str> = if head.is_empty() { Vec::new() } else { vec![head] };
    groups.extend((0..tail.len() / 3).map(|i| &tail[3 * i..3 * i + 3]));
    // A thin space that does not break.
    groups.join("\u{202f}")
}

pub fn megabytes(bytes: u64) -> String {
    format!("{:.2} MB", bytes as f64 / 1e6)
}

/// The start time of a session, if the session states it.
pub fn started(session: &Session) -> Option<String> {
    session.clock().first().map(|c| c.realtime_ns).filter(|t| *t > 0).map(utc)
}

/// A moment, ns since 1970, as a date and a time of day in UTC.
pub fn utc(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    let (days, of_day) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Days from civil, the other way round: years of 400 years' cycles that begin in March.
    let shifted = days + 719_468;
    let (era, of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!(
        "{year:04}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC",
        of_day / 3600,
        of_day / 60 % 60,
        of_day % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_say_where_there_is_none() {
        assert_eq!(
            (fixed(1.234, 2), fixed(None, 2), fixed(f64::NAN, 2)),
            ("1.23".into(), NONE.into(), NONE.into())
        );
        assert_eq!(
            (fixed(f64::INFINITY, 1), fixed(-4e-4, 3), fixed(-6e-4, 3)),
            ("∞".into(), "0.000".into(), "-0.001".into())
        );
        assert_eq!(
            (count(7), count(1234), count(123_456)),
            ("7".into(), "1\u{202f}234".into(), "123\u{202f}456".into())
        );
        assert_eq!((percent(0.8081), percent(-1e-5)), ("80.8 %".into(), "0.0 %".into()));
    }

    #[test]
    fn a_moment_is_a_date() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_782_399_000_000_000), "2000-02-28 23:59:59 UTC");
        assert_eq!(utc(951_868_799_000_000_000), "2000-02-29 23:59:59 UTC");
        assert_eq!(utc(1_795_219_200_000_000_000), "2026-11-21 00:00:00 UTC");
    }

    #[test]
    fn numbers_have_four_digits_that_count() {
        let sentence =
            [None, Some(3.0), Some(0.012_346), Some(1234.56), Some(-0.5), Some(1.5e-7), Some(0.1 + 0.2)]
                .map(short);
        assert_eq!(sentence, ["–", "3", "0.01235", "1235", "-0.5000", "1.500e-7", "0.3000"]);
    }
}
