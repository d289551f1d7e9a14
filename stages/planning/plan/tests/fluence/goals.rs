//! Objectives against their formulas, written down once more.

use proptest::prelude::*;
use stillpoint_plan::fluence::{
    Bound, DvhAtLeast, DvhAtMost, FallOff, Geud, Goals, GoalsError, Homogeneity, MeanAtLeast, MeanDose,
    Modulation, Objective, Options, Overdose, Plan, StructureObjectives, Underdose, solve_plan,
};
use stillpoint_plan::{Csc, Rows, Setups};

const VOXELS: usize = 12;

/// A matrix of random entries; voxel 11 is in no structure.
fn matrix(values: &[f32]) -> Csc {
    let columns = values.len() / VOXELS;
    let starts = (0..=columns).map(|j| (j * VOXELS) as u64).collect();
    let row = (0..columns).flat_map(|_| 0..VOXELS as u32).collect();
    Csc::new(VOXELS, starts, row, values[..columns * VOXELS].to_vec()).unwrap()
}

fn solve(requested: &[StructureObjectives], matrix: &Csc) -> (Plan, Vec<f64>) {
    let goals = Goals::new(requested.to_vec(), VOXELS).unwrap();
    let rows = Rows::from_columns(matrix.view()).unwrap();
    let problem = goals.problem(&[rows.view().into()]).unwrap();
    let plan = solve_plan(&problem, None, Options::default()).unwrap();
    let dose = dose(matrix, &plan.weights);
    for (row, voxel) in goals.voxels().iter().enumerate() {
        assert!((plan.dose[row] - dose[*voxel as usize]).abs() < 1e-9 * (1.0 + dose[*voxel as usize]));
    }
    if requested.iter().all(|structure| structure.volumes.is_empty()) {
        let (reported, expected) = (goals.cost(&dose).unwrap(), cost(requested, &dose));
        assert!((reported - expected).abs() < 1e-9 * (1.0 + expected), "{reported} {expected}");
    }
    assert!(goals.cost(&dose[1..]).is_err());
    let (value, expected) = (problem.value(&plan.weights).unwrap().cost, goals.cost(&dose).unwrap());
    assert!((value - expected).abs() < 1e-5 * (1.0 + expected), "{value} {expected}");
    (plan, dose)
}

fn dose(matrix: &Csc, weights: &[f64]) -> Vec<f64> {
    let mut dose = vec![0.0; VOXELS];
    for (j, weight) in weights.iter().enumerate() {
        let (rows, values) = matrix.view().column(j);
        for (row, value) in rows.iter().zip(values) {
            dose[*row as usize] += f64::from(*value) * weight;
        }
    }
    dose
}

/// What the objectives cost, from their formulas.
pub fn cost(requested: &[StructureObjectives], dose: &[f64]) -> f64 {
    let square = |x: f64| x.max(0.0).powi(2);
    let mut cost = 0.0;
    for structure in requested {
        let by_place: Vec<f64> = structure.voxels.iter().map(|v| dose[*v as usize]).collect();
        let mut d = by_place.clone();
        d.sort_by(f64::total_cmp);
        let v = d.len() as f64;
        let mean = d.iter().sum::<f64>() / v;
        let sum = |f: &dyn Fn(f64) -> f64| d.iter().map(|d| f(*d)).sum::<f64>() / v;
        for objective in &structure.objectives {
            cost += match *objective {
                Objective::Overdose(Overdose { dose, weight }) => weight * sum(&|d| square(d - dose)),
                Objective::FallOff(FallOff { near, far, over_mm, weight }) => {
                    let r = &structure.to_target_mm;
                    let v = r.iter().filter(|r| **r <= over_mm).count() as f64;
                    let goal = |r: f64| if r < over_mm { near - (near - far) * r / over_mm } else { far };
                    let costs = by_place.iter().zip(r).map(|(d, r)| square(d - goal(*r)));
                    weight / v * costs.sum::<f64>()
                }
                Objective::Underdose(Underdose { dose, weight }) => weight * sum(&|d| square(dose - d)),
                Objective::MeanDose(MeanDose { dose, weight }) => weight * square(mean - dose),
                Objective::Homogeneity(Homogeneity { weight }) => weight * sum(&|d| (d - mean).powi(2)),
                Objective::DvhAtMost(DvhAtMost { dose, volume, weight }) => {
                    let free = (volume * v) as usize;
                    d[..d.len() - free].iter().map(|d| weight / v * square(d - dose)).sum()
                }
                Objective::DvhAtLeast(DvhAtLeast { dose, volume, weight }) => {
                    let costing = (volume * v).ceil() as usize;
                    d[d.len() - costing..].iter().map(|d| weight / v * square(dose - d)).sum()
                }
                Objective::MeanAtLeast(MeanAtLeast { dose, weight }) => weight * square(dose - mean),
                Objective::Geud(Geud { a, bound: Bound::AtMost, dose, weight }) => {
                    weight * square((d.iter().map(|d| d.powf(a)).sum::<f64>() / v).powf(1.0 / a) - dose)
                }
                Objective::Geud(Geud { a, bound: Bound::AtLeast, dose, weight }) => {
                    let raised = |d: &f64| (d + 0.01 * dose).powf(a);
                    let mean = (d.iter().map(raised).sum::<f64>() / v).powf(1.0 / a);
                    weight * square(dose - (mean - 0.01 * dose))
                }
                Objective::DvhPoint(_) => unreachable!("no structure here has one"),
            };
        }
    }
    cost
}

