//! `b_*`: contact and grasp.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector2, Vector3, Vector6};
use serde_json::Value;
use stillpoint_mechanics::contact::chart::{ChartPoint, Surface};
use stillpoint_mechanics::contact::friction::{FingerForce, Friction};
use stillpoint_mechanics::contact::grasp::{Touch, null_space, planar, planar_arms, soft_fingers};
use stillpoint_mechanics::contact::rolling::{Contact, rate, relative};
use stillpoint_mechanics::contact::se3::{Twist, exp};
use stillpoint_mechanics::dormand_prince::{Tolerance, integrate};

use crate::reference::traction::{contact_force, deformed_area, nominal_stress};

use super::file::{Case, array, cases, number, numbers};

fn vector3(value: &Value) -> Vector3<f64> {
    array::<3>(value).into()
}

fn matrix3(value: &Value) -> Matrix3<f64> {
    Matrix3::from_rows(&[0, 1, 2].map(|i| vector3(&value[i]).transpose()))
}

fn hold_rows(case: &Case, name: &str, found: &DMatrix<f64>) {
    let rows = case.expected[name].as_array().unwrap();
    assert_eq!(rows.len(), found.nrows(), "{} {name}", case.id);
    for (i, row) in rows.iter().enumerate() {
        let row = numbers(row);
        assert_eq!(row.len(), found.ncols(), "{} {name}", case.id);
        for (j, expected) in row.iter().enumerate() {
            case.hold(&format!("{name}[{i},{j}]"), found[(i, j)], *expected);
        }
    }
}

fn dynamic<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>) -> DMatrix<f64> {
    DMatrix::from_iterator(R, C, matrix.iter().copied())
}

#[test]
fn the_exponential_of_a_twist() {
    for case in cases("b_se3_exp") {
        let twist = Twist { v: vector3(&case.given["v"]), w: vector3(&case.given["w"]) };
        hold_rows(&case, "g", &dynamic(&exp(&twist, case.input("s"))));
    }
}

fn point(value: &Value) -> ChartPoint {
    let [u, v] = array(value);
    ChartPoint::new(u, v)
}

#[test]
fn a_contact_moves_over_both_surfaces() {
    for case in cases("b_contact_kinematics") {
        let bladder = Surface::Sphere { radius: case.input("R_bladder") };
        let head = match case.given["head"].as_str().unwrap() {
            "sphere" => Surface::Sphere { radius: case.input("R_head") },
            "plane" => Surface::Plane,
            other => panic!("{other}"),
        };
        let contact = Contact {
            bladder: point(&case.given["alpha_1"]),
            head: point(&case.given["alpha_h"]),
            psi: case.input("psi"),
        };
        let twist = Twist { v: vector3(&case.given["v"]), w: vector3(&case.given["w"]) };
        let seen = relative(&head.at(&contact.head), &twist);
        case.hold_all("omega_t", seen.rolling.as_slice());
        case.hold_all("v_t", seen.sliding.as_slice());
        case.hold_output("omega_n", seen.spin);
        case.hold_output("v_normal", seen.parting);
        let moved = rate(&bladder, &head, &contact, &twist).unwrap();
        case.hold_all("alpha_1_dot", moved.bladder.as_slice());
        case.hold_all("alpha_h_dot", moved.head.as_slice());
        case.hold_output("psi_dot", moved.psi);
    }
}

#[test]
fn a_contact_that_rolls_for_a_second() {
    for case in cases("b_contact_rolling_traj") {
        let bladder = Surface::Sphere { radius: case.input("R_bladder") };
        let head = Surface::Sphere { radius: case.input("R_head") };
        let [a0, a1]: [f64; 2] = array(&case.given["omega_tangent_amp"]);
        let slope = |t: f64, eta: &SVector<f64, 5>| {
            let contact = Contact {
                bladder: ChartPoint::new(eta[0], eta[1]),
                head: ChartPoint::new(eta[2], eta[3]),
                psi: eta[4],
            };
            let here = head.at(&contact.head);
            let w = here.tangents * Vector2::new(a0 * libm::cos(2.0 * t), a1 * libm::sin(3.0 * t));
            let twist = Twist { v: -w.cross(&here.point), w };
            let moved = rate(&bladder, &head, &contact, &twist).unwrap();
            let rates = moved.bladder.iter().chain(moved.head.iter()).copied().chain([moved.psi]);
            SVector::<f64, 5>::from_iterator(rates)
        };
        let start: [f64; 5] = array(&case.given["eta0"]);
        let end = integrate(slope, 0.0, start.into(), case.input("t_end"), Tolerance::default()).unwrap();
        case.hold_all("eta", end.as_slice());
    }
}

