//! Energy balance of the simulated heads (3.47)-(3.54) over a minute of moving valves and pushes.
//!
//! ```text
//! d/dt (q'^T M q' / 2 + w q + q^T K q / 2 + sum_j (U_j + A_j)) = f q' - q'^T D q' + sum_j mu_j m_j'
//! A = m R_s T ln(p / p_atm) - (p - p_atm) V,   mu = R_s T ln(p / p_atm)
//! ```
//!
//! with the energy U of a bladder's wall, the free energy A of its air beside the room, and mu, the work that a kilogram of
//! the room's air takes at constant temperature. The bladders' forces are not in it: they only move energy.
//!
//! With contacts that roll, the walls' masses move along, sheared and twisted walls store energy, and sliding takes it.

use nalgebra::SVector;
use stillpoint_mechanics::plant::grip::Grip;
use stillpoint_mechanics::plant::layouts::START_GAP;
use stillpoint_mechanics::plant::{OneDof, Plant, State, ThreeDof};

use super::rolling::{eight, step, three};

/// Energy of the head on its bladders, J.
fn energy<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    state: &State<D, B>,
) -> f64 {
    let (q, rate) = (&state.position, &state.rate);
    let moving = plant.rolling.as_ref().map_or_else(
        || 0.5 * rate.component_mul(&plant.inertia).dot(rate),
        |rolling| {
            let heights = rolling.met(q).slopes * rate;
            let head = rolling.head_terms(&plant.inertia, q, rate).mass;
            0.5 * (rate.dot(&(head * rate)) + rolling.wall * heights.norm_squared())
        },
    );
    let head = moving + plant.weight.dot(q) + 0.5 * q.dot(&(plant.stiffness * q));
    let bladders = plant.bladders(q, &state.air);
    let stored = bladders.iter().map(|pressed| {
        let room = plant.air.atmosphere;
        let p = room + pressed.pressure;
        let air = p * pressed.volume * libm::log(p / room) - (p - room) * pressed.volume;
        plant.shell.energy(pressed.inner_stretch) + air
    });
    head + stored.sum::<f64>()
}

/// What a minute of swinging valves and pushes did, J.
struct Minute {
    /// Change of the stored energy, less what came in.
    missing: f64,
    /// Sum of the absolute values of all that came in or went out.
    exchanged: f64,
    /// What the neck took.
    lost: f64,
    slid: f64,
    /// Least force of a bladder, N.
    force: f64,
}

fn minute<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    start: State<D, B>,
    push: f64,
    friction: f64,
) -> Minute {
    const STEP: f64 = 2e-3;
    let mut state = start;
    let mut grip = Grip::<B>::new(friction, &plant.shell, START_GAP);
    let (begin, mut came, mut exchanged) = (energy(plant, &state), 0.0, 0.0);
    let (mut taken, mut slid, mut force) = (0.0, 0.0, f64::INFINITY);
    let work_per_air = |state: &State<D, B>| {
        let bladders = plant.bladders(&state.position, &state.air);
        let specific = plant.air.specific_energy();
        SVector::<f64, B>::from_fn(|j, _| specific * libm::log1p(bladders[j].pressure / plant.air.atmosphere))
    };
    for k in 0..30_000_u32 {
        let time = STEP * f64::from(k);
        let mut drive = plant.idle();
        for (j, duty) in drive.duty.iter_mut().enumerate() {
            let swing = 0.12 * libm::sin(time * (0.9 + 0.2 * j as f64));
            // An inlet passes more air than an outlet.
            *duty = [swing.max(0.0), 1.9 * (-swing).max(0.0)];
        }
        drive.force =
            SVector::from_fn(|i, _| push * libm::sin(time * (1.3 + i as f64)) / (1.0 + 20.0 * i as f64));
        let mut next = state;
        if plant.rolling.is_some() {
            slid += step(plant, &mut grip, &mut next, &drive, STEP);
        } else {
            next = plant.advance(&state, &drive, STEP);
        }
        let lost = |state: &State<D, B>| state.rate.dot(&(plant.damping * state.rate));
        let mean = 0.5 * (work_per_air(&state) + work_per_air(&next));
        let parts = [
            drive.force.dot(&(next.position - state.position)),
            -0.5 * STEP * (lost(&state) + lost(&next)),
            mean.dot(&(next.air - state.air)),
        ];
        taken -= parts[1];
        came += parts.iter().sum::<f64>();
        exchanged += parts.iter().map(|part| part.abs()).sum::<f64>();
        state = next;
        force = plant.bladders(&state.position, &state.air).iter().map(|p| p.force()).fold(force, f64::min);
    }
    let missing = energy(plant, &state) + grip.energy() - begin - came + slid;
    Minute { missing, exchanged: exchanged + slid, lost: taken, slid, force }
}

#[test]
fn the_energy_of_a_head_on_bladders_is_what_came_in_less_what_was_lost() {
    let plant = ThreeDof::rig(5.0);
    let air = plant.start_air();
    let rest = plant.equilibrium(&air, SVector::from([0.008, 0.037, 0.0])).unwrap();
    let found = minute(&plant, State::at_rest(rest, air), 3.0, 0.0);
    assert!(found.exchanged > 10.0 && found.force > 1.0, "{} J, {} N", found.exchanged, found.force);
    let part = found.missing.abs() / found.exchanged;
    assert!(part < 2e-4, "{part}: {} of {} J", found.missing, found.exchanged);
    // The balance notices 2 % of the damping.
    assert!(found.missing.abs() < 0.01 * found.lost, "{} of {} J", found.missing, found.lost);
}

#[test]
fn the_same_holds_on_one_bladder() {
    let plant = OneDof::rig(5.0);
    let air = plant.start_air();
    let rest = plant.equilibrium(&air, SVector::from([0.085])).unwrap();
    let found = minute(&plant, State::at_rest(rest, air), 10.0, 0.0);
    assert!(found.exchanged > 5.0 && found.force > 10.0, "{} J, {} N", found.exchanged, found.force);
    let part = found.missing.abs() / found.exchanged;
    assert!(part < 2e-4, "{part}: {} of {} J", found.missing, found.exchanged);
}

/// Contacts that slide freely, that stick and slide, and that stick.
const FRICTIONS: [f64; 3] = [0.0, SLIPPERY, 1e3];
const SLIPPERY: f64 = 0.02;

#[test]
fn the_same_holds_where_three_contacts_roll_slide_and_stick() {
    for friction in FRICTIONS {
        let (plant, start) = three();
        holds(&minute(&plant, start, 3.0, friction), friction);
    }
}

#[test]
fn the_same_holds_where_eight_contacts_roll_slide_and_stick() {
    for friction in FRICTIONS {
        let (plant, start) = eight();
        holds(&minute(&plant, start, 6.0, friction), friction);
    }
}

fn holds(found: &Minute, friction: f64) {
    eprintln!(
        "{friction} {} {} {} {} {}",
        found.missing, found.exchanged, found.lost, found.slid, found.force
    );
    assert!(
        found.exchanged > 5.0 && found.force >= 0.0,
        "{friction}: {} J, {} N",
        found.exchanged,
        found.force
    );
    assert_eq!(found.slid > 1e-2, friction == SLIPPERY, "{friction}: {}", found.slid);
    let part = found.missing.abs() / found.exchanged;
    assert!(part < 2e-4, "{friction}: {part}: {} of {} J", found.missing, found.exchanged);
    assert!(found.missing.abs() < 0.01 * found.lost, "{friction}: {} of {} J", found.missing, found.lost);
}
