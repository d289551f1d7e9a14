//! The plants with contacts that roll: energy, constraints, forward map, sliding, and the plants with fixed contacts
//! beside them.

use nalgebra::{SMatrix, SVector, Vector4};
use proptest::prelude::*;
use stillpoint_mechanics::contact::forward::{across, bladder_rates, head_rate};
use stillpoint_mechanics::plant::grip::Grip;
use stillpoint_mechanics::plant::layouts::{FOAM, START_GAP, rolling};
use stillpoint_mechanics::plant::rolling::Rolling;
use stillpoint_mechanics::plant::{Drive, Plant, SixDof, State, ThreeDof};
use stillpoint_mechanics::shell::Shell;

use crate::reference::constrained::{Constraints, solve};

const STEP: f64 = 1e-3;
/// A friction that nothing overcomes.
const STUCK: f64 = 1e3;

pub(super) fn three() -> (ThreeDof, State<3, 3>) {
    at_rest(ThreeDof::rig(5.0), &[2, 3, 4], |plant| plant.start_air())
}

pub(super) fn eight() -> (SixDof, State<6, 8>) {
    at_rest(SixDof::rig(5.0), &[0, 1, 2, 3, 4, 5], |plant| plant.start_air())
}

fn at_rest<const D: usize, const B: usize, const N: usize>(
    plant: Plant<D, B, N>,
    channels: &[usize; D],
    air: impl Fn(&Plant<D, B, N>) -> SVector<f64, B>,
) -> (Plant<D, B, N>, State<D, B>) {
    let contacts = rolling(channels, 5.0, &Shell::rig()).unwrap();
    let plant = plant.with_rolling(contacts);
    let air = air(&plant);
    let rest = plant.equilibrium(&air, SVector::zeros()).unwrap();
    (plant, State::at_rest(rest, air))
}

pub(super) fn contacts<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
) -> &Rolling<D, B> {
    plant.rolling.as_ref().unwrap()
}

/// A step of plant and contacts. Returns the energy that sliding took, J.
pub(super) fn step<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    grip: &mut Grip<B>,
    state: &mut State<D, B>,
    drive: &Drive<D, B>,
    h: f64,
) -> f64 {
    let held = Some(grip.held(contacts(plant), &state.position));
    let next = plant.advance(state, &Drive { held, ..*drive }, h);
    let pressed = plant.bladders(&next.position, &next.air);
    let slid = grip.advance(contacts(plant), &state.position, &next.position, &pressed);
    *state = next;
    slid
}

fn grip<const B: usize>(friction: f64) -> Grip<B> {
    Grip::new(friction, &Shell::rig(), START_GAP)
}

/// Valves that swing, and a push that turns and shifts the head.
fn swing<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    time: f64,
    duty: f64,
    push: f64,
) -> Drive<D, B> {
    let mut drive = plant.idle();
    for (j, pair) in drive.duty.iter_mut().enumerate() {
        let swing = duty * libm::sin(time * (0.9 + 0.2 * j as f64));
        *pair = [swing.max(0.0), 1.9 * (-swing).max(0.0)];
    }
    let channels = contacts(plant).channels;
    drive.force = SVector::from_fn(|i, _| {
        let arm = if channels[i] < 3 { 1.0 } else { 0.04 };
        push * arm * libm::sin(time * (1.3 + 0.4 * i as f64))
    });
    drive
}

