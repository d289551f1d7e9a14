//! The squeeze of bladders that are more than the channels they hold.
//!
//! Net duties along the null space of B move no channel: they fill or empty bladders that press against each other.
//! Equal duties do not pass equal air (an inlet passes about 1.9 times the air of an outlet, SCIENCE C3), so net duties
//! that swing about zero fill the bladders, and no pose shows it. So the pressures are held along this space, too:
//!
//! ```text
//! v = v_pose - t k N N^T (p - p_0),   B N = 0,   N^T N = 1
//! ```
//!
//! with the pressures p, those at the start p_0, and the greatest t up to 1 for which no valve is asked for more than there
//! is. The channels keep what `v_pose` does to them.

use nalgebra::DMatrix;
use stillpoint_mechanics::contact::grasp::null_space;

use crate::effect::Effect;

/// k, net duty per Pa: a deviation decays in some seconds, slowly compared with the channels.
const GAIN: f64 = 4e-5;

/// Holds the squeeze of the bladders at its value at the start. It allocates only when it is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Squeeze {
    /// N N^T, bladders by bladders.
    projector: DMatrix<f64>,
    is_free: bool,
    /// p_0, Pa, once there is one.
    start: Vec<f64>,
    has_start: bool,
    /// -k N N^T (p - p_0).
    correction: Vec<f64>,
}

impl Squeeze {
    /// Of bladders that do this.
    #[must_use]
    pub fn new(effect: &Effect) -> Self {
        let null = null_space(effect.matrix());
        let zeros = vec![0.0; effect.bladders()];
        Self {
            is_free: null.ncols() > 0,
            projector: &null * null.transpose(),
            start: zeros.clone(),
            has_start: false,
            correction: zeros,
        }
    }

    /// Whether there are duties that move no channel.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.is_free
    }

    /// Takes the pressures of the bladders, Pa over that of the room; the first ones are those to hold. Ones that are no
    /// numbers, or too few, are not used.
    pub fn see(&mut self, pressures: &[f64]) {
        let Some(pressures) = pressures.get(..self.correction.len()) else { return };
        if !self.is_free || pressures.iter().any(|p| !p.is_finite()) {
            return;
        }
        if !std::mem::replace(&mut self.has_start, true) {
            self.start.copy_from_slice(pressures);
        }
        for (i, correction) in self.correction.iter_mut().enumerate() {
            let off = pressures.iter().zip(&self.start).enumerate();
            *correction =
                -GAIN * off.map(|(j, (p, start))| self.projector[(i, j)] * (p - start)).sum::<f64>();
        }
    }

    /// Corrects nothing until the next pressures. The pressures to hold stay.
    pub fn rest(&mut self) {
        self.correction.fill(0.0);
    }

    /// Adds the correction to net duties within -1 to 1, as much of it as leaves them there.
    pub fn correct(&self, net: &mut [f64]) {
        let part = net.iter().zip(&self.correction).fold(1.0_f64, |part, (v, more)| match more.abs() {
            0.0 => part,
            size => part.min((1.0 - v * more.signum()).max(0.0) / size),
        });
        for (v, more) in net.iter_mut().zip(&self.correction) {
            *v = (*v + part * more).clamp(-1.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Rig, RigKind};

    fn effect(name: &str, channels: &[usize]) -> Effect {
        let rates = Rig::of(RigKind::named(name).unwrap(), 5.0).unwrap().rates().unwrap().unwrap();
        let scale = [0.005, 0.005, 0.005, 0.05, 0.05, 0.05];
        Effect::new(DMatrix::from_fn(channels.len(), rates.len(), |i, j| {
            rates[j][channels[i]] / scale[channels[i]]
        }))
        .unwrap()
    }

    fn eight() -> Effect {
        effect("eight_bladders", &[0, 1, 2, 3, 4, 5])
    }

    /// The rates of the channels of net duties.
    fn moved(effect: &Effect, net: &[f64]) -> nalgebra::DVector<f64> {
        effect.matrix() * nalgebra::DVector::from_column_slice(net)
    }

    #[test]
    fn what_holds_the_squeeze_moves_no_channel_even_where_valves_are_wide_open() {
        let effect = eight();
        for pressures in [[9e3; 8], [7e3, 9e3, 6e3, 8e3, 3e3, 4e3, 11e3, 5e3], [60e3; 8]] {
            for most in [0.0, 0.3, 0.999, 1.0] {
                let asked: Vec<f64> = (0..8_u8)
                    .map(|j| most * libm::cos(2.0 * std::f64::consts::PI * f64::from(j) / 4.0))
                    .collect();
                let (mut squeeze, mut net) = (Squeeze::new(&effect), asked.clone());
                squeeze.see(&[7e3; 8]);
                squeeze.see(&pressures);
                squeeze.correct(&mut net);
                assert!(net.iter().all(|v| v.abs() <= 1.0), "{net:?}");
                assert!((moved(&effect, &net) - moved(&effect, &asked)).amax() < 1e-12, "{net:?}");
                assert!(net != asked || most == 1.0, "{net:?}");
            }
        }
    }

    #[test]
    fn bladders_that_are_too_full_are_emptied_and_those_that_are_held_are_left_alone() {
        let mut squeeze = Squeeze::new(&eight());
        let mut net = [0.0; 8];
        squeeze.see(&[7e3; 8]);
        squeeze.correct(&mut net);
        assert_eq!(net, [0.0; 8]);
        squeeze.see(&[9e3; 8]);
        squeeze.correct(&mut net);
        assert!(net.iter().all(|v| *v < -0.01), "{net:?}");
        // What is no number changes nothing; where nothing is known nothing is done.
        let known = squeeze.clone();
        squeeze.see(&[f64::NAN; 8]);
        squeeze.see(&[0.0; 3]);
        assert_eq!(squeeze, known);
        squeeze.rest();
        net = [0.1; 8];
        squeeze.correct(&mut net);
        assert_eq!(net, [0.1; 8]);
    }

    #[test]
    fn as_many_bladders_as_channels_leave_nothing_free() {
        for (name, channels) in [("one_bladder", &[2][..]), ("three_bladders", &[2, 3, 4])] {
            let mut squeeze = Squeeze::new(&effect(name, channels));
            assert!(!squeeze.is_free());
            squeeze.see(&[7e3; 8]);
            squeeze.see(&[9e3; 8]);
            let mut net = vec![0.2; channels.len()];
            squeeze.correct(&mut net);
            assert!(net.iter().all(|v| *v == 0.2));
        }
        assert!(Squeeze::new(&effect("three_bladders", &[2, 4])).is_free());
    }
}
