//! The adaptive loop on the rig of three bladders (SCIENCE E11), against the reference run.

use nalgebra::{DMatrix, DVector, Vector3};
use serde_json::Value;
use stillpoint_control::effect::Effect;
use stillpoint_control::features::Features;
use stillpoint_control::mrac::{Mrac, MracDesign};
use stillpoint_control::projection::Ball;
use stillpoint_control::reference::ReferenceModel;
use stillpoint_control::tracking::Tracking;
use stillpoint_control::valves::split;
use stillpoint_mechanics::plant::{State, ThreeDof};

use super::vectors::{
    assert_all_close, assert_close, assert_matrix_close, cases, number, numbers, vector, vectors,
};

/// Gauge pressure at which the flow of an inlet counts, Pa.
const NOMINAL: f64 = 10e3;

fn effect(plant: &ThreeDof, air: &Vector3<f64>, start: Vector3<f64>, scale: &[f64]) -> Effect {
    let slopes = plant.pose_by_air(air, start).unwrap() * plant.inlet_flow(NOMINAL);
    Effect::new(DMatrix::from_fn(3, 3, |i, j| slopes[(i, j)] / scale[i])).unwrap()
}

fn design(case: &Value) -> MracDesign {
    let given = &case["in"];
    MracDesign {
        // The reference has multiples of the pole, and rates before P = 50 / a.
        feedback: 4.0 * number(&given["a"]),
        learning: [0, 1, 2].map(|i| number(&given["gamma_y_r_theta"][i]) * 50.0 / number(&given["a"])),
        leak: number(&given["sigma"]),
        ball: Ball { radius: 10.0, shell: 0.1 },
        dead_zone: vec![0.0; 3],
    }
}

#[test]
fn the_adaptive_loop_on_the_rig_follows_the_reference_run() {
    for case in cases(vectors!("e_closed_loop_rig")) {
        let (given, out) = (&case["in"], &case["out"]);
        let plant = ThreeDof::rig(number(&given["rig"]["m"]));
        let air = vector::<3>(&given["air_mass0"]);
        let start = plant.equilibrium(&air, vector::<3>(&out["q0"])).unwrap();
        assert_all_close(&case, "q0", start.as_slice(), &out["q0"]);
        assert_close(&case, "g", plant.inlet_flow(NOMINAL), number(&given["g_flow"]));
        let scale = numbers(&given["scale_m_rad_rad"]);
        let effect = effect(&plant, &air, start, &scale);
        assert_matrix_close(&case, "B", effect.matrix(), &given["B0"]);

        let mut law = Mrac::design(design(&case), effect, Features::Tanh).unwrap();
        // Orders act at once here, and poses are not late.
        let mut tracking = Tracking::new(ReferenceModel::new(number(&given["a"]), 3), 0.0);
        tracking.restart(&[0.0; 3]);
        let mut state = State::at_rest(start, air);
        let (period, end) = (number(&given["Ts"]), number(&given["t_end"]));
        let requested = numbers(&given["y_des_scaled"]);
        let (mut net, mut duty) = ([0.0; 3], [0.0; 6]);
        let (mut worst, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
        let steps = (end / period).round() as usize;
        for k in 0..steps {
            let m: Vec<f64> = (0..3).map(|i| (state.position[i] - start[i]) / scale[i]).collect();
            tracking.look(&m, 0.0, &requested, if k == 0 { 0.0 } else { period });
            law.step(&m, &requested, &tracking.errors(), period, &mut net);
            let error = DVector::from_column_slice(tracking.errors().seen);
            for i in 0..3 {
                worst[i] = worst[i].max(error[i].abs());
                if k >= steps - 100 {
                    squares[i] += error[i] * error[i] / 100.0;
                }
            }
            if k % 20 == 0 {
                let row = k / 20;
                let what = |name: &str| format!("{name} at {} s", number(&out["t"][row]));
                assert_all_close(&case, &what("q"), state.position.as_slice(), &out["q"][row]);
                assert_all_close(&case, &what("v"), &net, &out["v"][row]);
                let model: Vec<f64> = (0..3).map(|i| m[i] - error[i]).collect();
                assert_all_close(&case, &what("y_m"), &model, &out["y_m"][row]);
            }
            let _ = split(&net, &mut duty);
            let mut drive = plant.idle();
            for j in 0..3 {
                drive.duty[j] = [duty[2 * j], duty[2 * j + 1]];
            }
            for _ in 0..100 {
                state = plant.advance(&state, &drive, period / 100.0);
            }
        }
        assert_all_close(&case, "max |e|", &worst, &out["max_abs_e"]);
        assert_all_close(&case, "rms e", &squares.map(f64::sqrt), &out["rms_e_last_10s"]);
    }
}
