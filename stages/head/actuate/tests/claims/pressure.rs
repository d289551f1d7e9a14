//! Estimated pressures beside those of the rig's bladders.

use proptest::prelude::*;
use stillpoint_actuate::pressure::{PressureEstimator, PressureParams};

const PSI: f64 = 6_894.757_293_168_361;

fn params() -> PressureParams {
    PressureParams {
        limit: 40e3,
        taper: 4e3,
        start: vec![0.0],
        volume: 0.52e-3,
        doubles_at: 50e3,
        supply: 15.0 * PSI,
        vacuum: 12.0 * PSI,
        orifice: 1e-3,
        discharge: 0.8,
    }
}

#[test]
fn a_measured_pressure_is_taken_as_it_is() {
    let mut estimator = PressureEstimator::new(&params());
    for gauge in [0.0, 1.0, 12_345.0, 60e3] {
        estimator.correct(2, gauge);
        assert!((estimator.pressure(2) - gauge).abs() < 1e-6, "{gauge}: {}", estimator.pressure(2));
        assert_eq!(estimator.pressure(1), 0.0);
    }
    for none in [f64::NAN, f64::INFINITY] {
        estimator.correct(2, none);
        assert!((estimator.pressure(2) - 60e3).abs() < 1e-6);
    }
    estimator.correct(2, -5e3);
    estimator.correct(99, 1.0);
    assert_eq!((estimator.pressure(2), estimator.pressure(99)), (0.0, 0.0));
    assert!(!estimator.is_exceeded(8));
    estimator.correct(7, 41e3);
    assert!(estimator.is_exceeded(8) && !estimator.is_exceeded(7));
}

#[test]
fn an_inlet_raises_and_an_outlet_lowers_the_pressure_of_its_own_bladder() {
    let mut estimator = PressureEstimator::new(&params());
    estimator.advance(1.0, &[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]);
    let full = estimator.pressure(1);
    assert!(full > 5e3 && estimator.pressure(0) == 0.0 && estimator.pressure(2) == 0.0, "{full}");
    estimator.advance(0.5, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert!(estimator.pressure(1) < full);
    estimator.advance(60.0, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert_eq!(estimator.pressure(1), 0.0);
    estimator.advance(f64::NAN, &[1.0; 6]);
    estimator.advance(-1.0, &[1.0; 6]);
    assert_eq!(estimator.pressure(1), 0.0);
}

#[test]
fn the_estimate_errs_upwards_of_the_bladder_under_a_head() {
    use nalgebra::Vector1;
    use stillpoint_mechanics::plant::{Drive, OneDof, State};
    use stillpoint_mechanics::shell::air::Air;
    let plant = OneDof::rig(5.0);
    let air = Vector1::new(Air::ROOM.mass(12e3, 6.5e-4));
    let position = plant.equilibrium(&air, Vector1::new(0.085)).unwrap();
    let mut state = State::at_rest(position, air);
    let pressure = |state: &State<1, 1>| plant.bladders(&state.position, &state.air)[0].pressure;
    let mut estimator = PressureEstimator::new(&params());
    estimator.correct(0, pressure(&state));
    let mut largest: f64 = 0.0;
    for step in 0..4_000 {
        let duty = if step < 2_500 { [0.3, 0.0] } else { [0.0, 0.2] };
        state = plant.advance(&state, &Drive { duty: [duty], ..plant.idle() }, 1e-3);
        estimator.advance(1e-3, &duty);
        let (real, estimate) = (pressure(&state), estimator.pressure(0));
        largest = largest.max(real);
        assert!(estimate >= real - 500.0, "step {step}: {estimate} Pa for {real} Pa");
    }
    assert!(largest > pressure(&State::at_rest(position, air)), "{largest}");
}

proptest! {
    #[test]
    fn inlets_within_their_ceilings_never_bring_a_pressure_above_the_limit(
        duties in prop::collection::vec(prop::array::uniform4(0.0..=1.0f64), 1..400),
        limit in 5e3..100e3f64,
        taper in 0.05..0.5f64,
        doubles_at in 20e3..500e3f64,
        seconds in 0.001..0.03f64,
    ) {
        let taper = taper * limit;
        let mut estimator = PressureEstimator::new(&PressureParams { limit, taper, doubles_at, ..params() });
        for duty in duties {
            // A step at full opening must be small against the taper, as the default's 0.5 kPa is against 4 kPa.
            let seconds = seconds.min(taper / 80e3);
            let inlet = |bladder: usize| duty[2 * bladder].min(estimator.ceiling(bladder));
            let openings = [inlet(0), duty[1], inlet(1), duty[3]];
            estimator.advance(seconds, &openings);
            for bladder in 0..2 {
                prop_assert!(estimator.pressure(bladder) <= limit * (1.0 + 1e-9));
            }
            prop_assert!(!estimator.is_exceeded(2));
        }
    }
}