#[test]
fn grasp_maps_and_their_null_spaces() {
    let (mut planars, mut spatials) = (0, 0);
    for case in cases("b_grasp_map") {
        if case.id.starts_with("planar") {
            planars += 1;
            let arms = planar_arms(&array(&case.given["r"]), &array(&case.given["phi"]));
            let map = planar(&arms);
            hold_rows(&case, "G", &dynamic(&map));
            let force: [f64; 8] = array(&case.given["f"]);
            case.hold_all("wrench_xy_tau", (map * SVector::from(force)).as_slice());
            let null = null_space(&dynamic(&map));
            hold_rows(&case, "null_projector", &(&null * null.transpose()));
            let given = numbers(&Value::from(
                case.expected["null_basis_orthonormal"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .flat_map(numbers)
                    .collect::<Vec<_>>(),
            ));
            let given = DMatrix::from_row_slice(8, 5, &given);
            assert!((&null * null.transpose() - &given * given.transpose()).amax() < 1e-10);
        } else {
            spatials += 1;
            let list =
                |name: &str| case.given[name].as_array().unwrap().iter().map(vector3).collect::<Vec<_>>();
            let touches: Vec<Touch> = list("r_c")
                .into_iter()
                .zip(list("normal"))
                .map(|(arm, normal)| Touch { arm, normal })
                .collect();
            let map = soft_fingers(&touches);
            let force = DVector::from_vec(numbers(&case.given["f_c"]));
            case.hold_all("wrench", (&map * force).as_slice());
            let twist = Vector6::from(array::<6>(&case.given["head_twist_vw"]));
            case.hold_all("contact_velocities", (map.transpose() * twist).as_slice());
            let null = null_space(&map);
            case.hold_output("nullity", null.ncols() as f64);
            hold_rows(&case, "null_projector", &(&null * null.transpose()));
        }
    }
    assert_eq!((planars, spatials), (5, 3));
}

#[test]
fn areas_stresses_and_friction_cones() {
    for case in cases("b_nanson_friction") {
        if case.id.starts_with("piola") {
            let (gradient, stress) = (matrix3(&case.given["F"]), matrix3(&case.given["sigma"]));
            let area = vector3(&case.given["N"]) * case.input("dA");
            let deformed = deformed_area(&gradient, &area).unwrap();
            let nominal = nominal_stress(&gradient, &stress).unwrap();
            case.hold_output("J", gradient.determinant());
            case.hold_all("da", deformed.as_slice());
            hold_rows(&case, "S_nominal", &dynamic(&nominal));
            case.hold_all("force", (stress * deformed).as_slice());
            case.hold_all("force", (nominal.transpose() * area).as_slice());
        } else if case.id.starts_with("sphere") {
            let stretch = case.input("lambda_o");
            let area = Vector3::z() * case.input("dA_ref");
            let force = contact_force(stretch, case.input("contact_pressure"), &area);
            case.hold_output("da", area.z * stretch * stretch);
            case.hold_output("normal_force", force.z);
        } else {
            let friction = Friction { sliding: case.input("mu"), spinning: case.input("gamma") };
            let finger = FingerForce {
                force: vector3(&case.given["f_contact_frame"]),
                torque: number(&case.given["tau_n"]),
            };
            let margin = friction.margin(&finger);
            assert_eq!(margin.is_inside(), case.expected["inside"].as_bool().unwrap(), "{}", case.id);
            case.hold_output("margin_tangential", margin.sliding);
            case.hold_output("margin_torsion", margin.spinning);
        }
    }
}
