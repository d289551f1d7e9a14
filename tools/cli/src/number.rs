//! The numbers of a sample, and how people read them: words of codes, units, degrees.

use serde_json::{Value, json};
use stillpoint_samples::{Code, Field, Names, Primitive};

/// Whether angles are shown in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Angles {
    /// As samples have them: rad.
    #[default]
    Radians,
    /// In degrees.
    Degrees,
}

/// A number of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// An unsigned integer.
    Unsigned(u64),
    /// A signed integer.
    Signed(i64),
    /// A floating-point number.
    Float(f64),
}

impl Number {
    /// Out of its little-endian bytes.
    pub fn of(primitive: Primitive, bytes: &[u8]) -> Self {
        let mut wide = [0u8; 8];
        let n = bytes.len().min(8);
        wide[..n].copy_from_slice(&bytes[..n]);
        let bits = u64::from_le_bytes(wide);
        match primitive {
            Primitive::F64 => Self::Float(f64::from_bits(bits)),
            Primitive::F32 => Self::Float(f64::from(f32::from_bits(bits as u32))),
            Primitive::I8 => Self::Signed(i64::from(bits as u8 as i8)),
            Primitive::I16 => Self::Signed(i64::from(bits as u16 as i16)),
            Primitive::I32 => Self::Signed(i64::from(bits as u32 as i32)),
            Primitive::I64 => Self::Signed(bits as i64),
            _ => Self::Unsigned(bits),
        }
    }

    /// All values of a field, out of its bytes.
    pub fn all(field: &Field, bytes: &[u8]) -> Vec<Self> {
        bytes.chunks_exact(field.primitive.size()).map(|one| Self::of(field.primitive, one)).collect()
    }

    /// As JSON, which has no NaN and no infinity: they are text.
    pub fn json(self) -> Value {
        match self {
            Self::Float(x) if !x.is_finite() => json!(x.to_string()),
            Self::Float(x) => json!(x),
            Self::Signed(x) => json!(x),
            Self::Unsigned(x) => json!(x),
        }
    }

    /// As a floating-point number.
    pub fn float(self) -> f64 {
        match self {
            Self::Float(x) => x,
            Self::Signed(x) => x as f64,
            Self::Unsigned(x) => x as f64,
        }
    }

    /// As text with its unit. Times in ns are shown in s.
    pub fn text(self, unit: &str, angles: Angles) -> (String, String) {
        match self {
            Self::Unsigned(ns) if unit == "ns" => {
                (format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000), "s".to_owned())
            }
            Self::Unsigned(x) => (x.to_string(), unit.to_owned()),
            Self::Signed(x) => (x.to_string(), unit.to_owned()),
            Self::Float(x) => {
                let (scale, unit) = in_angles(unit, angles);
                (short(x * scale), unit)
            }
        }
    }
}

/// The factor and the unit in which values of a unit are shown.
pub fn in_angles(unit: &str, angles: Angles) -> (f64, String) {
    match (angles, unit) {
        (Angles::Degrees, "rad") => (1f64.to_degrees(), "deg".to_owned()),
        (Angles::Degrees, "rad/s") => (1f64.to_degrees(), "deg/s".to_owned()),
        (Angles::Degrees, "rad/s2") => (1f64.to_degrees(), "deg/s2".to_owned()),
        _ => (1.0, unit.to_owned()),
    }
}

/// Six significant digits, without zeros at the end.
pub fn short(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return if x == 0.0 { "0".to_owned() } else { x.to_string() };
    }
    let size = x.abs().log10().floor() as i32;
    if !(-4..9).contains(&size) {
        return format!("{x:.5e}");
    }
    let text = format!("{x:.*}", (5 - size).max(0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// The names of the values of an array; none where they have none.
pub fn parts_of(field: &Field) -> &'static [Code] {
    match field.names {
        Names::Parts(parts) => parts,
        _ => &[],
    }
}

/// The unit of one value of an array. The six channels of a pose have two: of the coordinates, and of the angles.
pub fn single_unit(field: &Field, index: usize) -> &'static str {
    match (field.unit.split_once(", "), field.names) {
        (Some((first, second)), Names::Parts(parts)) if parts.len() == 6 && !second.contains(',') => {
            if index < 3 { first } else { second }
        }
        _ => field.unit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_angles_are_degrees_where_asked() {
        for (x, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (0.25, "0.25"),
            (1234567.0, "1234567"),
            (1e-7, "1.00000e-7"),
            (-0.0123456789, "-0.0123457"),
        ] {
            assert_eq!(short(x), text);
        }
        assert_eq!(short(f64::NAN), "NaN");
        let half = Number::Float(std::f64::consts::PI);
        assert_eq!(half.text("rad", Angles::Degrees), ("180".to_owned(), "deg".to_owned()));
        assert_eq!(half.text("rad", Angles::Radians).1, "rad");
        assert_eq!(Number::Unsigned(1_500_000_000).text("ns", Angles::Radians).0, "1.500000000");
    }
}
