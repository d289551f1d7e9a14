//! How distances are weighted.

/// Huber's and Tukey's constants: 95 % efficiency where the errors are normal.
const HUBER: f64 = 1.345;
const TUKEY: f64 = 4.685;

/// How distances are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Robust {
    /// Huber's: a distant point pulls as one at 1.345 standard deviations does; beyond twice the tolerance it is left
    /// out. A nose that is still off turns the head.
    Huber,
    /// Tukey's: a distant point does not pull. The most exact where the cloud already lies on the surface.
    Tukey,
}

impl Robust {
    /// Weight of a distance, and its derivative's: of the weighted distance by the distance.
    #[inline]
    pub(super) fn weight(self, distance: f64, scale: f64, tolerance: f64) -> (f64, f64) {
        match self {
            Self::Huber => {
                let (size, knee) = (distance.abs(), HUBER * scale);
                if size <= knee {
                    (1.0, 1.0)
                } else if size <= 2.0 * tolerance {
                    (knee / size, 0.0)
                } else {
                    (0.0, 0.0)
                }
            }
            Self::Tukey => {
                let u = distance / (TUKEY * scale);
                let inside = (1.0 - u * u).max(0.0);
                (inside * inside, inside * (1.0 - 5.0 * u * u))
            }
        }
    }
}