/// The reduced form (3.62) against the index-1 system of head and walls with its multipliers.
fn reduced_and_constrained<const D: usize, const B: usize, const N: usize, const Q: usize>(
    plant: &Plant<D, B, N>,
    state: &State<D, B>,
) -> (SVector<f64, D>, SVector<f64, D>) {
    let slope = plant.slope(&state.pack::<N>(), &plant.idle());
    let reduced = slope.fixed_rows::<D>(D).into_owned();
    let (contacts, met) = (contacts(plant), contacts(plant).met(&state.position));
    let head = contacts.head_terms(&plant.inertia, &state.position, &state.rate);
    let walls = contacts.walls();
    let mut mass = SMatrix::<f64, Q, Q>::zeros();
    mass.fixed_view_mut::<D, D>(0, 0).copy_from(&head.mass);
    mass.fixed_view_mut::<B, B>(D, D).copy_from(&walls.mass);
    let load = plant.weight + plant.stiffness * state.position + (plant.damping + head.velocity) * state.rate;
    let pressed = plant.bladders(&state.position, &state.air);
    let mut force = SVector::<f64, Q>::zeros();
    force.fixed_rows_mut::<D>(0).copy_from(&-load);
    force.fixed_rows_mut::<B>(D).copy_from(&SVector::<f64, B>::from_fn(|j, _| pressed[j].force()));
    // The height of each bladder is its gap.
    let mut jacobian = SMatrix::<f64, B, Q>::zeros();
    jacobian.fixed_view_mut::<B, D>(0, 0).copy_from(&met.slopes);
    jacobian.fixed_view_mut::<B, B>(0, D).copy_from(&-SMatrix::<f64, B, B>::identity());
    let mut rate = SVector::<f64, Q>::zeros();
    rate.fixed_rows_mut::<D>(0).copy_from(&state.rate);
    rate.fixed_rows_mut::<B>(D).copy_from(&(met.slopes * state.rate));
    let bias = contacts.carried(&met, &state.rate).map_rate * state.rate;
    let held = Constraints { value: SVector::zeros(), jacobian, bias, damping: [10.0, 10.0] };
    let solution = solve(&mass, &force, &rate, &held).unwrap();
    (reduced, solution.acceleration.fixed_rows::<D>(0).into_owned())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_plant_moves_as_head_and_walls_under_constraints(
        place in prop::array::uniform3(-8e-3..8e-3f64),
        turn in prop::array::uniform3(-0.15..0.15f64),
        speed in prop::array::uniform3(-0.1..0.1f64),
        spin in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let (plant, mut state) = eight();
        state.position += SVector::<f64, 6>::from_iterator(place.into_iter().chain(turn));
        state.rate = SVector::<f64, 6>::from_iterator(speed.into_iter().chain(spin));
        let (reduced, constrained) = reduced_and_constrained::<6, 8, 36, 14>(&plant, &state);
        prop_assert!((reduced - constrained).amax() < 1e-8 * reduced.amax().max(1.0), "{} {}", reduced, constrained);
        let (plant, mut state) = three();
        state.position += SVector::from([place[2], turn[0], turn[1]]);
        state.rate = SVector::from([speed[2], spin[0], spin[1]]);
        let (reduced, constrained) = reduced_and_constrained::<3, 3, 15, 6>(&plant, &state);
        prop_assert!((reduced - constrained).amax() < 1e-8 * reduced.amax().max(1.0), "{} {}", reduced, constrained);
    }

    /// Whatever the valves and a hand do, no contact pulls, and none leaves its friction cone.
    #[test]
    fn contacts_never_pull_and_never_leave_their_cones(
        duties in prop::collection::vec(prop::array::uniform2(0.0..1.0f64), 8),
        push in prop::array::uniform6(-1.0..1.0f64),
        friction in 0.0..1.5f64,
    ) {
        let (plant, mut state) = eight();
        let plant = plant.with_stop(FOAM);
        let mut grip = grip(friction);
        let mut drive = plant.idle();
        for (pair, duty) in drive.duty.iter_mut().zip(&duties) {
            *pair = *duty;
        }
        drive.force = SVector::from_fn(|i, _| push[i] * if i < 3 { 20.0 } else { 0.5 });
        for _ in 0..400 {
            let slid = step(&plant, &mut grip, &mut state, &drive, STEP);
            prop_assert!(slid >= -1e-15, "{}", slid);
            let pressed = plant.bladders(&state.position, &state.air);
            for (j, pressed) in pressed.iter().enumerate() {
                let margin = grip.margin(j, pressed);
                prop_assert!(margin.push >= 0.0);
                prop_assert!(margin.sliding >= -1e-12 && margin.spinning >= -1e-12, "{:?}", margin);
            }
            prop_assert!(state.position.iter().chain(&state.rate).all(|x| x.is_finite()));
        }
    }

    /// Where the contacts have hardly moved, both plants have the same forces, and these differ by how the normals turn.
    #[test]
    fn for_small_motions_the_plants_differ_by_the_turning_of_the_normals_alone(
        place in prop::array::uniform3(-2e-4..2e-4f64),
        turn in prop::array::uniform3(-2e-3..2e-3f64),
    ) {
        let (plant, start) = eight();
        let fixed = SixDof::rig(5.0);
        let q = SVector::<f64, 6>::from_iterator(place.into_iter().chain(turn));
        let pressed = plant.bladders(&start.position, &start.air);
        let met = contacts(&plant).met(&start.position);
        let turning: SMatrix<f64, 6, 6> =
            (0..8).map(|j| contacts(&plant).gap_bends(&met, j) * pressed[j].force()).sum();
        let (one, other) = (plant.static_force(&q, &start.air).0, fixed.static_force(&q, &start.air).0);
        let left = one - other - turning * q;
        // Second order: of 0.4 mm and 4 mrad.
        prop_assert!(left.fixed_rows::<3>(0).amax() < 0.05 && left.fixed_rows::<3>(3).amax() < 5e-3, "{}", left);
        prop_assert!((plant.gaps(&q) - fixed.gaps(&q)).amax() < 5e-6);
    }

    #[test]
    fn both_plants_begin_to_move_alike(
        duties in prop::collection::vec(-0.5..0.5f64, 8),
        push in prop::array::uniform6(0.2..1.0f64),
    ) {
        let (plant, start) = eight();
        let fixed = SixDof::rig(5.0);
        let mut drive = plant.idle();
        for (pair, duty) in drive.duty.iter_mut().zip(&duties) {
            *pair = [duty.max(0.0), (-duty).max(0.0)];
        }
        drive.force = SVector::from_fn(|i, _| push[i] * if i < 3 { 10.0 } else { 0.2 });
        let (mut one, mut other) = (start, start);
        for _ in 0..60 {
            one = plant.advance(&one, &drive, STEP);
            other = fixed.advance(&other, &drive, STEP);
        }
        let (moved, apart) = (other.position - start.position, one.position - other.position);
        for i in 0..2 {
            // Along and about: within a part of the largest motion. The walls that the head carries are 3 % of it.
            let [part, whole] = [apart, moved].map(|q| q.fixed_rows::<3>(3 * i).amax());
            prop_assert!(part < 0.12 * whole, "{}: {} of {}", i, part, whole);
        }
    }
}

