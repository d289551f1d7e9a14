//! The adaptive law in rates: its equations, the error bound (4.38), and that the rise of the reference model does not
//! matter.

use nalgebra::{DMatrix, SMatrix, SVector, Vector2};
use stillpoint_control::effect::Effect;
use stillpoint_control::features::Features;
use stillpoint_control::mrac::{Learning, Mrac, MracDesign};
use stillpoint_control::projection::Ball;
use stillpoint_control::reference::{ReferenceModel, pole_of_rise};
use stillpoint_control::tracking::Tracking;
use stillpoint_mechanics::dormand_prince;

/// B of two channels and two bladders.
fn matrix() -> SMatrix<f64, 2, 2> {
    SMatrix::<f64, 2, 2>::new(1.1, 0.8, 4.0, -6.0)
}

fn design(learning: [f64; 3], leak: f64) -> MracDesign {
    MracDesign {
        feedback: 2.37,
        learning,
        leak,
        ball: Ball { radius: 50.0, shell: 0.1 },
        dead_zone: vec![0.0; 2],
    }
}

fn law(design: MracDesign) -> Mrac {
    let effect = Effect::new(DMatrix::from_iterator(2, 2, matrix().iter().copied())).unwrap();
    Mrac::design(design, effect, Features::Tanh).unwrap()
}

/// A plant `m' = B u + d`, held by the law every `dt` seconds without delay. Returns m, the errors and the net duties.
struct Loop {
    law: Mrac,
    tracking: Tracking,
    m: Vector2<f64>,
    dt: f64,
    time: f64,
}

impl Loop {
    fn new(design: MracDesign, rise: f64, m: [f64; 2], dt: f64) -> Self {
        let mut tracking = Tracking::new(ReferenceModel::new(pole_of_rise(rise), 2), 0.0);
        tracking.restart(&[0.0; 2]);
        Self { law: law(design), tracking, m: m.into(), dt, time: 0.0 }
    }

    /// Goes on by one step; `disturbance` gets the time, the pose and the error.
    fn step(
        &mut self,
        requested: [f64; 2],
        disturbance: impl Fn(f64, &Vector2<f64>, &Vector2<f64>) -> Vector2<f64>,
    ) -> Vector2<f64> {
        let mut net = [0.0; 2];
        self.tracking.look(self.m.as_slice(), 0.0, &requested, self.dt);
        let error = Vector2::from_column_slice(self.tracking.errors().seen);
        let learning =
            self.law.step(self.m.as_slice(), &requested, &self.tracking.errors(), self.dt, &mut net);
        assert_ne!(learning, Learning::Saturated);
        let d = disturbance(self.time, &self.m, &error);
        self.m += (matrix() * Vector2::from(net) + d) * self.dt;
        self.time += self.dt;
        error
    }
}

/// Pose, model, K_y, K_r and Theta.
const STATE: usize = 2 + 2 + 4 + 4 + 6;

#[test]
fn the_law_follows_its_differential_equations() {
    let (learning, leak, pole) = ([3.0, 2.0, 4.0], 0.3, pole_of_rise(2.0));
    let requested = Vector2::new(0.3, -0.2);
    let drift = |m: &Vector2<f64>| Vector2::new(0.1 - 0.4 * m[0], -0.2 * libm::tanh(m[1]) + 0.1);
    let b = matrix();
    let inverse = b.try_inverse().unwrap();
    let slope = |_: f64, state: &SVector<f64, STATE>| {
        let (m, model) = (Vector2::new(state[0], state[1]), Vector2::new(state[2], state[3]));
        let e = m - model;
        let phi = [1.0, libm::tanh(m[0]), libm::tanh(m[1])];
        let regressors: [&[f64]; 3] = [m.as_slice(), requested.as_slice(), &phi];
        let mut slope = SVector::<f64, STATE>::zeros();
        let mut u = inverse * ((requested - model) * pole - e * 2.37);
        let drives = inverse * e;
        let mut at = 4;
        for (regressor, rate) in regressors.into_iter().zip(learning) {
            for j in 0..2 {
                for x in regressor {
                    u[j] += state[at] * x;
                    slope[at] = -rate * x * drives[j] - leak * state[at];
                    at += 1;
                }
            }
        }
        let moved = b * u + drift(&m);
        slope.fixed_rows_mut::<2>(0).copy_from(&moved);
        slope.fixed_rows_mut::<2>(2).copy_from(&((requested - model) * pole));
        slope
    };
    let mut exact = SVector::<f64, STATE>::zeros();
    exact[0] = 0.2;
    let dt = 5e-4;
    let mut run = Loop::new(design(learning, leak), 2.0, [0.2, 0.0], dt);
    for k in 0..20_000 {
        run.step(requested.into(), |_, m, _| drift(m));
        exact = dormand_prince::step(slope, 0.0, &exact, dt).state;
        let off = (run.m - Vector2::new(exact[0], exact[1])).amax();
        assert!(off < 3e-4, "{k}: {} {exact}", run.m);
    }
    let norms: Vec<f64> = [(4, 4), (8, 4), (12, 6)].map(|(at, n)| exact.rows(at, n).norm()).to_vec();
    for (gains, norm) in run.law.gains().iter().zip(&norms) {
        assert!(*norm > 1e-3 && (gains.norm() - norm).abs() < 0.01 * norm, "{} {norms:?}", gains.norm());
    }
}

