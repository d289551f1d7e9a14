//! `c_spherical_el`, `c_constrained_head`: equations of motion.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector3, Vector4};
use serde_json::Value;
use stillpoint_mechanics::dormand_prince::{Tolerance, integrate};
use stillpoint_mechanics::dynamics::reduced::{Carried, Terms, acceleration, together};

use crate::reference::constrained::{self, Constraints};
use crate::reference::spherical::{self, Motion};

use super::file::{Case, array, cases, number, numbers};

const TOLERANCE: Tolerance = Tolerance { relative: 1e-12, absolute: 1e-14, steps: 1_000_000 };

fn vector3(value: &Value) -> Vector3<f64> {
    array::<3>(value).into()
}

fn hold_matrix<const R: usize, const C: usize>(case: &Case, name: &str, found: &SMatrix<f64, R, C>) {
    let rows = case.expected[name].as_array().unwrap();
    assert_eq!(rows.len(), R);
    for (i, row) in rows.iter().enumerate() {
        for (j, expected) in numbers(row).iter().enumerate() {
            case.hold(&format!("{name}[{i},{j}]"), found[(i, j)], *expected);
        }
    }
}

#[test]
fn a_mass_in_spherical_coordinates() {
    let mut flights = 0;
    for case in cases("c_spherical_el") {
        let mass = case.input("m");
        if case.id != "free_flight" {
            let motion =
                Motion { q: vector3(&case.given["q_r_phi_theta"]), rate: vector3(&case.given["qd"]) };
            hold_matrix(&case, "M", &spherical::mass_matrix(mass, &motion));
            hold_matrix(&case, "C", &spherical::velocity_matrix(mass, &motion));
            let tau = spherical::force(mass, &motion, &vector3(&case.given["qdd"]));
            case.hold_all("tau", tau.as_slice());
            continue;
        }
        flights += 1;
        let (q, rate) = (vector3(&case.given["q0"]), vector3(&case.given["qd0"]));
        let slope = |_: f64, y: &SVector<f64, 6>| {
            let motion = Motion { q: y.fixed_rows::<3>(0).into(), rate: y.fixed_rows::<3>(3).into() };
            let faster = spherical::acceleration(mass, &motion, &Vector3::zeros());
            SVector::<f64, 6>::from_iterator(motion.rate.iter().chain(faster.iter()).copied())
        };
        let start = SVector::<f64, 6>::from_iterator(q.iter().chain(rate.iter()).copied());
        let end = integrate(slope, 0.0, start, case.input("t_end"), TOLERANCE).unwrap();
        case.hold_all("q", &end.as_slice()[..3]);
        case.hold_all("qd", &end.as_slice()[3..]);
        let motion = Motion { q: end.fixed_rows::<3>(0).into(), rate: end.fixed_rows::<3>(3).into() };
        case.hold_output("energy", spherical::energy(mass, &motion));
    }
    assert_eq!(flights, 1);
}

/// A planar head (x, y, angle) that carries two point masses at points of its own.
struct Planar {
    mass: f64,
    inertia: f64,
    points: [Vector2<f64>; 2],
    masses: [f64; 2],
    force: Vector4<f64>,
}

impl Planar {
    fn of(case: &Case) -> Self {
        let pair = |name: &str, i: usize| Vector2::from(array::<2>(&case.given[name][i]));
        let (one, two) = (pair("F", 0), pair("F", 1));
        Self {
            mass: case.input("m_head"),
            inertia: case.input("I_head"),
            points: [pair("b", 0), pair("b", 1)],
            masses: array(&case.given["m_contact"]),
            force: Vector4::new(one.x, one.y, two.x, two.y),
        }
    }

    fn turned(angle: f64) -> Matrix2<f64> {
        let (s, c) = (libm::sin(angle), libm::cos(angle));
        Matrix2::new(c, -s, s, c)
    }

    fn carried(&self, q: &Vector3<f64>, rate: &Vector3<f64>) -> Carried<3, 4> {
        let mut carried = Carried::<3, 4> { map: SMatrix::zeros(), map_rate: SMatrix::zeros() };
        for (i, point) in self.points.iter().enumerate() {
            let arm = Self::turned(q.z) * point;
            carried.map.fixed_view_mut::<2, 2>(2 * i, 0).copy_from(&Matrix2::identity());
            carried.map.fixed_view_mut::<2, 1>(2 * i, 2).copy_from(&Vector2::new(-arm.y, arm.x));
            carried.map_rate.fixed_view_mut::<2, 1>(2 * i, 2).copy_from(&(-arm * rate.z));
        }
        carried
    }

    fn terms(&self, carried: &Carried<3, 4>) -> Terms<3> {
        let [one, two] = self.masses;
        let head = Terms {
            mass: SMatrix::from_diagonal(&Vector3::new(self.mass, self.mass, self.inertia)),
            velocity: SMatrix::zeros(),
            load: SVector::zeros(),
        };
        let bodies = Terms {
            mass: SMatrix::from_diagonal(&Vector4::new(one, one, two, two)),
            velocity: SMatrix::zeros(),
            load: SVector::zeros(),
        };
        together(&head, &bodies, carried)
    }

