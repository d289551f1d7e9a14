//! Units that a config may write, by what they measure.

/// How a number in a unit becomes SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Factor {
    /// Times ten to this power: exact.
    Ten(i32),
    /// Times this whole number: exact.
    Whole(u32),
    /// Times this number.
    Real(f64),
}

/// A unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// As it is written.
    pub symbol: &'static str,
    /// How a number becomes SI.
    pub factor: Factor,
}

/// What units measure.
#[derive(Debug, PartialEq)]
pub struct Dimension {
    /// In words, with its article.
    pub name: &'static str,
    /// Its units; the SI unit stands first.
    pub units: &'static [Unit],
}

impl Dimension {
    /// The SI unit.
    pub fn si(&self) -> &'static str {
        self.units.first().map_or("", |u| u.symbol)
    }

    /// The unit of this symbol.
    pub fn unit(&self, symbol: &str) -> Option<&'static Unit> {
        self.units.iter().find(|u| u.symbol == symbol)
    }
}

/// What a unit measures, and the unit.
pub fn find(symbol: &str) -> Option<(&'static Dimension, &'static Unit)> {
    DIMENSIONS.iter().find_map(|d| d.unit(symbol).map(|u| (d, u)))
}

const fn ten(symbol: &'static str, power: i32) -> Unit {
    Unit { symbol, factor: Factor::Ten(power) }
}

const fn whole(symbol: &'static str, factor: u32) -> Unit {
    Unit { symbol, factor: Factor::Whole(factor) }
}

const fn real(symbol: &'static str, factor: f64) -> Unit {
    Unit { symbol, factor: Factor::Real(factor) }
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Pound-force per square inch, Pa: 0.45359237 kg * 9.80665 m/s2 / (0.0254 m)^2.
const PSI: f64 = 6_894.757_293_168_361;
/// Conventional millimetre of mercury, Pa.
const MMHG: f64 = 133.322_387_415;

/// All dimensions. A unit stands in one only.
pub const DIMENSIONS: &[Dimension] = &[
    Dimension {
        name: "a length",
        units: &[ten("m", 0), ten("mm", -3), ten("cm", -2), ten("um", -6), ten("nm", -9), ten("km", 3)],
    },
    Dimension {
        name: "a time",
        units: &[
            ten("s", 0),
            ten("ms", -3),
            ten("us", -6),
            ten("ns", -9),
            whole("min", 60),
            whole("h", 3600),
        ],
    },
    Dimension { name: "an angle", units: &[ten("rad", 0), real("deg", DEGREE), ten("mrad", -3)] },
    Dimension {
        name: "a pressure",
        units: &[
            ten("Pa", 0),
            ten("kPa", 3),
            real("psi", PSI),
            ten("bar", 5),
            ten("mbar", 2),
            ten("hPa", 2),
            ten("MPa", 6),
            real("mmHg", MMHG),
        ],
    },
    Dimension {
        name: "a frequency",
        units: &[ten("Hz", 0), ten("kHz", 3), ten("MHz", 6), ten("mHz", -3), ten("1/s", 0)],
    },
    Dimension { name: "a mass", units: &[ten("kg", 0), ten("g", -3), ten("mg", -6)] },
    Dimension { name: "a number of pixels", units: &[ten("px", 0)] },
    Dimension { name: "a ratio", units: &[ten("1", 0), ten("%", -2)] },
    Dimension {
        name: "a speed",
        units: &[ten("m/s", 0), ten("mm/s", -3), ten("cm/s", -2), ten("um/s", -6), ten("km/s", 3)],
    },
    Dimension {
        name: "an acceleration",
        units: &[
            ten("m/s2", 0),
            ten("mm/s2", -3),
            ten("cm/s2", -2),
            ten("m/s^2", 0),
            ten("mm/s^2", -3),
            ten("cm/s^2", -2),
        ],
    },
    Dimension {
        name: "an angular speed",
        units: &[ten("rad/s", 0), real("deg/s", DEGREE), ten("mrad/s", -3)],
    },
    Dimension {
        name: "an angular acceleration",
        units: &[ten("rad/s2", 0), real("deg/s2", DEGREE), ten("rad/s^2", 0), real("deg/s^2", DEGREE)],
    },
    Dimension {
        name: "a rate of pressure",
        units: &[ten("Pa/s", 0), ten("kPa/s", 3), real("psi/s", PSI), ten("bar/s", 5), ten("mbar/s", 2)],
    },
    Dimension { name: "a force", units: &[ten("N", 0), ten("mN", -3), ten("kN", 3)] },
    Dimension { name: "a torque", units: &[ten("Nm", 0), ten("mNm", -3)] },
    Dimension { name: "a stiffness", units: &[ten("N/m", 0), ten("N/mm", 3), ten("kN/m", 3)] },
    Dimension { name: "a damping", units: &[ten("Ns/m", 0), ten("N*s/m", 0)] },
    Dimension {
        name: "an area",
        units: &[
            ten("m2", 0),
            ten("mm2", -6),
            ten("cm2", -4),
            ten("m^2", 0),
            ten("mm^2", -6),
            ten("cm^2", -4),
        ],
    },
    Dimension {
        name: "a volume",
        units: &[ten("m3", 0), ten("mm3", -9), ten("cm3", -6), ten("l", -3), ten("ml", -6), ten("m^3", 0)],
    },
    Dimension {
        name: "a flow",
        units: &[ten("m3/s", 0), ten("l/s", -3), ten("ml/s", -6), real("l/min", 1e-3 / 60.0)],
    },
    Dimension {
        name: "a power density of acceleration",
        units: &[ten("m2/s3", 0), ten("mm2/s3", -6), ten("m^2/s^3", 0), ten("mm^2/s^3", -6)],
    },
    Dimension { name: "a voltage", units: &[ten("V", 0), ten("mV", -3)] },
    Dimension { name: "a current", units: &[ten("A", 0), ten("mA", -3)] },
    Dimension { name: "a temperature", units: &[ten("K", 0)] },
    Dimension { name: "a number of bytes", units: &[ten("B", 0), ten("kB", 3), ten("MB", 6), ten("GB", 9)] },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_symbol_stands_once() {
        let mut all: Vec<&str> = DIMENSIONS.iter().flat_map(|d| d.units).map(|u| u.symbol).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }

    #[test]
    fn first_unit_of_a_dimension_is_si() {
        for d in DIMENSIONS {
            assert_eq!(d.units[0].factor, Factor::Ten(0), "{}", d.name);
        }
    }
}
