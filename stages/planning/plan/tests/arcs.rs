//! Arcs: slopes, limits, the course of the objective, and what of it depends on threads.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::num::NonZeroUsize;

use stillpoint_patient::case::{neck, phantom};
use stillpoint_plan::arc::{
    ArcBeam, ArcError, ArcField, ArcLimits, ArcOptions, ArcSpec, Bounds, Optimised, Tip, Trajectory,
    add_move, optimise, slope,
};
use stillpoint_plan::dose::{BixelSpec, Collimator, EngineName, FreeRange, Machine};
use stillpoint_plan::fluence::DoseChange;
use stillpoint_plan::recipe::{ArcPlanError, ArcProgress, PlanSetup, PointScheme, SetupSpec};

fn threads(number: usize) -> NonZeroUsize {
    NonZeroUsize::new(number).unwrap()
}

/// A pelvis on few points, with wide bixels.
fn setup(seed: u64) -> PlanSetup {
    let spec = SetupSpec {
        grid_mm: 10.0,
        bixel_mm: 20.0,
        points: PointScheme::Thinned,
        ..SetupSpec::shipped().unwrap()
    };
    PlanSetup::new(phantom(seed).unwrap(), spec).unwrap()
}

fn field(setup: &PlanSetup, arcs: &str, number: usize) -> ArcField {
    let arcs = ArcSpec::list(arcs).unwrap();
    ArcField::new(setup.engine(), &setup.goals, &Collimator::generic(), &arcs, threads(number)).unwrap()
}

fn bounds(field: &ArcField, limits: ArcLimits) -> Bounds {
    Bounds::new(field, &limits, &Collimator::generic(), 100.0 / 39.0).unwrap()
}

fn optimised(setup: &PlanSetup, field: &ArcField, limits: ArcLimits, number: usize) -> Optimised {
    let options = ArcOptions { rounds: 6, ..ArcOptions::default() };
    optimise(field, &setup.goals, &bounds(field, limits), options, threads(number), |_, _| ()).unwrap()
}

/// Prints the course of the arcs of `ARC_RUN` on the pelvis of seed 0; without it, nothing is planned.
#[test]
fn course_of_arcs() {
    let Ok(arcs) = std::env::var("ARC_RUN") else { return };
    let engine = std::env::var("ARC_ENGINE").map_or(EngineName::Pencil, |name| name.parse().unwrap());
    let began = std::time::Instant::now();
    let setup = PlanSetup::new(phantom(0).unwrap(), SetupSpec::shipped().unwrap()).unwrap();
    let setup = setup.by(engine).unwrap();
    println!("{} points, {:?}", setup.goals.voxels().len(), began.elapsed());
    let report = |progress: ArcProgress| println!("{progress:?} {:?}", began.elapsed());
    let arcs = ArcSpec::list(&arcs).unwrap();
    let found = setup.plan_arcs(&arcs, ArcOptions::default(), threads(1), report).unwrap();
    let limits = ArcLimits::generic();
    for beam in &found.beams {
        println!(
            "{}: {:.0} MU, {:.0} s, {:?}",
            beam.spec,
            beam.units(),
            beam.seconds(&limits),
            beam.field_mm
        );
    }
    println!("{:.1}, {:?}, {} points of the search", found.objective, found.spacing, found.points);
}

/// The pelvis of seed 0 and a partial arc, optimised.
fn partial() -> (PlanSetup, ArcField, Optimised) {
    let setup = setup(0);
    let field = field(&setup, ARC, 2);
    let found = optimised(&setup, &field, ArcLimits::generic(), 2);
    (setup, field, found)
}

const ARC: &str = "60..124cw,124..60cc";