fn requested(objectives: [Vec<Objective>; 2]) -> Vec<StructureObjectives> {
    let [target, organ] = objectives;
    vec![
        StructureObjectives {
            name: "target".into(),
            voxels: vec![0, 1, 2, 3, 4, 5],
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives: target,
        },
        StructureObjectives {
            name: "organ".into(),
            voxels: vec![4, 5, 6, 7, 8, 9, 10],
            volumes: Vec::new(),
            to_target_mm: vec![0.0, 0.5, 3.0, 6.0, 8.0, 10.0, 40.0],
            objectives: organ,
        },
    ]
}

/// Every shape on one set of weights, away from the places where doses are equal.
#[test]
fn the_slope_of_the_objective_is_its_difference_quotient() {
    let values: Vec<f32> = (0..5 * VOXELS).map(|i| 0.2 + ((i * 37) % 59) as f32 / 59.0).collect();
    let matrix = matrix(&values);
    let organ = vec![
        Overdose { dose: 20.0, weight: 1.5 }.into(),
        FallOff { near: 50.0, far: 10.0, over_mm: 9.0, weight: 3.0 }.into(),
        MeanDose { dose: 12.0, weight: 2.0 }.into(),
        DvhAtMost { dose: 25.0, volume: 0.4, weight: 4.0 }.into(),
        Geud { a: 6.0, bound: Bound::AtMost, dose: 18.0, weight: 0.5 }.into(),
    ];
    let target = vec![
        Underdose { dose: 60.0, weight: 2.0 }.into(),
        Homogeneity { weight: 3.0 }.into(),
        DvhAtLeast { dose: 58.0, volume: 0.8, weight: 2.0 }.into(),
        MeanAtLeast { dose: 61.0, weight: 1.0 }.into(),
    ];
    let goals = Goals::new(requested([target, organ]), VOXELS).unwrap();
    let rows = Rows::from_columns(matrix.view()).unwrap();
    let problem = goals.problem(&[rows.view().into()]).unwrap();
    assert_eq!(problem.bixels(), 5);
    let weights = [11.0, 7.0, 19.0, 3.0, 13.0];
    let found = problem.value(&weights).unwrap();
    for (bixel, slope) in found.slope.iter().enumerate() {
        let at = |step: f64| {
            let mut moved = weights;
            moved[bixel] += step;
            problem.value(&moved).unwrap().cost
        };
        let quotient = (at(1e-4) - at(-1e-4)) / 2e-4;
        assert!((slope - quotient).abs() < 1e-5 * (1.0 + slope.abs()), "{bixel}: {slope} {quotient}");
    }
    assert!(problem.value(&weights[1..]).is_err());
}

fn prescribed() -> Vec<Objective> {
    vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: 2.0 }),
        Objective::Overdose(Overdose { dose: 60.0, weight: 1.0 }),
    ]
}