#[test]
fn the_rise_of_the_reference_model_does_not_change_how_an_error_dies_out() {
    let errors = |rise: f64| -> Vec<Vector2<f64>> {
        let mut run = Loop::new(design([0.0, 0.0, 1.0], 0.0), rise, [0.1, -0.05], 0.01);
        // Theta learns over the constant alone: the other features are left out of the comparison.
        (0..1500).map(|_| run.step([0.0; 2], |_, _, _| Vector2::new(-0.05, 0.1))).collect()
    };
    let fast = errors(3.0);
    for rise in [5.0, 20.0] {
        for (k, (a, b)) in fast.iter().zip(&errors(rise)).enumerate() {
            assert!((a - b).amax() < 1e-12, "{rise} s, step {k}: {a} {b}");
        }
    }
    assert!(fast[1499].amax() < 1e-3, "{}", fast[1499]);
}

#[test]
fn no_disturbance_keeps_the_error_beyond_its_bound_and_one_comes_near() {
    // Nothing of it can be learned: it always pushes away from the model.
    let design = design([0.0; 3], 0.0);
    let bound = design.error_bound(0.1, 0.0, 2);
    assert!((bound.radius - 0.1 / 2.37).abs() < 1e-12);
    let away = |_: f64, _: &Vector2<f64>, e: &Vector2<f64>| {
        if e.norm() > 1e-9 { e * (0.1 / e.norm()) } else { Vector2::new(0.1, 0.0) }
    };
    for rise in [3.0, 20.0] {
        let mut run = Loop::new(design.clone(), rise, [0.3, 0.0], 0.002);
        let all: Vec<f64> = (0..10_000).map(|_| run.step([0.2, 0.1], away).norm()).collect();
        let late = all[5000..].iter().copied().fold(0.0, f64::max);
        assert!(late < 1.01 * bound.radius && late > 0.98 * bound.radius, "{late} {bound:?}");
    }
}

#[test]
fn with_learning_the_mean_square_stays_below_its_bound_and_a_constant_is_learned() {
    for (leak, learning) in [(0.0005, 1.0), (0.05, 1.0), (0.5, 4.0)] {
        let design = design([0.0, 0.0, learning], leak);
        let bound = design.error_bound(0.02, 0.2, 2);
        let mut run = Loop::new(design, 5.0, [0.0; 2], 0.002);
        // A constant, which a feature explains, and a wave of 0.02, which none does.
        let push = |t: f64, _: &Vector2<f64>, _: &Vector2<f64>| {
            Vector2::new(0.2 + 0.02 * libm::sin(1.5 * t), 0.02 * libm::cos(1.5 * t))
        };
        let all: Vec<f64> = (0..100_000).map(|_| run.step([0.0; 2], push).norm_squared()).collect();
        let late = &all[20_000..];
        let found = (late.iter().sum::<f64>() / late.len() as f64).sqrt();
        assert!(found < bound.root_mean_square, "{leak}: {found} {bound:?}");
        // Without learning the constant alone would leave 0.2 / 2.37.
        assert!(found < 0.7 * 0.2 / 2.37, "{leak}: {found}");
    }
    // A rate of zero learns nothing: all of it is left.
    let bound = design([0.0; 3], 0.01).error_bound(0.02, 0.2, 2);
    assert!((bound.radius - 0.22 / 2.37).abs() < 1e-12 && bound.root_mean_square == bound.radius);
}