#[test]
fn slopes_of_tips_are_those_of_small_moves_to_both_sides() {
    let (setup, field, found) = partial();
    let mut running = setup.goals.problem(&[]).unwrap().running(found.trajectory.dose(&field));
    assert!((running.cost() / found.objective - 1.0).abs() < 1e-9);
    let mut change = DoseChange::new(field.goal_rows());
    let (mut checked, mut largest) = (0, 0.0_f64);
    let mut off = Vec::new();
    for point in 0..field.points.len() {
        for row in 0..field.rows.len() {
            for (bank, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
                let tip = Tip { point, row, bank };
                let h = 1e-5;
                add_move(&field, &found.trajectory, tip, side * h, &mut change);
                let by_move = running.added(&change) / h;
                let [by_slope, curvature] =
                    slope(&field, &found.trajectory, &running, tip, side, &mut change);
                checked += usize::from(by_slope != 0.0);
                largest = largest.max(by_slope.abs());
                off.push((by_move - by_slope - 0.5 * h * curvature).abs());
            }
        }
    }
    let worst = off.into_iter().fold(0.0, f64::max);
    assert!(checked > 200 && worst < 1e-4 * largest, "{checked} {worst} {largest}");
}

/// The dose after a move is the dose of the leaves where they then are.
#[test]
fn a_move_changes_the_dose_by_what_the_dose_of_the_moved_leaves_is_other() {
    let (setup, field, found) = partial();
    let mut running = setup.goals.problem(&[]).unwrap().running(found.trajectory.dose(&field));
    let mut change = DoseChange::new(field.goal_rows());
    for (point, row, bank, by_mm) in [(3, 1, 0, -13.7), (7, 0, 1, 8.0), (0, 2, 0, 3.3), (16, 1, 1, -0.4)] {
        let mut moved = found.trajectory.clone();
        moved.tips_mm[point][row][bank] += by_mm;
        add_move(&field, &found.trajectory, Tip { point, row, bank }, by_mm, &mut change);
        let added = running.added(&change);
        let mut one = running.clone();
        one.make(&change, added);
        let expected = moved.dose(&field);
        let off = one.dose().iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "{point} {row} {bank}: {off}");
        running = setup.goals.problem(&[]).unwrap().running(found.trajectory.dose(&field));
    }
}

#[test]
fn the_objective_never_rises_and_falls_far_from_the_start() {
    let (_, _, found) = partial();
    assert!(found.objectives.windows(2).all(|pair| pair[1] <= pair[0]), "{:?}", found.objectives);
    let last = *found.objectives.last().unwrap();
    assert!(last < 0.8 * found.objectives[0] && found.objective < 1.001 * last, "{:?}", found.objectives);
}

#[test]
fn limits_hold_in_the_decimals_of_a_file() {
    let setup = setup(1);
    let field = field(&setup, "350..43.7cw", 2);
    let limits = ArcLimits {
        leaf_mm_per_deg: 2.0,
        // Leaves may need more time than the gantry.
        leaf_mm_per_s: 9.0,
        least_gap_mm: 3.0,
        least_gantry_deg_per_s: 2.0,
        least_mu_per_min: 30.0,
        ..ArcLimits::generic()
    };
    let found = optimised(&setup, &field, limits, 2);
    // As a file writes them: at most 16 characters.
    let written = |number: f64| {
        let text = format!("{number}");
        assert!(text.len() <= 16, "{text}");
        text.parse::<f64>().unwrap()
    };
    let point = |tips: &Vec<[f64; 2]>| tips.iter().map(|tips| tips.map(written)).collect();
    let read = Trajectory {
        tips_mm: found.trajectory.tips_mm.iter().map(point).collect(),
        weights: found.trajectory.weights.clone(),
    };
    assert_eq!(read.fault(&field, &bounds(&field, limits)), None);
    let mu_per_weight = 100.0 / 39.0;
    for stretch in read.stretches(&field, mu_per_weight) {
        assert!(stretch.travel_mm <= 2.0 * stretch.degrees + 1e-6);
        let seconds = limits.seconds(&stretch);
        assert!(stretch.degrees / seconds >= 2.0 - 1e-6, "{stretch:?}");
        assert!(60.0 * stretch.units / seconds <= 600.0 + 1e-6 && stretch.travel_mm / seconds <= 9.0 + 1e-6);
        assert!(60.0 * stretch.units / seconds >= 30.0 * (1.0 - 1e-6), "{stretch:?}");
    }
    let gaps = read.tips_mm.iter().flatten().map(|[low, high]| high - low);
    assert!(gaps.fold(f64::INFINITY, f64::min) >= 3.0 - 1e-6);
    // Of all pairs, those too that have no part in the arc.
    let arcs = ArcSpec::list("350..43.7cw").unwrap();
    let collimator = Collimator::generic();
    let gap_mm = limits.whole_gap_mm();
    let beams = ArcBeam::all(&field, &read, &collimator, &arcs, mu_per_weight, gap_mm);
    assert_eq!(beams[0].fault(&limits, &collimator), None);
    let pairs = beams[0].points.iter().flat_map(|point| &point.tips_mm);
    assert_eq!(pairs.clone().count(), 80 * field.points.len());
    assert!(pairs.clone().all(|[low, high]| high - low >= 3.0 - 1e-6));
    // Behind the jaw, they open nothing.
    let parked = beams[0].points[0].tips_mm[0];
    assert!(parked[1] <= beams[0].field_mm[0][0], "{parked:?}");
    let slow = ArcLimits { leaf_mm_per_deg: 0.1, ..limits };
    assert!(beams[0].fault(&slow, &collimator).unwrap().contains("a leaf travels"));
    // The limits cost something: without them the objective is lower.
    let free = optimised(&setup, &field, ArcLimits::generic(), 2);
    assert!(free.objective < found.objective, "{} {}", free.objective, found.objective);
}

