//! The errors of a depth camera, as numbers that have been checked.
//!
//! Axial noise is normal with the standard deviation of Nguyen, Izadi and Lovell (3DIMPVT 2012),
//! `sigma(z, theta) = a + b (z - c)^2 + g / sqrt(z) * theta^2 / (pi/2 - theta)^2`,
//! theta being the angle of incidence. Their lateral noise matters at edges only, and is modelled there.

use core::f64::consts::FRAC_PI_2;

/// One step of the depth image: 0.1 mm.
pub const DEPTH_UNIT_M: f64 = 1e-4;

/// The farthest depth that 16 bits hold.
pub const MAX_DEPTH_M: f64 = 65_535.0 * DEPTH_UNIT_M;

/// Why a noise model is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoiseError {
    /// A number out of its range, or not finite.
    #[error("{name} is {value}; give a number from {least} to {greatest}")]
    Range {
        /// Name of the quantity.
        name: &'static str,
        value: f64,
        /// The least that is allowed.
        least: f64,
        /// The greatest that is allowed.
        greatest: f64,
    },
    /// An empty range of depths.
    #[error("near is {near} m and far is {far} m; near must be less")]
    EmptyRange {
        /// The nearest depth, in metres.
        near: f64,
        /// The farthest depth, in metres.
        far: f64,
    },
    /// Probabilities at edges that exceed certainty.
    #[error("edge_dropout, edge_swap and edge_mix add up to {0}; they must not exceed 1")]
    EdgeSum(f64),
}

/// The numbers of a noise model before they are checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseParams {
    /// `a`: standard deviation at the best distance, in metres.
    pub axial_floor: f64,
    /// `b`: growth of the standard deviation with the square of the distance from the best, per metre.
    pub axial_growth: f64,
    /// `c`: the best distance, in metres.
    pub axial_best: f64,
    /// `g`: growth of the standard deviation with the angle of incidence, in metres to the power 3/2.
    pub axial_angle: f64,
    /// Angle of incidence in radians from which a surface returns no light.
    pub grazing: f64,
    /// Probability that a pixel fails anywhere, up to 0.99.
    pub dropout: f64,
    /// A step to a neighbouring pixel by more than this part of the depth is an edge.
    pub edge_jump: f64,
    /// Probability that a pixel at an edge fails.
    pub edge_dropout: f64,
    /// Probability that a pixel at an edge shows its neighbour's depth (lateral noise).
    pub edge_swap: f64,
    /// Probability that a pixel at an edge shows a depth between both (a flying pixel).
    pub edge_mix: f64,
    /// Where the projector is along the camera's x axis, in metres; 0 for a camera without shadows.
    pub baseline: f64,
    /// Step in which the disparity over `baseline` is measured, in pixels; 0 when it is not.
    pub disparity_step: f64,
    /// The nearest depth measured, in metres.
    pub near: f64,
    /// The farthest depth measured, in metres.
    pub far: f64,
}

impl NoiseParams {
    /// No errors but the quantisation to 0.1 mm.
    pub fn exact() -> Self {
        Self {
            axial_floor: 0.0,
            axial_growth: 0.0,
            axial_best: 0.0,
            axial_angle: 0.0,
            grazing: FRAC_PI_2,
            dropout: 0.0,
            edge_jump: 0.02,
            edge_dropout: 0.0,
            edge_swap: 0.0,
            edge_mix: 0.0,
            baseline: 0.0,
            disparity_step: 0.0,
            near: 0.0,
            far: MAX_DEPTH_M,
        }
    }

    /// An industrial camera with projected texture and 0.1 m between its two sensors, as an Ensenso N35:
    /// 0.1 mm of noise at half a metre. The order of magnitude of its class, not a measurement of one.
    pub fn structured_light() -> Self {
        Self {
            axial_floor: 0.1e-3,
            axial_growth: 0.8e-3,
            axial_best: 0.4,
            axial_angle: 0.01e-3,
            grazing: 1.40,
            dropout: 0.002,
            edge_dropout: 0.3,
            edge_swap: 0.1,
            baseline: 0.1,
            near: 0.3,
            far: 1.5,
            ..Self::exact()
        }
    }

    /// A Kinect of the first kind: a, b, c and g from Nguyen, Izadi and Lovell (2012), disparity in
    /// eighths of a pixel over 75 mm (Khoshelham and Elberink, Sensors 2012).
    /// The swap is what their lateral deviation of 0.8 px carries over an edge half a pixel away.
    pub fn kinect_v1() -> Self {
        Self {
            axial_floor: 1.2e-3,
            axial_growth: 1.9e-3,
            axial_best: 0.4,
            axial_angle: 0.1e-3,
            grazing: 1.35,
            dropout: 0.004,
            edge_dropout: 0.3,
            edge_swap: 0.27,
            baseline: 0.075,
            disparity_step: 0.125,
            near: 0.4,
            far: 4.0,
            ..Self::exact()
        }
    }

    /// A Kinect of the second kind (time of flight): no shadow, no disparity, flying pixels at edges.
    /// The order of magnitude of published comparisons, 1 to 2 mm below a metre; near is 0.4 m, not its
    /// official 0.5 m, so that a head below a camera at 0.6 m stays in range.
    pub fn kinect_v2() -> Self {
        Self {
            axial_floor: 1.2e-3,
            axial_growth: 0.8e-3,
            axial_best: 0.5,
            axial_angle: 0.05e-3,
            grazing: 1.45,
            dropout: 0.001,
            edge_dropout: 0.15,
            edge_mix: 0.55,
            near: 0.4,
            far: 4.5,
            ..Self::exact()
        }
    }
}

