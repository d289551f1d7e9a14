//! What the dose of a structure is like where an objective is fulfilled, in a form that limits can be compared with.

use std::fmt::{Display, Formatter};

use super::shapes::Bound;

/// What a fulfilled objective says of the dose of its structure. Doses are in gray, volumes are fractions of the structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// No point has more than the dose, or none has less.
    Dose(Bound, f64),
    /// The mean.
    Mean(Bound, f64),
    /// The volume that gets a dose.
    Volume {
        /// The side of the volume.
        bound: Bound,
        /// The dose.
        dose: f64,
        /// The volume.
        volume: f64,
    },
    /// The generalised equivalent uniform dose.
    Geud {
        /// The exponent.
        a: f64,
        /// The side.
        bound: Bound,
        /// The dose.
        dose: f64,
    },
    /// All points have the same dose.
    Even,
    /// The dose falls with the distance to the targets.
    FallOff {
        /// At the targets.
        near: f64,
        /// Far from them.
        far: f64,
        /// Where it is that low, mm.
        over_mm: f64,
    },
}

impl Display for Aim {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Dose(Bound::AtMost, dose) => write!(f, "no dose above {dose:.1} Gy"),
            Self::Dose(Bound::AtLeast, dose) => write!(f, "no dose below {dose:.1} Gy"),
            Self::Mean(bound, dose) => write!(f, "mean {} {dose:.1} Gy", bound.sign()),
            Self::Volume { bound, dose, volume } => {
                write!(f, "V{dose:.1}Gy {} {:.1} %", bound.sign(), 100.0 * volume)
            }
            Self::Geud { a, bound, dose } => write!(f, "gEUD({a}) {} {dose:.1} Gy", bound.sign()),
            Self::Even => write!(f, "even dose"),
            Self::FallOff { near, far, over_mm } => {
                write!(f, "from {near:.1} Gy at the targets to {far:.1} Gy over {over_mm} mm")
            }
        }
    }
}