#[test]
fn any_number_of_threads_gives_the_same_bytes_and_so_does_a_second_run() {
    let setup = setup(0);
    let made = |number: usize| optimised(&setup, &field(&setup, ARC, number), ArcLimits::generic(), number);
    let alone = made(1);
    for number in [1, 2, 4] {
        assert_eq!(made(number), alone, "{number} threads");
    }
}

/// A neck, whose edge is near the target from every side.
fn neck_setup(inside_mm: f64) -> PlanSetup {
    let spec = SetupSpec {
        grid_mm: 12.0,
        bixel_mm: 10.0,
        points: PointScheme::Thinned,
        inside_mm,
        ..SetupSpec::shipped().unwrap()
    };
    PlanSetup::new(neck(0).unwrap(), spec).unwrap()
}

#[test]
fn leaves_open_nothing_that_is_not_lit_at_the_angle() {
    const INSIDE_MM: f64 = 8.0;
    let setup = neck_setup(INSIDE_MM);
    let arcs = "20..116cw";
    let field = field(&setup, arcs, 2);
    let options = ArcOptions { rounds: 2, ..ArcOptions::default() };
    let bounds = bounds(&field, ArcLimits::generic());
    let found = optimise(&field, &setup.goals, &bounds, options, threads(2), |_, _| ()).unwrap();
    let engine = setup.engine();
    let fine = engine.with_bixels(BixelSpec { width_mm: field.width_mm, ..engine.params().bixels });
    let half = 0.5 * field.width_mm;
    let (mut opened, mut narrower) = (0, 0);
    for (number, interval) in field.intervals.iter().enumerate() {
        for (part, doses) in interval.doses.iter().enumerate() {
            let lit = fine.bixels_mm(field.doses[*doses].gantry_deg).unwrap();
            for (row, leaves) in field.rows.iter().enumerate() {
                let [low, high] = found.trajectory.tips_at(interval, part, row);
                let cells = lit.iter().filter(|[_, z]| leaves.is_over(*z, field.width_mm));
                let from = cells.clone().map(|[x, _]| x - half).fold(f64::INFINITY, f64::min);
                let to = cells.map(|[x, _]| x + half).fold(f64::NEG_INFINITY, f64::max);
                let ends = field.ends_mm(row);
                narrower += usize::from(from > ends[0] + 1e-6 || to < ends[1] - 1e-6);
                if high - low > 1e-6 {
                    opened += 1;
                    assert!(
                        low >= from - 1e-6 && high <= to + 1e-6,
                        "interval {number}, row {row}: {low} to {high} mm, lit {from} to {to} mm"
                    );
                }
            }
        }
    }
    // There are such angles.
    assert!(opened > 100 && narrower > 100, "{opened} {narrower}");
}