fn values() -> impl Strategy<Value = Vec<f32>> {
    prop::collection::vec((50..1000).prop_map(|thousandths| thousandths as f32 * 1e-3), VOXELS * 5)
}

proptest! {
    #[test]
    fn convex_objectives_cost_what_their_formulas_say_and_no_neighbour_costs_less(values in values()) {
        let matrix = matrix(&values);
        let organ = vec![
            Objective::MeanDose(MeanDose { dose: 20.0, weight: 3.0 }),
            Objective::Overdose(Overdose { dose: 30.0, weight: 1.0 }),
            Objective::FallOff(FallOff { near: 50.0, far: 15.0, over_mm: 8.0, weight: 2.0 }),
        ];
        let requested = requested([[prescribed(), vec![Objective::Homogeneity(Homogeneity { weight: 4.0 })]].concat(), organ]);
        let (plan, found) = solve(&requested, &matrix);
        let best = cost(&requested, &found);
        prop_assert!((plan.certificate.objective - best).abs() < 1e-5 * best + 1e-6, "{} {best}", plan.certificate.objective);
        prop_assert!(plan.certificate.relative_excess() < 1e-4, "{:?}", plan.certificate);
        for j in 0..plan.weights.len() {
            for step in [-0.3, 0.3] {
                let mut weights = plan.weights.clone();
                weights[j] = (weights[j] + step).max(0.0);
                prop_assert!(cost(&requested, &dose(&matrix, &weights)) >= best * (1.0 - 1e-6));
            }
        }
    }

    #[test]
    fn pull_is_the_slope_of_the_cost_in_the_dose_of_each_voxel(values in values()) {
        let matrix = matrix(&values);
        let organ = vec![Objective::MeanDose(MeanDose { dose: 20.0, weight: 3.0 })];
        let requested = requested([[prescribed(), vec![Objective::Homogeneity(Homogeneity { weight: 4.0 })]].concat(), organ]);
        let (plan, found) = solve(&requested, &matrix);
        for voxel in 0..11 {
            let at = |by: f64| {
                let mut dose = found.clone();
                dose[voxel] += by;
                cost(&requested, &dose)
            };
            let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
            prop_assert!((plan.pull[voxel] - slope).abs() < 1e-2 * (1.0 + slope.abs()), "{} {slope}", plan.pull[voxel]);
        }
    }

    #[test]
    fn dvh_points_cost_what_their_formulas_say_and_never_more_than_before_them(values in values()) {
        let matrix = matrix(&values);
        let plain = requested([prescribed(), vec![]]);
        let target = [prescribed(), vec![Objective::DvhAtLeast(DvhAtLeast { dose: 57.0, volume: 0.8, weight: 50.0 })]].concat();
        let organ = vec![Objective::DvhAtMost(DvhAtMost { dose: 25.0, volume: 0.3, weight: 30.0 })];
        let with = requested([target, organ]);
        let (_, before) = solve(&plain, &matrix);
        let (plan, found) = solve(&with, &matrix);
        let (before, after) = (cost(&with, &before), cost(&with, &found));
        prop_assert!(after <= before * (1.0 + 1e-9), "{after} {before}");
        prop_assert!(after <= plan.certificate.objective * (1.0 + 1e-9));
        prop_assert!(plan.rounds >= 2);
    }
}

#[test]
fn a_dvh_point_lets_the_hottest_part_go() {
    // Two voxels a bixel each: the organ may keep half its volume hot, so one bixel stays at full dose.
    let matrix = Csc::new(2, vec![0, 1, 2], vec![0, 1], vec![1.0, 1.0]).unwrap();
    let both = vec![StructureObjectives {
        name: "both".into(),
        voxels: vec![0, 1],
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives: vec![
            Objective::Underdose(Underdose { dose: 60.0, weight: 1.0 }),
            Objective::DvhAtMost(DvhAtMost { dose: 10.0, volume: 0.5, weight: 1000.0 }),
        ],
    }];
    let goals = Goals::new(both, 2).unwrap();
    let rows = Rows::from_columns(matrix.view()).unwrap();
    let plan = solve_plan(&goals.problem(&[rows.view().into()]).unwrap(), None, Options::default()).unwrap();
    let mut dose = plan.dose;
    dose.sort_by(f64::total_cmp);
    assert!(dose[0] < 10.1 && (dose[1] - 60.0).abs() < 1e-6, "{dose:?}");
}

