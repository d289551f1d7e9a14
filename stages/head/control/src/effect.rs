//! How bladders move a head: B of (4.23) in one column per bladder, and its inverse.

use nalgebra::{DMatrix, SMatrix, SVector};

use crate::harmonic::CHANNELS;

/// The rate of each channel at full duty of each bladder's inlet, in parts of the channel's scale per second, and what
/// undoes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    b: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// Effect of an outlet, in parts of that of the inlet.
    outlet: f64,
}

/// Why bladders cannot control channels.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// Fewer bladders than channels.
    #[error("{bladders} bladders cannot hold {channels} channels: give at least one for each")]
    TooFew { bladders: usize, channels: usize },
    /// Some way to move the channels is not there.
    #[error(
        "the bladders do not move all channels independently (smallest to largest singular value {ratio:.1e}): check the rates, \
         or hold fewer channels"
    )]
    Dependent {
        /// Smallest to largest singular value of B.
        ratio: f64,
    },
    /// A number that is none.
    #[error("a rate is not finite")]
    NotFinite,
}

/// Singular values less than this part of the largest count as none.
const LEAST: f64 = 1e-6;

impl Effect {
    /// From B, channels by bladders.
    ///
    /// # Errors
    /// [`EffectError`].
    pub fn new(b: DMatrix<f64>) -> Result<Self, EffectError> {
        let (channels, bladders) = b.shape();
        if bladders < channels || channels == 0 {
            return Err(EffectError::TooFew { bladders, channels });
        }
        if b.iter().any(|v| !v.is_finite()) {
            return Err(EffectError::NotFinite);
        }
        let values = b.singular_values();
        let ratio = if values.max() > 0.0 { values.min() / values.max() } else { 0.0 };
        // B^T (B B^T)^-1: of all duties that do the same, those of least effort.
        let square = (&b * b.transpose()).cholesky().filter(|_| ratio > LEAST);
        let Some(square) = square else { return Err(EffectError::Dependent { ratio }) };
        let inverse = b.transpose() * square.inverse();
        Ok(Self { b, inverse, outlet: 1.0 })
    }

    /// The same bladders, with outlets that have this part, above 0, of the effect of the inlets.
    #[must_use]
    pub fn with_outlet(self, outlet: f64) -> Self {
        Self { outlet, ..self }
    }

    /// Turns net duties of symmetric valves into those of these valves with the same effect, within -1 to 1.
    pub fn open(&self, net: &mut [f64]) {
        for v in net.iter_mut().filter(|v| **v < 0.0) {
            *v = (*v / self.outlet).max(-1.0);
        }
    }

    /// Limits net duties of symmetric valves to the effect that these valves can have.
    pub fn bound(&self, net: &mut [f64]) {
        net.iter_mut().for_each(|v| *v = v.max(-self.outlet));
    }

    #[must_use]
    pub fn channels(&self) -> usize {
        self.b.nrows()
    }

    #[must_use]
    pub fn bladders(&self) -> usize {
        self.b.ncols()
    }

    /// B, channels by bladders.
    #[must_use]
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.b
    }

    /// B^-1, or the pseudo-inverse where there are more bladders than channels, bladders by channels.
    #[must_use]
    pub fn inverse(&self) -> &DMatrix<f64> {
        &self.inverse
    }

    /// The net duties that move the channels at these rates.
    pub fn duties(&self, rates: &[f64], net: &mut [f64]) {
        for (j, v) in net.iter_mut().enumerate().take(self.bladders()) {
            *v = rates.iter().enumerate().map(|(i, rate)| self.inverse[(j, i)] * rate).sum();
        }
    }
}

impl Effect {
    /// The rates of the channels at these net duties.
    pub fn moved(&self, net: &[f64], rates: &mut [f64]) {
        for (i, rate) in rates.iter_mut().enumerate().take(self.channels()) {
            *rate = net.iter().enumerate().map(|(j, v)| self.b[(i, j)] * v).sum();
        }
    }
}

/// Coordinates of the channels, in scales, of which each bladder moves one alone. Where bladders and channels are not
/// equally many there are none, and the coordinates are the channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decoupling {
    count: usize,
    split: SMatrix<f64, CHANNELS, CHANNELS>,
    join: SMatrix<f64, CHANNELS, CHANNELS>,
}