    fn faster(&self, q: &Vector3<f64>, rate: &Vector3<f64>) -> Vector3<f64> {
        let carried = self.carried(q, rate);
        acceleration(&self.terms(&carried), &carried, rate, &self.force).unwrap()
    }

    /// Head and masses as seven coordinates under four constraints.
    fn constrained(&self, q: &SVector<f64, 7>, rate: &SVector<f64, 7>) -> constrained::Solution<7, 4> {
        let (head, head_rate) = (q.fixed_rows::<3>(0).into_owned(), rate.fixed_rows::<3>(0).into_owned());
        let carried = self.carried(&head, &head_rate);
        let mut jacobian = SMatrix::<f64, 4, 7>::zeros();
        jacobian.fixed_view_mut::<4, 3>(0, 0).copy_from(&carried.map);
        jacobian.fixed_view_mut::<4, 4>(0, 3).copy_from(&-SMatrix::<f64, 4, 4>::identity());
        let mut value = Vector4::zeros();
        for (i, point) in self.points.iter().enumerate() {
            let gap = head.xy() + Self::turned(head.z) * point - q.fixed_rows::<2>(3 + 2 * i);
            value.fixed_rows_mut::<2>(2 * i).copy_from(&gap);
        }
        let constraints =
            Constraints { value, jacobian, bias: carried.map_rate * head_rate, damping: [5.0, 5.0] };
        let [one, two] = self.masses;
        let mass = SMatrix::from_diagonal(&SVector::<f64, 7>::from([
            self.mass,
            self.mass,
            self.inertia,
            one,
            one,
            two,
            two,
        ]));
        let mut force = SVector::<f64, 7>::zeros();
        force.fixed_rows_mut::<4>(3).copy_from(&self.force);
        constrained::solve(&mass, &force, rate, &constraints).unwrap()
    }

    fn start(&self, q: &Vector3<f64>, rate: &Vector3<f64>) -> SVector<f64, 14> {
        let mut y = SVector::<f64, 14>::zeros();
        y.fixed_rows_mut::<3>(0).copy_from(q);
        for (i, point) in self.points.iter().enumerate() {
            y.fixed_rows_mut::<2>(3 + 2 * i).copy_from(&(q.xy() + Self::turned(q.z) * point));
        }
        y.fixed_rows_mut::<3>(7).copy_from(rate);
        y.fixed_rows_mut::<4>(10).copy_from(&(self.carried(q, rate).map * rate));
        y
    }
}

#[test]
fn a_head_that_carries_two_masses_reduced_and_under_constraints() {
    for case in cases("c_constrained_head") {
        let planar = Planar::of(&case);
        let (q, rate) = (vector3(&case.given["q"]), vector3(&case.given["qd"]));
        let end = number(&case.given["t_end"]);

        let carried = planar.carried(&q, &rate);
        let terms = planar.terms(&carried);
        hold_matrix(&case, "M", &terms.mass);
        hold_matrix(&case, "C", &terms.velocity);
        case.hold_all("Q", (carried.map.transpose() * planar.force).as_slice());
        case.hold_all("qdd", planar.faster(&q, &rate).as_slice());
        let slope = |_: f64, y: &SVector<f64, 6>| {
            let (q, rate) = (y.fixed_rows::<3>(0).into_owned(), y.fixed_rows::<3>(3).into_owned());
            SVector::<f64, 6>::from_iterator(rate.iter().chain(planar.faster(&q, &rate).iter()).copied())
        };
        let start = SVector::<f64, 6>::from_iterator(q.iter().chain(rate.iter()).copied());
        let reduced = integrate(slope, 0.0, start, end, TOLERANCE).unwrap();
        case.hold_all("q_end", &reduced.as_slice()[..3]);
        case.hold_all("qd_end", &reduced.as_slice()[3..]);

        let start = planar.start(&q, &rate);
        let parts =
            |y: &SVector<f64, 14>| (y.fixed_rows::<7>(0).into_owned(), y.fixed_rows::<7>(7).into_owned());
        let (position, speed) = parts(&start);
        let solution = planar.constrained(&position, &speed);
        case.hold_all("qdd", &solution.acceleration.as_slice()[..3]);
        case.hold_all("lambda", solution.multiplier.as_slice());
        let slope = |_: f64, y: &SVector<f64, 14>| {
            let (q, rate) = parts(y);
            let faster = planar.constrained(&q, &rate).acceleration;
            SVector::<f64, 14>::from_iterator(rate.iter().chain(faster.iter()).copied())
        };
        let whole = integrate(slope, 0.0, start, end, TOLERANCE).unwrap();
        case.hold_all("q_end", &whole.as_slice()[..3]);
        case.hold_all("qd_end", &whole.as_slice()[7..10]);
    }
}
