//! `c_valve_flow`, `c_bladder_contact`, `c_rig_*`: valves, a pressed bladder, and the heads on bladders.

use nalgebra::{SMatrix, SVector};
use serde_json::Value;
use stillpoint_mechanics::dormand_prince::{Tolerance, integrate};
use stillpoint_mechanics::plant::valve::Orifice;
use stillpoint_mechanics::plant::{OneDof, Plant, State, ThreeDof};
use stillpoint_mechanics::shell::Shell;
use stillpoint_mechanics::shell::air::Air;

use super::file::{Case, array, cases, number, numbers};

fn air(given: &Value) -> Air {
    Air {
        gas_constant: number(&given["R"]),
        gamma: number(&given["gamma"]),
        temperature: number(&given["T"]),
        atmosphere: number(&given["P_atm"]),
    }
}

#[test]
fn flow_through_an_orifice() {
    for case in cases("c_valve_flow") {
        let law = Orifice::new(&air(&case.given));
        let area = case.input("Cd") * case.input("area");
        case.hold_output("mdot", law.flow(area, case.input("P_up"), case.input("P_down")));
    }
}

#[test]
fn a_bladder_with_a_mass_of_air_between_plates() {
    for case in cases("c_bladder_contact") {
        let shell =
            Shell::new(case.input("C1"), case.input("C2"), case.input("Ri"), case.input("Ro")).unwrap();
        let pressed = shell.pressed_with(case.input("air_mass"), &air(&case.given), case.input("gap"));
        case.hold_output("lambda_i", pressed.inner_stretch);
        case.hold_output("P_gauge", pressed.pressure);
        case.hold_output("volume", pressed.volume);
        case.hold_output("contact_area", pressed.area);
        case.hold_output("r_o", pressed.radius);
        case.hold_output("force", pressed.force());
    }
}

/// Follows a schedule of duties from the file's first state, and holds each state that the file has.
fn hold_trajectory<const D: usize, const B: usize, const N: usize>(case: &Case, plant: &Plant<D, B, N>) {
    let given = &case.given;
    let mut drive = plant.idle();
    assert_eq!((drive.supply, drive.exhaust), (plant.valves.supply, plant.valves.exhaust));
    let schedule: Vec<(f64, Vec<f64>)> = given["schedule_t_u"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| (number(&entry[0]), numbers(&entry[1])))
        .collect();
    let times = numbers(&given["t"]);
    let expected = case.expected["y"].as_array().unwrap();
    let mut packed = SVector::<f64, N>::from_column_slice(&numbers(&given["y0"]));
    let mut t = times[0];
    for (next, expected) in times.iter().zip(expected) {
        // The duties jump: no step goes over a jump.
        while t < *next {
            let (_, duties) = schedule.iter().rev().find(|(at, _)| *at <= t + 1e-12).unwrap();
            for (i, duty) in duties.iter().enumerate() {
                drive.duty[i / 2][i % 2] = *duty;
            }
            let jump = schedule.iter().map(|(at, _)| *at).find(|at| *at > t + 1e-12 && *at < *next);
            let to = jump.unwrap_or(*next);
            let tolerance = Tolerance { relative: 1e-10, absolute: 1e-13, steps: 100_000 };
            packed = integrate(|_, y| plant.slope(y, &drive), t, packed, to, tolerance).unwrap();
            t = to;
        }
        for (i, expected) in numbers(expected).iter().enumerate() {
            case.hold(&format!("y[{i}] at {t} s"), packed[i], *expected);
        }
    }
}

fn hold_parts<const D: usize, const B: usize, const N: usize>(case: &Case, plant: &Plant<D, B, N>) {
    let (valve, bladder) = (&case.given["valve"], &case.given["bladder"]);
    assert_eq!(air(&case.given["air"]), plant.air);
    let of = |name: &str| number(&bladder[name]);
    assert_eq!(Shell::new(of("C1"), of("C2"), of("Ri"), of("Ro")), Ok(plant.shell));
    for (name, found) in [
        ("Cd", plant.valves.discharge),
        ("d", plant.valves.diameter),
        ("tau", plant.valves.lag),
        ("P_supply", plant.valves.supply),
        ("P_vacuum", plant.valves.exhaust),
    ] {
        assert!((found - number(&valve[name])).abs() < 1e-9 * found, "{name}: {found}");
    }
}

