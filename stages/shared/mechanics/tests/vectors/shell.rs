//! `a_shell_*`: a free shell.

use stillpoint_mechanics::shell::Shell;
use stillpoint_mechanics::shell::air::Air;
use stillpoint_mechanics::shell::inverse::InverseError;

use crate::reference::inertia::{Swelling, moving_pressure};

use super::file::{Case, cases, number};

const PSI: f64 = 6894.757293168361;

fn shell(case: &Case) -> Shell {
    Shell::new(case.input("C1"), case.input("C2"), case.input("Ri"), case.input("Ro")).unwrap()
}

#[test]
fn pressure_slope_volumes_and_stresses_of_an_inflated_shell() {
    for case in cases("a_shell_forward") {
        let shell = shell(&case);
        let stretch = case.input("ri") / case.input("Ri");
        case.hold_output("lambda_i", stretch);
        case.hold_output("lambda_o", shell.outer_stretch(stretch));
        case.hold_output("ro", shell.surface_radius(stretch));
        case.hold_output("P", shell.pressure(stretch));
        case.hold_output("P_psi", shell.pressure(stretch) / PSI);
        case.hold_output("dP_dri", shell.pressure_slope(stretch) / case.input("Ri"));
        case.hold_output("cavity_volume", shell.cavity_volume(stretch));
        case.hold_output("wall_volume", shell.wall_volume());
        let profile = case.expected["stress"].as_array().unwrap();
        assert_eq!(profile.len(), 5);
        // The stresses are differences of numbers of the size of the moduli.
        for point in profile {
            let r = number(&point["r"]);
            let stress = shell.stress(stretch, r, 0.0);
            case.hold("R", shell.radius_at_rest(stretch, r), number(&point["R"]));
            case.hold("lambda", r / shell.radius_at_rest(stretch, r), number(&point["lam"]));
            let slack = 1e-14 * case.input("C1").max(case.input("C2"));
            for (name, found) in
                [("sigma_rr", stress.radial), ("sigma_tt", stress.hoop), ("p_hydro", stress.pressure)]
            {
                let expected = number(&point[name]);
                if (found - expected).abs() > slack {
                    case.hold(name, found, expected);
                }
            }
        }
    }
}

#[test]
fn the_stretch_at_a_pressure_its_limits_and_all_other_roots() {
    for case in cases("a_shell_inverse") {
        let shell = shell(&case);
        let pressure = case.input("P");
        let limits = shell.limit_points();
        let of = |pick: fn(&stillpoint_mechanics::shell::pressure::LimitPoint) -> f64| {
            limits.iter().map(pick).collect::<Vec<f64>>()
        };
        case.hold_all("limit_points_lambda_i", &of(|l| l.inner_stretch));
        case.hold_all("limit_pressures", &of(|l| l.pressure));
        case.hold_all("roots_lambda_i", &shell.inner_stretches_at(pressure));
        let stable = shell.inner_stretch_at(pressure);
        if case.expected["stable_lambda_i"].is_null() {
            assert!(matches!(stable, Err(InverseError::BeyondLimit { .. })), "{}: {stable:?}", case.id);
        } else {
            case.hold_output("stable_lambda_i", stable.unwrap());
            case.hold_output("stable_ri", stable.unwrap() * case.input("Ri"));
        }
    }
}

#[test]
fn the_stretch_that_an_amount_of_air_gives() {
    for case in cases("a_shell_air_mass") {
        let shell = shell(&case);
        let air = Air {
            gas_constant: case.input("R_specific"),
            gamma: 1.4,
            temperature: case.input("T"),
            atmosphere: case.input("P_atm"),
        };
        let stretch = shell.inner_stretch_with(case.input("air_mass"), &air).unwrap();
        case.hold_output("lambda_i", stretch);
        case.hold_output("ri", shell.cavity_radius(stretch));
        case.hold_output("P_gauge", shell.pressure(stretch));
    }
}

#[test]
fn the_pressure_that_moves_a_shells_wall() {
    for case in cases("a_shell_dynamic") {
        let shell = shell(&case);
        let swelling = Swelling {
            radius: case.input("ri"),
            rate: case.input("ri_dot"),
            acceleration: case.input("ri_ddot"),
        };
        case.hold_output("P", moving_pressure(&shell, &swelling, case.input("rho")));
        case.hold_output("P_static", shell.pressure(case.input("ri") / case.input("Ri")));
    }
}