impl Decoupling {
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The coordinates of channels.
    #[must_use]
    pub fn split(&self, channels: &[f64; CHANNELS]) -> [f64; CHANNELS] {
        (self.split * SVector::from(*channels)).into()
    }

    /// The channels of coordinates.
    #[must_use]
    pub fn join(&self, coordinates: &[f64; CHANNELS]) -> [f64; CHANNELS] {
        (self.join * SVector::from(*coordinates)).into()
    }
}

impl Effect {
    /// Coordinates of which each bladder moves one alone: `diag(|b_j|) B^-1` with the columns b_j of B.
    #[must_use]
    pub fn decoupling(&self) -> Decoupling {
        let count = self.channels();
        let (mut split, mut join) = (SMatrix::identity(), SMatrix::identity());
        if self.bladders() == count && count <= CHANNELS {
            for j in 0..count {
                let length = self.b.column(j).norm();
                for i in 0..count {
                    split[(j, i)] = length * self.inverse[(j, i)];
                    join[(i, j)] = self.b[(i, j)] / length;
                }
            }
        }
        Decoupling { count, split, join }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_undoes_it_with_any_number_of_bladders() {
        for b in [
            DMatrix::from_row_slice(1, 1, &[0.5]),
            DMatrix::from_row_slice(2, 3, &[1.0, 0.5, 0.5, 0.0, 1.0, -1.0]),
            DMatrix::from_row_slice(3, 3, &[1.15, 0.79, 0.79, 4.6, -6.9, -6.9, 0.0, 1.1, -1.1]),
        ] {
            let n = b.nrows();
            let effect = Effect::new(b.clone()).unwrap();
            assert!((b * effect.inverse() - DMatrix::identity(n, n)).norm() < 1e-12);
        }
    }

    #[test]
    fn an_outlet_of_half_the_effect_opens_twice_as_far_and_no_farther_than_it_can() {
        let effect = Effect::new(DMatrix::identity(3, 3)).unwrap();
        let (mut net, mut far) = ([0.4, -0.2, 0.0], [0.4, -0.8, -1.0]);
        effect.open(&mut net);
        assert_eq!(net, [0.4, -0.2, 0.0]);
        let half = effect.with_outlet(0.5);
        half.open(&mut net);
        assert_eq!(net, [0.4, -0.4, 0.0]);
        half.bound(&mut far);
        assert_eq!(far, [0.4, -0.5, -0.5]);
        half.open(&mut far);
        assert_eq!(far, [0.4, -1.0, -1.0]);
    }

    #[test]
    fn each_bladder_moves_one_coordinate_alone() {
        let b = DMatrix::from_row_slice(3, 3, &[1.15, 0.79, 0.79, 4.6, -6.9, -6.9, 0.0, 1.1, -1.1]);
        let effect = Effect::new(b.clone()).unwrap();
        let decoupling = effect.decoupling();
        for j in 0..3 {
            let mut moved = [0.0; CHANNELS];
            (0..3).for_each(|i| moved[i] = b[(i, j)]);
            let own = decoupling.split(&moved);
            for (i, own) in own.iter().enumerate() {
                let expected = if i == j { b.column(j).norm() } else { 0.0 };
                assert!((own - expected).abs() < 1e-12, "{i} {j}: {own}");
            }
            let back = decoupling.join(&own);
            assert!(back.iter().zip(&moved).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        }
        let more = Effect::new(DMatrix::from_row_slice(1, 2, &[1.0, 2.0])).unwrap().decoupling();
        assert_eq!(more.split(&[3.0; CHANNELS]), [3.0; CHANNELS]);
    }

    #[test]
    fn channels_that_move_together_are_refused() {
        let both = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 4.0]);
        assert!(matches!(Effect::new(both), Err(EffectError::Dependent { .. })));
        let few = DMatrix::from_row_slice(2, 1, &[1.0, 2.0]);
        assert_eq!(Effect::new(few), Err(EffectError::TooFew { bladders: 1, channels: 2 }));
    }
}
