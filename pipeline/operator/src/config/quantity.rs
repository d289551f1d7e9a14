//! Quantities: a number with a unit, read as SI.
//!
//! `4 mm` is the double nearest to 0.004: the decimal point is moved before the number becomes binary.

use super::decimal::{Decimal, split};
use super::faults::{Code, Complaint};
use super::near::{nearest, shown};
use super::units::{DIMENSIONS, Dimension, Factor, Unit, find};

/// A plain number, with no unit.
pub fn plain(text: &str) -> Result<f64, Complaint> {
    let (decimal, unit) = split(text).ok_or_else(|| not_a_number(text, "a number", "5"))?;
    refuse_unit(text, unit)?;
    finite(text, decimal.text(0).parse().unwrap_or(f64::NAN))
}

/// A plain whole number, with no unit.
pub fn whole(text: &str) -> Result<i128, Complaint> {
    let (decimal, unit) = split(text).ok_or_else(|| not_a_number(text, "a whole number", "5"))?;
    refuse_unit(text, unit)?;
    decimal.shifted(0, 1).ok_or_else(|| {
        if decimal.is_huge() {
            return too_large(text, "5");
        }
        Complaint::new(
            Code::NotANumber,
            format!("{} is not a whole number", shown(text)),
            "write a whole number, for example 5",
        )
    })
}

/// A quantity in the SI unit of what `unit` measures.
pub fn si(text: &str, unit: &str) -> Result<f64, Complaint> {
    let dimension = known(unit)?;
    let (decimal, found) = in_dimension(text, dimension)?;
    let value = match found.factor {
        Factor::Ten(power) => decimal.text(power).parse().unwrap_or(f64::NAN),
        Factor::Whole(factor) => match decimal.digits() {
            Some((digits, power)) if digits.checked_mul(i128::from(factor)).is_some() => {
                format!("{}e{power}", digits * i128::from(factor)).parse().unwrap_or(f64::NAN)
            }
            _ => decimal.text(0).parse().unwrap_or(f64::NAN) * f64::from(factor),
        },
        Factor::Real(factor) => decimal.text(0).parse().unwrap_or(f64::NAN) * factor,
    };
    finite(text, value)
}

/// A quantity as an exact whole number of `unit`.
pub fn whole_in(text: &str, unit: &str) -> Result<i128, Complaint> {
    let dimension = known(unit)?;
    let base = dimension.unit(unit).map_or(0, |u| match u.factor {
        Factor::Ten(power) => power,
        _ => 0,
    });
    let (decimal, found) = in_dimension(text, dimension)?;
    let value = match found.factor {
        Factor::Ten(power) => decimal.shifted(power - base, 1),
        Factor::Whole(factor) => decimal.shifted(-base, i128::from(factor)),
        Factor::Real(_) => None,
    };
    value.ok_or_else(|| {
        if decimal.is_huge() {
            return too_large(text, &example(dimension));
        }
        Complaint::new(
            Code::NotANumber,
            format!("{} is not a whole number of {unit}", shown(text)),
            format!("round it to a whole number of {unit}"),
        )
    })
}

/// The longest time in a pipeline, ns: sums of a few stay far from the end of the clock.
const LONGEST: u64 = 366 * 86_400 * 1_000_000_000;

/// A time in whole nanoseconds, at most a year.
pub fn nanoseconds(text: &str) -> Result<u64, Complaint> {
    let value = whole_in(text, "ns")?;
    u64::try_from(value).ok().filter(|ns| *ns <= LONGEST).ok_or_else(|| {
        Complaint::new(
            Code::OutOfRange,
            match value < 0 {
                true => format!("{} is negative, but no time here is", shown(text)),
                false => format!("{} is longer than a year", shown(text)),
            },
            "write for example `10 ms`",
        )
    })
}

fn known(unit: &str) -> Result<&'static Dimension, Complaint> {
    find(unit).map(|(d, _)| d).ok_or_else(|| {
        Complaint::new(
            Code::UnknownUnit,
            format!("this build asks for the unit {}, which it does not know", shown(unit)),
            "report it: the operator's parameters are declared wrongly",
        )
    })
}

fn in_dimension<'t>(
    text: &'t str,
    dimension: &'static Dimension,
) -> Result<(Decimal<'t>, &'static Unit), Complaint> {
    let expected = dimension.name;
    let example = example(dimension);
    let (decimal, written) = split(text).ok_or_else(|| not_a_number(text, expected, &example))?;
    if let Some(unit) = dimension.unit(written) {
        return Ok((decimal, unit));
    }
    if written.starts_with([',', '.', '-', '+', '_']) {
        return Err(not_a_number(text, expected, &example));
    }
    let number = text.trim()[..text.trim().len() - written.len()].trim_end();
    let units = || dimension.units.iter().map(|u| u.symbol);
    if written.is_empty() {
        return Err(Complaint::new(
            Code::MissingUnit,
            format!("{} has no unit, but {expected} is expected", shown(text)),
            format!("write it with its unit: {}", one_of(&units().collect::<Vec<_>>(), number)),
        ));
    }
    if let Some((other, _)) = find(written) {
        return Err(Complaint::new(
            Code::WrongUnit,
            format!("{} is {}, but {expected} is expected", shown(text), other.name),
            format!("write it in {}", or(&units().collect::<Vec<_>>())),
        ));
    }
    // The letter for a millionth is written `u` here. Units of one or two letters are all alike: another is no typing error.
    let plain = written.replace(['\u{b5}', '\u{3bc}'], "u").replace('\u{b0}', "deg");
    let spelt = units().find(|u| u.eq_ignore_ascii_case(&plain));
    let near = spelt
        .or_else(|| nearest(written, units()).filter(|_| written.chars().count() > 2))
        .or_else(|| nearest(written, DIMENSIONS.iter().flat_map(|d| d.units).map(|u| u.symbol)));
    let help = match near {
        Some(near) if dimension.unit(near).is_some() => format!("did you mean `{number} {near}`?"),
        _ => format!("write it in {}", or(&units().collect::<Vec<_>>())),
    };
    Err(Complaint::new(
        Code::UnknownUnit,
        format!("{} is not a unit, and {expected} is expected", shown(written)),
        help,
    ))
}