#[test]
fn a_voxel_of_twice_the_volume_counts_as_two() {
    // Three voxels and three bixels; of the two plans one has the last voxel twice, the other with twice its volume.
    let matrix = |rows: Vec<u32>, starts, values| {
        Rows::from_columns(Csc::new(4, starts, rows, values).unwrap().view()).unwrap()
    };
    let once = matrix(vec![0, 1, 1, 2, 2], vec![0, 2, 4, 5], vec![1.0, 0.3, 1.0, 0.4, 1.0]);
    let twice = matrix(vec![0, 1, 1, 2, 3, 2, 3], vec![0, 2, 5, 7], vec![1.0, 0.3, 1.0, 0.4, 0.4, 1.0, 1.0]);
    let objectives = vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: 3.0 }),
        Objective::MeanDose(MeanDose { dose: 20.0, weight: 2.0 }),
        Objective::Homogeneity(Homogeneity { weight: 0.5 }),
        Objective::DvhAtMost(DvhAtMost { dose: 30.0, volume: 0.5, weight: 4.0 }),
    ];
    let solve = |rows: &Rows, voxels: Vec<u32>, volumes: Vec<f64>| {
        let requested = StructureObjectives {
            name: "all".into(),
            voxels,
            volumes,
            to_target_mm: Vec::new(),
            objectives: objectives.clone(),
        };
        let goals = Goals::new(vec![requested], 4).unwrap();
        solve_plan(&goals.problem(&[rows.view().into()]).unwrap(), None, Options::default()).unwrap()
    };
    let (one, other) =
        (solve(&once, vec![0, 1, 2], vec![1.0, 1.0, 2.0]), solve(&twice, vec![0, 1, 2, 3], vec![]));
    let [a, b] = [&one, &other].map(|plan| plan.certificate.objective);
    assert!((a - b).abs() < 1e-6 * b, "{a} {b}");
    assert!(one.weights.iter().zip(&other.weights).all(|(a, b)| (a - b).abs() < 1e-4), "{one:?} {other:?}");
}

#[test]
fn wishes_that_cannot_be_used_are_refused_by_name() {
    let one = |voxels: Vec<u32>, objective| {
        let requested = StructureObjectives {
            name: "rectum".into(),
            voxels,
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives: vec![objective],
        };
        Goals::new(vec![requested], 3).err()
    };
    let fine = Objective::Overdose(Overdose { dose: 1.0, weight: 1.0 });
    assert_eq!(one(vec![0, 2], fine), None);
    for volumes in [vec![1.0], vec![1.0, 0.0], vec![1.0, f64::NAN]] {
        let requested = StructureObjectives {
            name: "rectum".into(),
            voxels: vec![0, 2],
            volumes,
            to_target_mm: Vec::new(),
            objectives: vec![fine],
        };
        let fault = Goals::new(vec![requested], 3).err();
        assert!(matches!(fault, Some(GoalsError::Volumes { voxels: 2, .. })), "{fault:?}");
    }
    let fall_off = Objective::FallOff(FallOff { near: 9.0, far: 3.0, over_mm: 20.0, weight: 1.0 });
    assert!(matches!(one(vec![0, 2], fall_off), Some(GoalsError::Distances { voxels: 2, distances: 0, .. })));
    for (far, over_mm) in [(-1.0, 20.0), (10.0, 20.0), (f64::NAN, 20.0), (3.0, 0.0), (3.0, f64::INFINITY)] {
        let fault = one(vec![0, 2], Objective::FallOff(FallOff { near: 9.0, far, over_mm, weight: 1.0 }));
        assert!(matches!(fault, Some(GoalsError::Number { .. })), "{far} {over_mm}: {fault:?}");
    }
    assert_eq!(one(vec![], fine), Some(GoalsError::Empty { name: "rectum".into() }));
    assert!(matches!(one(vec![2, 1], fine), Some(GoalsError::Voxel { at: 1, .. })));
    assert!(matches!(one(vec![3], fine), Some(GoalsError::Voxel { at: 0, voxels: 3, .. })));
    let nan = Objective::MeanDose(MeanDose { dose: f64::NAN, weight: 1.0 });
    assert!(matches!(one(vec![0], nan), Some(GoalsError::Number { what: "a dose", .. })));
    let volume = Objective::DvhAtMost(DvhAtMost { dose: 1.0, volume: 30.0, weight: 1.0 });
    assert!(matches!(one(vec![0], volume), Some(GoalsError::Number { what: "a volume", .. })));
    let weight = Objective::Homogeneity(Homogeneity { weight: -1.0 });
    assert!(matches!(one(vec![0], weight), Some(GoalsError::Number { what: "a weight", .. })));
    let goals = Goals::new(vec![], 3).unwrap();
    let other = Csc::new(4, vec![0], vec![], vec![]).unwrap();
    let other = Rows::from_columns(other.view()).unwrap();
    assert_eq!(goals.problem(&[other.view().into()]).err(), Some(GoalsError::Grid { found: 4, expected: 3 }));
}