#[test]
fn a_contact_that_sticks_does_not_slip() {
    let (plant, start) = eight();
    // The shear that a wall gets is the way of the head's surface along it: in steps ten times finer it is the same.
    let sheared = |h: f64| {
        let (mut state, mut grip) = (start, grip::<8>(STUCK));
        let steps = (3.0 / h).round() as u32;
        for k in 0..steps {
            let drive = swing(&plant, f64::from(k / (steps / 300)) * 0.01, 0.1, 10.0);
            assert!(step(&plant, &mut grip, &mut state, &drive, h).abs() < 1e-15);
            assert!((0..8).all(|j| grip.moved(j) == [false; 2]));
        }
        (core::array::from_fn::<_, 8, _>(|j| grip.strain(j)), state)
    };
    let ((coarse, _), (fine, state)) = (sheared(STEP), sheared(0.1 * STEP));
    let mut longest = 0.0_f64;
    for ((coarse, twist), (fine, same)) in coarse.iter().zip(&fine) {
        longest = longest.max(fine.norm());
        assert!(
            (coarse - fine).norm() < 2e-6 && (twist - same).abs() < 2e-5,
            "{coarse} {fine} {twist} {same}"
        );
    }
    assert!(longest > 5e-4, "{longest}: {}", state.position);
}

/// Slowly filled bladders: what the head does is what the forward map makes of the bladders' heights, shears and twists.
#[test]
fn the_head_moves_as_the_forward_map_of_its_bladders_rates_says() {
    let (plant, mut state) = eight();
    let mut grip = grip::<8>(STUCK);
    let mut drive = plant.idle();
    for (j, pair) in drive.duty.iter_mut().enumerate() {
        pair[0] = [0.1, 0.04, 0.0, 0.2, 0.0, 0.06, 0.1, 0.0][j];
    }
    let span = 20;
    let mut greatest = SVector::<f64, 6>::zeros();
    for _ in 0..100 {
        let (before, strain) = (state, core::array::from_fn::<_, 8, _>(|j| grip.strain(j)));
        for _ in 0..span {
            step(&plant, &mut grip, &mut state, &drive, STEP);
        }
        let seconds = f64::from(span) * STEP;
        // Measured at the bladders.
        let middle = contacts(&plant).met(&(0.5 * (before.position + state.position)));
        let heights = (plant.gaps(&state.position) - plant.gaps(&before.position)) / seconds;
        let bladders: [Vector4<f64>; 8] = core::array::from_fn(|j| {
            let ((sheared, twisted), (was, turned)) = (grip.strain(j), strain[j]);
            let [first, second] = across(&middle.meetings[j].normal);
            let shear = (sheared - was) / seconds;
            Vector4::new(first.dot(&shear), second.dot(&shear), heights[j], (twisted - turned) / seconds)
        });
        let maps: [SMatrix<f64, 6, 4>; 8] = core::array::from_fn(|j| contacts(&plant).map(&middle, j));
        let found = head_rate(&maps, &bladders).unwrap();
        let moved = (state.position - before.position) / seconds;
        greatest = greatest.sup(&moved.abs());
        let error = found - moved;
        // The mean over 20 ms against the contacts in its middle.
        assert!(error.amax() < 1e-7, "{found} {moved}");
        // And back.
        for (made, rate) in bladder_rates(&maps, &moved).iter().zip(&bladders) {
            assert!((made - rate).amax() < 1e-7, "{made} {rate}");
        }
    }
    assert!(
        greatest.fixed_rows::<3>(0).amax() > 2e-4 && greatest.fixed_rows::<3>(3).amax() > 2e-3,
        "{greatest}"
    );
}