#[test]
fn what_leaves_do_not_reach_across_the_axis_is_refused() {
    let setup = setup(0);
    let field = field(&setup, "60..84cw", 2);
    let short = Collimator { reach_mm: 30.0, over_travel_mm: 10.0, ..Collimator::generic() };
    let error = Bounds::new(&field, &ArcLimits::generic(), &short, 1.0).unwrap_err();
    assert!(matches!(error, ArcError::Aside { .. }) && error.to_string().contains("withdrawn to 30 mm"));
}

#[test]
fn arcs_that_leaves_cannot_shape_are_refused_before_any_dose() {
    let mut file = Machine::shipped().unwrap().file().clone();
    let mut refused = |collimator: Collimator| {
        file.collimator = Some(collimator);
        let machine = Machine::new(file.clone()).unwrap();
        let spec = SetupSpec { grid_mm: 10.0, bixel_mm: 20.0, machine, ..SetupSpec::shipped().unwrap() };
        let setup = PlanSetup::new(phantom(0).unwrap(), spec).unwrap();
        let report = |progress: ArcProgress| panic!("{progress:?} although no dose is needed");
        let arcs = ArcSpec::list("60..84cw").unwrap();
        setup.plan_arcs(&arcs, ArcOptions::default(), threads(2), report).unwrap_err()
    };
    let low = Collimator { leaf_edges_mm: vec![-20.0, -10.0, 0.0, 10.0, 20.0], ..Collimator::generic() };
    assert!(matches!(refused(low), ArcPlanError::Arc(ArcError::Beyond { first_mm: -20.0, .. })));
    let short = Collimator { reach_mm: 30.0, over_travel_mm: 10.0, ..Collimator::generic() };
    assert!(matches!(refused(short), ArcPlanError::Arc(ArcError::Aside { reach_mm: 30.0, .. })));
}

/// Leaves so slow that apertures of one pricing restrict each other, and windows move faster than they.
#[test]
fn slow_leaves_give_an_arc_that_keeps_its_limits() {
    let setup = neck_setup(0.0);
    let field = field(&setup, "20..180cw", 2);
    let limits = ArcLimits { leaf_mm_per_deg: 0.2, least_gap_mm: 1.0, ..ArcLimits::generic() };
    let bounds = bounds(&field, limits);
    let options = ArcOptions { rounds: 1, ..ArcOptions::default() };
    let found = optimise(&field, &setup.goals, &bounds, options, threads(2), |_, _| ()).unwrap();
    assert_eq!(found.trajectory.fault(&field, &bounds), None);
}

/// Bixels whose edges are no whole micrometres.
#[test]
fn odd_bixels_give_an_arc_that_keeps_its_limits() {
    for bixel_mm in [6.25, 10.0 / 3.0] {
        let spec = SetupSpec {
            grid_mm: 16.0,
            bixel_mm,
            points: PointScheme::Thinned,
            ..SetupSpec::shipped().unwrap()
        };
        let setup = PlanSetup::new(phantom(0).unwrap(), spec).unwrap();
        let field = field(&setup, "84..92cw", 2);
        let found = optimised(&setup, &field, ArcLimits::generic(), 2);
        assert!(found.objective < found.objectives[0]);
    }
}

#[test]
fn angles_that_are_not_free_are_refused() {
    let mut file = SetupSpec::shipped().unwrap().machine.file().clone();
    file.free_angles = Some(vec![FreeRange { couch_deg: [-5.0, 5.0], gantry_deg: [300.0, 60.0] }]);
    let spec = SetupSpec {
        grid_mm: 16.0,
        bixel_mm: 20.0,
        points: PointScheme::Thinned,
        machine: Machine::new(file).unwrap(),
        ..SetupSpec::shipped().unwrap()
    };
    let setup = PlanSetup::new(phantom(0).unwrap(), spec).unwrap();
    let arcs = ArcSpec::list("340..20cw,20..70cw").unwrap();
    let error = setup.plan_arcs(&arcs, ArcOptions::default(), threads(1), |_| ()).unwrap_err();
    let ArcPlanError::Blocked { arc, gantry_deg } = error else { panic!("{error}") };
    assert!(arc == arcs[1] && gantry_deg > 60.0 && gantry_deg < 65.0, "{gantry_deg}");
}