/// A noise model whose numbers make sense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    params: NoiseParams,
}

impl NoiseModel {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`NoiseError`] names the first number that is out of range, with its range.
    pub fn new(params: NoiseParams) -> Result<Self, NoiseError> {
        let p = &params;
        let ranges = [
            ("axial_floor", p.axial_floor, 0.0, 0.1),
            ("axial_growth", p.axial_growth, 0.0, 1.0),
            ("axial_best", p.axial_best, 0.0, MAX_DEPTH_M),
            ("axial_angle", p.axial_angle, 0.0, 0.1),
            ("grazing", p.grazing, 0.1, FRAC_PI_2),
            ("dropout", p.dropout, 0.0, 0.99),
            ("edge_jump", p.edge_jump, 1e-3, 1.0),
            ("edge_dropout", p.edge_dropout, 0.0, 1.0),
            ("edge_swap", p.edge_swap, 0.0, 1.0),
            ("edge_mix", p.edge_mix, 0.0, 1.0),
            ("baseline", p.baseline, -1.0, 1.0),
            ("disparity_step", p.disparity_step, 0.0, 4.0),
            ("near", p.near, 0.0, MAX_DEPTH_M),
            ("far", p.far, 0.0, MAX_DEPTH_M),
        ];
        for (name, value, least, greatest) in ranges {
            if !(least..=greatest).contains(&value) {
                return Err(NoiseError::Range { name, value, least, greatest });
            }
        }
        if p.near >= p.far {
            return Err(NoiseError::EmptyRange { near: p.near, far: p.far });
        }
        let edge_sum = p.edge_dropout + p.edge_swap + p.edge_mix;
        if edge_sum > 1.0 {
            return Err(NoiseError::EdgeSum(edge_sum));
        }
        Ok(Self { params })
    }

    /// The numbers, checked.
    pub fn params(&self) -> &NoiseParams {
        &self.params
    }

    /// Standard deviation in metres of the depth `z` (metres) of a surface seen at a cosine of incidence.
    /// Beyond `grazing`, where no depth is measured, the deviation at `grazing`.
    pub fn axial_sigma(&self, z: f64, cosine: f64) -> f64 {
        let p = &self.params;
        let from_best = z - p.axial_best;
        p.axial_floor + p.axial_growth * from_best * from_best + self.angle_term(cosine) / z.sqrt()
    }

    /// The part of the deviation that grows with the angle, times the square root of the depth.
    pub(crate) fn angle_term(&self, cosine: f64) -> f64 {
        // Ten degrees short of grazing at the least, where the term has a pole.
        let theta = libm::acos(cosine.clamp(0.0, 1.0)).min(self.params.grazing).min(FRAC_PI_2 - 0.17);
        let ratio = theta / (FRAC_PI_2 - theta);
        self.params.axial_angle * ratio * ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_preset_is_accepted() {
        for params in [
            NoiseParams::exact(),
            NoiseParams::structured_light(),
            NoiseParams::kinect_v1(),
            NoiseParams::kinect_v2(),
        ] {
            assert_eq!(NoiseModel::new(params).map(|model| *model.params()), Ok(params));
        }
    }

    #[test]
    fn the_first_kinect_has_the_published_deviation() {
        let model = NoiseModel::new(NoiseParams::kinect_v1()).unwrap();
        assert!((model.axial_sigma(1.0, 1.0) - (0.0012 + 0.0019 * 0.36)).abs() < 1e-12);
        // At 60 degrees theta^2 / (pi/2 - theta)^2 is 4.
        assert!((model.axial_sigma(1.0, 0.5) - (0.0012 + 0.0019 * 0.36 + 0.0004)).abs() < 1e-12);
    }

    #[test]
    fn edge_probabilities_beyond_certainty_are_refused() {
        let params = NoiseParams { edge_dropout: 0.6, edge_mix: 0.6, ..NoiseParams::exact() };
        assert_eq!(NoiseModel::new(params), Err(NoiseError::EdgeSum(1.2)));
    }

    #[test]
    fn an_empty_range_of_depths_is_refused() {
        let params = NoiseParams { near: 1.0, far: 1.0, ..NoiseParams::exact() };
        assert_eq!(NoiseModel::new(params), Err(NoiseError::EmptyRange { near: 1.0, far: 1.0 }));
    }

    proptest! {
        #[test]
        fn a_number_out_of_range_is_refused_by_name(
            bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), -1e9..-1.1f64, 7.0..1e9f64],
        ) {
            let message = NoiseModel::new(NoiseParams { dropout: bad, ..NoiseParams::exact() }).unwrap_err();
            prop_assert!(message.to_string().starts_with(&format!("dropout is {bad};")), "{}", message);
            let baseline = NoiseParams { baseline: bad, ..NoiseParams::exact() };
            prop_assert!(NoiseModel::new(baseline).is_err());
            let far = NoiseParams { far: bad, ..NoiseParams::exact() };
            prop_assert!(NoiseModel::new(far).is_err());
        }
    }
}
