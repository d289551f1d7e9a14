//! Which way an arc goes: `182..178cw`.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// Largest distance between control points, degrees. A static aperture every 4 degrees is usual (Otto, Med. Phys. 35 (2008) 310).
const STEP_DEG: f64 = 4.0;
/// Shortest arc, degrees.
const SHORTEST_DEG: f64 = 8.0;

/// A turn of the gantry with the beam on.
///
/// As text, `182..178cw` goes clockwise from 182 to 178 degrees (IEC 61217: angles rise), `178..182cc` back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcSpec {
    /// Gantry angle at the beginning, degrees in [0, 360).
    pub from_deg: f64,
    /// Gantry angle at the end, degrees in [0, 360).
    pub to_deg: f64,
    /// Whether angles rise.
    pub clockwise: bool,
}

/// A text that is not an arc.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ArcSpecError {
    /// It has another form.
    #[error(
        "invalid arc: {0:?} (examples: `1`, `2`, `182..178cw`, `178..182cc`, and several with commas; cw is clockwise, cc is \
         counter-clockwise)"
    )]
    Form(String),
    /// It is too short or whole.
    #[error("invalid arc: {arc} turns by {degrees} degrees (allowed: 8 to 359 degrees)")]
    Length {
        /// The arc.
        arc: String,
        /// What it turns by.
        degrees: f64,
    },
    /// It passes the end of the way of the gantry.
    #[error(
        "invalid arc: {0} passes 180 degrees, where the gantry stops; go the other way round, or give two arcs that end and begin there"
    )]
    Stop(String),
    /// There are none, or too many.
    #[error("invalid number of arcs: {0} (allowed: 1 to 4)")]
    Number(usize),
}

impl ArcSpec {
    /// Arcs of a list with commas; `1` and `2` are one and two full arcs.
    ///
    /// # Errors
    /// A text that is not an arc, or arcs that no machine turns.
    pub fn list(text: &str) -> Result<Vec<Self>, ArcSpecError> {
        let text = match text.trim() {
            "1" => "182..178cw",
            "2" => "182..178cw,178..182cc",
            other => other,
        };
        let arcs: Vec<Self> = text.split(',').map(str::parse).collect::<Result<_, _>>()?;
        if (1..=4).contains(&arcs.len()) { Ok(arcs) } else { Err(ArcSpecError::Number(arcs.len())) }
    }

    /// Degrees by which the gantry turns.
    pub fn degrees(&self) -> f64 {
        let [from, to] =
            if self.clockwise { [self.from_deg, self.to_deg] } else { [self.to_deg, self.from_deg] };
        (to - from).rem_euclid(360.0)
    }

    /// Beginning and end on the way of the gantry, which is from 0 degrees on one side of gantry 180 to 360 on the other.
    fn travel_deg(&self) -> [f64; 2] {
        let [from, to] = [self.from_deg, self.to_deg].map(|deg| (deg - 180.0).rem_euclid(360.0));
        // At 180 itself an arc tells the side by its sense.
        match self.clockwise {
            true => [from, if to == 0.0 { 360.0 } else { to }],
            false => [if from == 0.0 { 360.0 } else { from }, to],
        }
    }

    /// Degrees by which the gantry turns from the end of this arc to the beginning of another one, not through 180.
    pub fn degrees_to(&self, next: &Self) -> f64 {
        (next.travel_deg()[0] - self.travel_deg()[1]).abs()
    }

    /// Gantry angles of the control points, which run on beyond 0 and 360 degrees; at most 4 degrees apart.
    pub fn control_points_deg(&self) -> Vec<f64> {
        let intervals = libm::ceil(self.degrees() / STEP_DEG - 1e-9).max(2.0);
        let step = if self.clockwise { 1.0 } else { -1.0 } * self.degrees() / intervals;
        (0..=intervals as u32).map(|point| self.from_deg + step * f64::from(point)).collect()
    }
}

impl FromStr for ArcSpec {
    type Err = ArcSpecError;