/// So many bixels that the solve begins with a part of the voxels: it ends where a solve from other weights does.
#[test]
fn a_rough_start_ends_at_the_same_plan() {
    const BIXELS: usize = 3000;
    const EACH: usize = 64;
    let voxels = 16 * BIXELS;
    let (mut row, mut value) = (Vec::new(), Vec::new());
    for bixel in 0..BIXELS {
        let first = (bixel * 16).min(voxels - EACH);
        row.extend((first..first + EACH).map(|voxel| voxel as u32));
        value.extend((0..EACH).map(|k| 0.5 + ((bixel * 7 + k * 13) % 23) as f32 / 23.0));
    }
    let starts = (0..=BIXELS).map(|bixel| (bixel * EACH) as u64).collect();
    let matrix = Csc::new(voxels, starts, row, value).unwrap();
    let objectives = vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: 100.0 }),
        Objective::Overdose(Overdose { dose: 58.0, weight: 40.0 }),
    ];
    let requested = StructureObjectives {
        name: "target".into(),
        voxels: (0..voxels as u32).collect(),
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives,
    };
    let goals = Goals::new(vec![requested], voxels).unwrap();
    let rows = Rows::from_columns(matrix.view()).unwrap();
    let problem = goals.problem(&[rows.view().into()]).unwrap();
    let options = Options { tolerance: 1e-8, ..Options::default() };
    let rough = solve_plan(&problem, None, options).unwrap();
    let plain = solve_plan(&problem, Some(&vec![1.0; BIXELS]), options).unwrap();
    let [a, b] = [&rough, &plain].map(|plan| plan.certificate);
    assert!(a.relative_excess() < 1e-8 && b.relative_excess() < 1e-8, "{a:?} {b:?}");
    assert!((a.objective - b.objective).abs() <= 1e-7 * b.objective, "{a:?} {b:?}");
    assert_ne!(rough.steps, plain.steps, "both began alike");
}

/// Two rows of three bixels of 10 mm.
const PLACES: [[f64; 2]; 6] = [[0.0, 0.0], [0.0, 10.0], [10.0, 0.0], [10.0, 10.0], [20.0, 0.0], [20.0, 10.0]];
const PAIRS: [[usize; 2]; 7] = [[0, 1], [2, 3], [4, 5], [0, 2], [2, 4], [1, 3], [3, 5]];