#[test]
fn the_head_on_one_bladder_follows_the_reference() {
    let case = &cases("c_rig_1dof_traj")[0];
    let plant = OneDof::rig(number(&case.given["rig"]["m"]));
    hold_parts(case, &plant);
    hold_trajectory(case, &plant);
    let air = number(&case.given["y0"][2]);
    assert!((plant.start_air()[0] - air).abs() < 1e-9 * air, "{}", plant.start_air());
}

#[test]
fn the_head_on_three_bladders_follows_the_reference() {
    let case = &cases("c_rig_3dof_traj")[0];
    let rig = &case.given["rig"];
    let plant = ThreeDof::rig(number(&rig["m"]));
    hold_parts(case, &plant);
    let (k, l) = (number(&rig["k_neck"]), number(&rig["l_neck"]));
    let stiffness =
        [k, -k * l, 0.0, -k * l, k * l * l + number(&rig["k_pitch"]), 0.0, 0.0, 0.0, number(&rig["k_roll"])];
    assert!((plant.stiffness - SMatrix::<f64, 3, 3>::from_row_slice(&stiffness)).amax() < 1e-12);
    for j in 0..3 {
        let row: [f64; 3] = array(&rig["J"][j]);
        assert_eq!(plant.jacobian.row(j).iter().copied().collect::<Vec<_>>(), row);
    }
    hold_trajectory(case, &plant);
    let start: [f64; 15] = array(&case.given["y0"]);
    let air = plant.start_air();
    assert!((0..3).all(|j| (air[j] - start[6 + j]).abs() < 1e-9 * air[j]), "{air}");
    let rest = plant.equilibrium(&air, SVector::zeros()).unwrap();
    assert!((0..3).all(|i| (rest[i] - start[i]).abs() < 1e-9), "{rest}");
}

#[test]
fn a_step_of_a_millisecond_is_fine_enough() {
    let case = &cases("c_rig_3dof_traj")[0];
    let plant = ThreeDof::rig(5.0);
    let packed: [f64; 15] = array(&case.given["y0"]);
    let start = State::<3, 3>::unpack(&SVector::<f64, 15>::from(packed));
    let mut drive = plant.idle();
    drive.duty[0][0] = 0.25;
    let run = |h: f64, steps: u32| (0..steps).fold(start, |state, _| plant.advance(&state, &drive, h));
    let (coarse, fine) = (run(1e-3, 1000), run(1e-4, 10_000));
    assert!((coarse.position - fine.position).amax() < 1e-9, "{} {}", coarse.position, fine.position);
}

#[test]
fn the_head_rests_where_the_reference_says() {
    let plant = ThreeDof::rig(5.0);
    for case in cases("c_rig_3dof_static") {
        let air: [f64; 3] = array(&case.given["air_mass"]);
        let q = plant.equilibrium(&air.into(), SVector::zeros()).unwrap();
        case.hold_all("q", q.as_slice());
    }
}

#[test]
fn from_any_air_the_head_comes_to_rest_where_the_forces_balance() {
    // The trajectory of the file begins with one amount of air. Here the air is another one, and the head of another mass;
    // the end of the trajectory is held against Newton's method on the static forces.
    for (mass, parts) in [(5.0, [1.0, 1.0, 1.0]), (4.0, [1.04, 0.98, 1.0]), (6.0, [1.05, 1.0, 1.06])] {
        let plant = ThreeDof::rig(mass);
        let air = plant.start_air().component_mul(&SVector::from(parts));
        let rest = plant.equilibrium(&air, SVector::zeros()).unwrap();
        let mut state = State::at_rest(rest + SVector::from([0.004, 0.01, 0.05]), air);
        for _ in 0..8000 {
            state = plant.advance(&state, &plant.idle(), 1e-3);
        }
        assert!((state.position - rest).amax() < 1e-6, "{mass} kg: {} {rest}", state.position);
        // Shut valves let no air through.
        assert_eq!(state.air, air);
    }
}

#[test]
fn the_heads_pose_follows_the_air_as_the_reference_says() {
    let case = &cases("e_closed_loop_rig")[0];
    let plant = ThreeDof::rig(5.0);
    let air = plant.start_air();
    case.hold("g_flow", plant.inlet_flow(10e3), number(&case.given["g_flow"]));
    let slopes = plant.pose_by_air(&air, SVector::zeros()).unwrap();
    for i in 0..3 {
        let expected: [f64; 3] = array(&case.given["S_dq_dmair"][i]);
        for (j, expected) in expected.iter().enumerate() {
            // Differences over 0.1 %: what the reference's own equilibria leave over.
            let found = slopes[(i, j)];
            assert!((found - expected).abs() < 1e-6 * expected.abs() + 1e-6, "{i} {j}: {found} {expected}");
        }
    }
}