    fn from_str(text: &str) -> Result<Self, ArcSpecError> {
        let form = || ArcSpecError::Form(text.to_owned());
        let trimmed = text.trim();
        let (angles, clockwise) = match (trimmed.strip_suffix("cw"), trimmed.strip_suffix("cc")) {
            (Some(angles), _) => (angles, true),
            (None, Some(angles)) => (angles, false),
            (None, None) => return Err(form()),
        };
        let (from, to) = angles.split_once("..").ok_or_else(form)?;
        let number = |part: &str| match part.trim().parse::<f64>() {
            // To a hundredth of a degree, as the angles of beams are.
            Ok(number) if number.abs() <= 720.0 => {
                Ok((libm::round(100.0 * number) / 100.0).rem_euclid(360.0))
            }
            _ => Err(form()),
        };
        let arc = Self { from_deg: number(from)?, to_deg: number(to)?, clockwise };
        let degrees = arc.degrees();
        if !(SHORTEST_DEG..=359.0).contains(&degrees) {
            return Err(ArcSpecError::Length { arc: arc.to_string(), degrees });
        }
        let [from, to] = arc.travel_deg();
        match (to > from) == arc.clockwise {
            true => Ok(arc),
            false => Err(ArcSpecError::Stop(arc.to_string())),
        }
    }
}

impl fmt::Display for ArcSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sense = if self.clockwise { "cw" } else { "cc" };
        write!(f, "{}..{}{sense}", self.from_deg, self.to_deg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arcs_are_read_as_they_are_written() {
        for text in ["182..178cw", "178..182cc", "0..90cw", "350.5..10cw", "30..330cc"] {
            assert_eq!(text.parse::<ArcSpec>().unwrap().to_string(), text);
        }
        assert_eq!("-178..178cw".parse::<ArcSpec>().unwrap().to_string(), "182..178cw");
        for wrong in
            ["", "1", "0..90", "0-90cw", "x..90cw", "0..NaNcw", "0..infcw", "0..1e9cw", "..cw", "0..90ccw"]
        {
            assert!(matches!(wrong.parse::<ArcSpec>(), Err(ArcSpecError::Form(_))), "{wrong}");
        }
        for whole in ["0..0cw", "0..5cw", "180..180.5cc"] {
            assert!(matches!(whole.parse::<ArcSpec>(), Err(ArcSpecError::Length { .. })), "{whole}");
        }
        for through in ["170..190cw", "190..170cc", "0..359cw", "90..89cw", "270..271cc"] {
            assert!(matches!(through.parse::<ArcSpec>(), Err(ArcSpecError::Stop(_))), "{through}");
        }
        for to_the_stop in ["0..180cw", "180..0cw", "180..179cw", "0..180cc", "180..0cc", "180..181cc"] {
            assert!(to_the_stop.parse::<ArcSpec>().is_ok(), "{to_the_stop}");
        }
        assert_eq!(ArcSpec::list("1").unwrap().len(), 1);
        assert_eq!(ArcSpec::list("2").unwrap(), ArcSpec::list("182..178cw, 178..182cc").unwrap());
        assert_eq!(ArcSpec::list("0..90cw,0..90cw,0..90cw,0..90cw,0..90cw"), Err(ArcSpecError::Number(5)));
    }

    #[test]
    fn between_arcs_the_gantry_turns_back_and_never_through_180_degrees() {
        for (arcs, expected) in [
            ("182..178cw,178..182cc", 0.0),
            ("182..178cw,182..178cw", 356.0),
            ("90..180cw,180..90cc", 0.0),
            ("90..180cw,180..270cw", 360.0),
            ("270..350cw,10..90cw", 20.0),
        ] {
            let arcs = ArcSpec::list(arcs).unwrap();
            assert!((arcs[0].degrees_to(&arcs[1]) - expected).abs() < 1e-9, "{arcs:?}");
        }
    }

    #[test]
    fn control_points_are_at_most_4_degrees_apart_and_end_where_the_arc_ends() {
        for (text, points, last) in
            [("182..178cw", 90, 538.0), ("178..182cc", 90, -178.0), ("350..13cw", 7, 373.0)]
        {
            let arc: ArcSpec = text.parse().unwrap();
            let found = arc.control_points_deg();
            assert_eq!((found.len(), found[0]), (points, arc.from_deg), "{text}");
            assert!((found[points - 1] - last).abs() < 1e-9, "{text}");
            assert!(found.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 4.0 + 1e-9));
        }
    }
}