fn example(dimension: &Dimension) -> String {
    format!("5 {}", dimension.units.get(1).or(dimension.units.first()).map_or("", |u| u.symbol))
}

fn one_of(units: &[&str], number: &str) -> String {
    let shown: Vec<String> = units.iter().take(3).map(|u| format!("`{number} {u}`")).collect();
    or(&shown.iter().map(String::as_str).collect::<Vec<_>>())
}

/// `a, b or c`.
pub fn or(words: &[&str]) -> String {
    match words {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [most @ .., last] => format!("{} or {last}", most.join(", ")),
    }
}

fn refuse_unit(text: &str, unit: &str) -> Result<(), Complaint> {
    if unit.is_empty() {
        return Ok(());
    }
    let number = text.trim()[..text.trim().len() - unit.len()].trim_end();
    Err(match find(unit) {
        Some((dimension, _)) => Complaint::new(
            Code::WrongUnit,
            format!("{} is {}, but a plain number is expected", shown(text), dimension.name),
            format!("write `{number}`"),
        ),
        None => not_a_number(text, "a plain number", number),
    })
}

fn finite(text: &str, value: f64) -> Result<f64, Complaint> {
    if value.is_finite() {
        // No second zero: equal configs resolve to equal bytes.
        return Ok(if value == 0.0 { 0.0 } else { value });
    }
    Err(Complaint::new(Code::NotANumber, format!("{} is not finite", shown(text)), "write a finite number"))
}

fn too_large(text: &str, example: &str) -> Complaint {
    Complaint::new(
        Code::OutOfRange,
        format!("{} is too large", shown(text)),
        format!("write a smaller value, for example `{example}`"),
    )
}

fn not_a_number(text: &str, expected: &str, example: &str) -> Complaint {
    let dotted = text.replacen(',', ".", 1);
    let help = if text.contains(',') && split(&dotted).is_some() {
        format!("write the decimal point as a point: `{}`", dotted.trim())
    } else {
        format!("write {expected}, for example `{example}`")
    };
    Complaint::new(Code::NotANumber, format!("{} is not {expected}", shown(text)), help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_quantities_are_the_nearest_double() {
        assert_eq!(si("4 mm", "m"), Ok(0.004));
        assert_eq!(si("0.3mm", "m"), Ok(0.0003));
        assert_eq!(si("-450 mm", "m"), Ok(-0.45));
        assert_eq!(si("1.1e3 us", "s"), Ok(0.0011));
        assert_eq!(si("15 kPa", "Pa"), Ok(15000.0));
        assert_eq!(si("0.1 min", "s"), Ok(6.0));
        assert_eq!(si("50 %", "1"), Ok(0.5));
        assert_eq!(si("180 deg", "rad"), Ok(std::f64::consts::PI));
        assert_eq!(si("15 psi", "Pa"), Ok(103_421.359_397_525_4));
        assert_eq!(si("9.81 m/s^2", "m/s2"), Ok(9.81));
    }

    #[test]
    fn times_are_exact_nanoseconds() {
        assert_eq!(nanoseconds("10 ms"), Ok(10_000_000));
        assert_eq!(nanoseconds("0.1 s"), Ok(100_000_000));
        assert_eq!(nanoseconds("1.5 min"), Ok(90_000_000_000));
        assert_eq!(nanoseconds("31622400.000000000 s"), Ok(31_622_400_000_000_000));
        assert!(nanoseconds("0.5 ns").is_err());
        assert!(nanoseconds("-1 s").is_err());
        for huge in ["1e300 s", "1e400 s", "-1e30 s"] {
            assert_eq!(nanoseconds(huge).unwrap_err().code, Code::OutOfRange, "{huge}");
        }
        assert_eq!(nanoseconds("1e-400 s").unwrap_err().code, Code::NotANumber);
    }

    #[test]
    fn wrong_units_are_refused_with_what_is_due() {
        let code = |text| si(text, "m").unwrap_err().code;
        assert_eq!(code("4"), Code::MissingUnit);
        assert_eq!(code("4 ms"), Code::WrongUnit);
        assert_eq!(code("4 nn"), Code::UnknownUnit);
        assert_eq!(code("four mm"), Code::NotANumber);
        assert_eq!(code(".inf"), Code::NotANumber);
        assert_eq!(code("1e400 m"), Code::NotANumber);
        assert_eq!(si("4,5 mm", "m").unwrap_err().help, "write the decimal point as a point: `4.5 mm`");
    }
}