/// What uneven weights cost, written down once more.
fn unevenness(modulation: Modulation, weights: &[f64]) -> f64 {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    let steps: f64 = PAIRS.iter().map(|[i, j]| (weights[*i] - weights[*j]).powi(2)).sum();
    let peaks: f64 = weights.iter().map(|w| (w - modulation.times_mean * mean).max(0.0).powi(2)).sum();
    (modulation.neighbours * steps + modulation.peaks * peaks) / weights.len() as f64
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn uneven_fluence_costs_by_its_formula_and_the_optimum_is_proved(
        values in prop::collection::vec(0.0_f32..2.0, 6 * VOXELS),
        other in prop::collection::vec(0.0..60.0, 6),
        neighbours in 0.01..10.0, peaks in 0.1..100.0, times_mean in 1.0..5.0,
    ) {
        let modulation = Modulation { neighbours, peaks, times_mean };
        let requested = requested([
            vec![Underdose { dose: 60.0, weight: 10.0 }.into(), Overdose { dose: 62.0, weight: 10.0 }.into()],
            vec![Overdose { dose: 15.0, weight: 2.0 }.into()],
        ]);
        let matrix = matrix(&values);
        let rows = Rows::from_columns(matrix.view()).unwrap();
        let goals = Goals::new(requested.clone(), VOXELS).unwrap().modulated(Some(modulation)).unwrap();
        let problem = goals.problem(&[Setups::from(rows.view()).placed(&PLACES)]).unwrap();
        let plan = solve_plan(&problem, None, Options::default()).unwrap();
        let objective = |weights: &[f64]| cost(&requested, &dose(&matrix, weights)) + unevenness(modulation, weights);
        let ours = objective(&plan.weights);
        // The rows of means are rounded to 24 bits.
        prop_assert!((plan.certificate.objective - ours).abs() <= 1e-5 * (1.0 + ours), "{ours} {:?}", plan.certificate);
        prop_assert!(plan.certificate.relative_excess() <= 1e-6, "{:?}", plan.certificate);
        prop_assert!(plan.certificate.kkt < 1e-5, "{:?}", plan.certificate);
        let of_doses = goals.cost_of(&plan).unwrap();
        prop_assert!((of_doses - cost(&requested, &dose(&matrix, &plan.weights))).abs() < 1e-9 * (1.0 + of_doses));
        // No other weights are better than the certificate allows, near or far.
        let bound = plan.certificate.excess + 1e-5 * (1.0 + ours);
        prop_assert!(objective(&other) >= ours - bound);
        for j in 0..6 {
            for step in [-0.1, 0.1] {
                let mut near = plan.weights.clone();
                near[j] = (near[j] + step * (1.0 + near[j])).max(0.0);
                prop_assert!(objective(&near) >= ours - bound, "{j} {step}");
            }
        }
    }
}

/// A bixel that gives the target next to nothing may carry any weight where only doses cost.
#[test]
fn a_bixel_that_gives_little_does_not_carry_the_beam() {
    let mut values = vec![0.0_f32; 6 * VOXELS];
    for (column, voxel) in [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)] {
        values[column * VOXELS + voxel] = 1.0;
    }
    // The last voxel of the target gets dose of the last bixel alone, a hundredth of that of the others.
    values[5 * VOXELS + 5] = 0.01;
    let requested = requested([
        vec![Underdose { dose: 60.0, weight: 10.0 }.into(), Overdose { dose: 62.0, weight: 10.0 }.into()],
        vec![],
    ]);
    let matrix = matrix(&values);
    let rows = Rows::from_columns(matrix.view()).unwrap();
    let heaviest = |modulation: Option<Modulation>| {
        let goals = Goals::new(requested.clone(), VOXELS).unwrap().modulated(modulation).unwrap();
        let problem = goals.problem(&[Setups::from(rows.view()).placed(&PLACES)]).unwrap();
        let plan = solve_plan(&problem, None, Options::default()).unwrap();
        plan.weights.iter().fold(0.0, |a, b| f64::max(a, *b))
    };
    let shipped = stillpoint_plan::objectives::ObjectiveTable::shipped().unwrap().modulation;
    assert!(heaviest(None) > 5000.0, "a hundred medians");
    assert!(shipped.is_some() && heaviest(shipped) < 600.0, "{}", heaviest(shipped));
}

#[test]
fn a_modulation_that_cannot_be_is_refused() {
    let goals = || Goals::new(vec![], 3).unwrap();
    let good = Modulation { neighbours: 1.0, peaks: 1.0, times_mean: 4.0 };
    assert!(goals().modulated(Some(good)).is_ok());
    for bad in [
        Modulation { neighbours: -1.0, ..good },
        Modulation { peaks: f64::NAN, ..good },
        Modulation { times_mean: 0.5, ..good },
    ] {
        assert!(matches!(goals().modulated(Some(bad)), Err(GoalsError::Number { .. })), "{bad:?}");
    }
}
