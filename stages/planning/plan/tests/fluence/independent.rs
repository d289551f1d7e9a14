//! Random problems, solved beside another solver: no point that it finds is better by more than a millionth.

use super::goals::cost;
use super::interior;
use proptest::prelude::*;
use stillpoint_plan::fluence::{
    Bound, Certificate, Csr, DvhAtLeast, DvhAtMost, Geud, Goals, Homogeneity, MeanAtLeast, MeanDose,
    Objective, Options, Overdose, Problem, Side, StructureObjectives, Term, Underdose, solve, solve_plan,
};
use stillpoint_plan::{Csc, Rows};

/// A dense matrix by rows, `f32` as every dose is, with its terms.
#[derive(Clone, Debug)]
struct Dense {
    columns: usize,
    rows: Vec<Vec<f32>>,
    terms: Vec<Term>,
}

impl Dense {
    fn matrix(&self) -> Csc {
        let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
        for j in 0..self.columns {
            for (i, entries) in self.rows.iter().enumerate().filter(|(_, entries)| entries[j] != 0.0) {
                row.push(i as u32);
                value.push(entries[j]);
            }
            starts.push(row.len() as u64);
        }
        Csc::new(self.rows.len(), starts, row, value).unwrap()
    }

    fn problem(&self) -> Problem {
        Problem::new(Csr::from_columns(self.matrix().view()), self.terms.iter().copied()).unwrap()
    }

    fn dose(&self, x: &[f64]) -> Vec<f64> {
        let dose = |row: &Vec<f32>| row.iter().zip(x).map(|(a, x)| f64::from(*a) * x).sum();
        self.rows.iter().map(dose).collect()
    }

    /// `F(x)`, from the definition.
    fn objective(&self, x: &[f64]) -> f64 {
        let dose = self.dose(x);
        let cost = |term: &Term| {
            let away = dose[term.row as usize] - term.goal;
            let costing = if term.side == Side::Over { away } else { -away };
            term.weight * costing.max(0.0).powi(2)
        };
        self.terms.iter().map(cost).sum()
    }

    /// Asserts that ours is feasible and no worse than Clarabel's by a millionth, and that the certificate holds there.
    fn hold(&self, options: Options) {
        let problem = self.problem();
        let ours = solve(&problem, None, options);
        assert!(ours.x.len() == self.columns && ours.x.iter().all(|x| x.is_finite() && *x >= 0.0));
        let (theirs, zero) =
            (self.objective(&interior::weights(&problem)), self.objective(&vec![0.0; self.columns]));
        let found = self.objective(&ours.x);
        let Certificate { objective, kkt, excess } = ours.certificate;
        assert!((objective - found).abs() <= 1e-9 * found + 1e-18 * zero, "{objective} is not {found}");
        assert!(
            found <= theirs.min(zero) * (1.0 + 1e-6) + 1e-12 * zero,
            "{found} {theirs} {kkt} {}",
            ours.steps
        );
        assert!(found - theirs <= excess + 1e-9 * found + 1e-12 * zero, "{found} {theirs} {excess}");
    }
}

/// Beams of smooth, overlapping pencils through a disc with a target and an organ beside it, as plans have them.
fn disc(beams: usize, width: f64, organ: [f64; 2], weights: [f64; 4]) -> Dense {
    let pencils = 9;
    let mut rows = Vec::new();
    let mut terms = Vec::new();
    for y in -12..=12 {
        for x in -12..=12 {
            let (x, y) = (f64::from(x), f64::from(y));
            if x.hypot(y) > 12.0 {
                continue;
            }
            let row = rows.len() as u32;
            let mut add = |side, goal, weight| terms.push(Term { row, side, goal, weight: weight / 100.0 });
            if x.hypot(y) < 4.0 {
                add(Side::Under, 60.0, weights[0]);
                add(Side::Over, 62.0, weights[1]);
            } else if (x - organ[0]).hypot(y - organ[1]) < 3.0 {
                add(Side::Over, 10.0, weights[2]);
            } else {
                add(Side::Over, 20.0, weights[3]);
            }
            let dose = |j: usize| {
                let angle = std::f64::consts::TAU * (j / pencils) as f64 / beams as f64;
                let (sin, cos) = angle.sin_cos();
                let (across, along) = (cos * x - sin * y, sin * x + cos * y);
                let off = (across - 1.2 * ((j % pencils) as f64 - 4.0)) / width;
                // Cut off, as a matrix of doses is.
                if off.abs() > 3.0 { 0.0 } else { ((-0.05 * along - off * off).exp()) as f32 }
            };
            rows.push((0..beams * pencils).map(dose).collect());
        }
    }
    Dense { columns: beams * pencils, rows, terms }
}

/// The disc's target (rows with an under-dose), its organ (10 Gy at most) and the rest, with objectives of every kind.
fn every_objective(disc: &Dense, [a, b, c]: [f64; 3]) -> Vec<StructureObjectives> {
    let rows = |fits: &dyn Fn(&Term) -> bool| {
        let mut rows: Vec<u32> = disc.terms.iter().filter(|t| fits(t)).map(|t| t.row).collect();
        rows.dedup();
        rows
    };
    let structure = |name: &str, voxels, objectives| StructureObjectives {
        name: name.into(),
        voxels,
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives,
    };
    let target = vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: a }),
        Objective::Overdose(Overdose { dose: 63.0, weight: b }),
        Objective::Homogeneity(Homogeneity { weight: c }),
        Objective::DvhAtLeast(DvhAtLeast { dose: 58.0, volume: 0.9, weight: b }),
    ];
    let organ = vec![
        Objective::MeanDose(MeanDose { dose: 8.0, weight: b }),
        Objective::DvhAtMost(DvhAtMost { dose: 12.0, volume: 0.3, weight: a }),
        Objective::Overdose(Overdose { dose: 25.0, weight: c }),
    ];
    vec![
        structure("target", rows(&|t| t.goal == 62.0), target),
        structure("organ", rows(&|t| t.goal == 10.0), organ),
        structure(
            "rest",
            rows(&|t| t.goal == 20.0),
            vec![Objective::Overdose(Overdose { dose: 20.0, weight: 5.0 })],
        ),
    ]
}

/// The same with the DVH points' voxels as these doses choose them, written down for another solver: a column of means
/// for the homogeneity, a row of the mean for the mean dose.
fn written_down(disc: &Dense, requested: &[StructureObjectives], dose: &[f64]) -> Dense {
    let mut rows: Vec<Vec<f32>> = disc.rows.iter().map(|row| [&row[..], &[0.0]].concat()).collect();
    let mut terms = Vec::new();
    for StructureObjectives { voxels, objectives, .. } in requested {
        let v = voxels.len() as f64;
        let mut rising = voxels.clone();
        rising.sort_by(|a, b| dose[*a as usize].total_cmp(&dose[*b as usize]));
        for objective in objectives {
            let mut each = |rows: &[u32], side, goal, weight: f64| {
                terms.extend(rows.iter().map(|&row| Term { row, side, goal, weight: weight / v }));
            };
            match *objective {
                Objective::Overdose(Overdose { dose, weight }) => each(voxels, Side::Over, dose, weight),
                Objective::FallOff(_)
                | Objective::MeanAtLeast(_)
                | Objective::DvhPoint(_)
                | Objective::Geud(_) => unreachable!("no structure here has one"),
                Objective::Underdose(Underdose { dose, weight }) => each(voxels, Side::Under, dose, weight),
                Objective::DvhAtMost(DvhAtMost { dose, volume, weight }) => {
                    let costing = rising.len() - (volume * v) as usize;
                    each(&rising[..costing], Side::Over, dose, weight);
                }
                Objective::DvhAtLeast(DvhAtLeast { dose, volume, weight }) => {
                    let costing = (volume * v).ceil() as usize;
                    each(&rising[rising.len() - costing..], Side::Under, dose, weight);
                }
                Objective::MeanDose(MeanDose { dose, weight }) => {
                    let mean = |j: usize| {
                        voxels.iter().map(|i| f64::from(disc.rows[*i as usize][j])).sum::<f64>() / v
                    };
                    let row = rows.len() as u32;
                    rows.push((0..disc.columns).map(|j| mean(j) as f32).chain([0.0]).collect());
                    terms.push(Term { row, side: Side::Over, goal: dose, weight });
                }
                Objective::Homogeneity(Homogeneity { weight }) => {
                    for i in voxels {
                        let row = rows.len() as u32;
                        rows.push([&disc.rows[*i as usize][..], &[-1.0]].concat());
                        let both = [Side::Over, Side::Under];
                        terms.extend(both.map(|side| Term { row, side, goal: 0.0, weight: weight / v }));
                    }
                }
            }
        }
    }
    Dense { columns: disc.columns + 1, rows, terms }
}

fn weight() -> impl Strategy<Value = f64> {
    (0.0..4.0).prop_map(|power| 10f64.powf(power))
}

/// Any small matrix: empty rows and columns, columns alike, goals in either order, also none of them within reach.
fn any() -> impl Strategy<Value = Dense> {
    (1_usize..9, 0_usize..20).prop_flat_map(|(columns, rows)| {
        let entry = prop_oneof![2 => Just(0.0_f32), 3 => (1..200).prop_map(|hundredths| hundredths as f32 * 0.01), 1 => Just(1.0_f32)];
        let side = prop_oneof![Just(Side::Over), Just(Side::Under)];
        let term = (0..rows.max(1) as u32, side, -10.0..80.0, weight())
            .prop_map(|(row, side, goal, weight)| Term { row, side, goal, weight });
        let terms = prop::collection::vec(term, 0..if rows == 0 { 1 } else { 40 });
        let matrix = prop::collection::vec(prop::collection::vec(entry, columns), rows);
        (matrix, terms, any_alike(columns)).prop_map(move |(mut rows, terms, alike)| {
            rows.iter_mut().for_each(|row| row[alike[0]] = row[alike[1]]);
            Dense { columns, rows, terms }
        })
    })
}

fn any_alike(columns: usize) -> impl Strategy<Value = [usize; 2]> {
    [0..columns, 0..columns]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn small_problems_of_any_kind(dense in any(), by_products in prop::bool::ANY) {
        dense.hold(Options { dense_columns: if by_products { 0 } else { 6000 }, ..Options::default() });
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn problems_like_those_of_plans(
        beams in 1_usize..8, width in 1.0..4.0, organ in [-9.0..9.0, -9.0..9.0], weights in [weight(), weight(), weight(), weight()],
        by_products in prop::bool::ANY,
    ) {
        let options = Options { dense_columns: if by_products { 0 } else { 6000 }, tolerance: 1e-6, ..Options::default() };
        disc(beams, width, organ, weights).hold(options);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn plans_with_objectives_of_every_kind(
        beams in 2_usize..8, width in 1.0..4.0, organ in [-9.0..9.0, -9.0..9.0], weights in [weight(), weight(), weight()],
    ) {
        let disc = disc(beams, width, organ, [1.0; 4]);
        let mut requested = every_objective(&disc, weights);
        requested.retain(|w| !w.voxels.is_empty());
        let goals = Goals::new(requested.clone(), disc.rows.len()).unwrap();
        let matrix = Rows::from_columns(disc.matrix().view()).unwrap();
        let problem = goals.problem(&[matrix.view().into()]).unwrap();
        let plan = solve_plan(&problem, None, Options::default()).unwrap();
        let dose = disc.dose(&plan.weights);
        let found = cost(&requested, &dose);
        let Certificate { objective, excess, .. } = plan.certificate;
        // A row of means is rounded to 24 bits.
        prop_assert!((objective - found).abs() <= 1e-5 * found, "{objective} is not {found}");
        prop_assert!(plan.certificate.relative_excess() <= 1e-6, "{:?}", plan.certificate);
        let other = written_down(&disc, &requested, &dose);
        let mean = |rows: &[u32]| rows.iter().map(|i| dose[*i as usize]).sum::<f64>() / rows.len() as f64;
        let ours = other.objective(&[&plan.weights[..], &[mean(&requested[0].voxels)]].concat());
        prop_assert!((ours - found).abs() <= 1e-5 * found, "{ours} is not {found}");
        let theirs = other.objective(&interior::weights(&other.problem()));
        prop_assert!(ours <= theirs * (1.0 + 1e-6), "{ours} {theirs} in {} rounds", plan.rounds);
        prop_assert!(ours - theirs <= excess + 1e-6 * ours, "{ours} {theirs} {excess}");
    }
}

/// The disc with a gEUD of the organ above, and a gEUD and a mean of the target below.
fn regions(disc: &Dense, a: f64, under: f64, weights: [f64; 3]) -> Vec<StructureObjectives> {
    let mut structures = every_objective(disc, weights);
    let [b, c, d] = weights;
    structures[0].objectives = vec![
        Objective::Overdose(Overdose { dose: 63.0, weight: b }),
        Objective::Geud(Geud { a: under, bound: Bound::AtLeast, dose: 60.0, weight: c }),
        Objective::MeanAtLeast(MeanAtLeast { dose: 61.0, weight: d }),
    ];
    structures[1].objectives = vec![Objective::Geud(Geud { a, bound: Bound::AtMost, dose: 12.0, weight: c })];
    structures.retain(|w| !w.voxels.is_empty());
    structures
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn no_plan_of_another_solver_has_a_better_equivalent_uniform_dose(
        beams in 2_usize..6, width in 1.5..4.0, organ in [-9.0..9.0, -9.0..9.0], a in 1.05..12.0, under in -12.0..-1.0,
        weights in [weight(), weight(), weight()], dense_columns in prop_oneof![Just(0_usize), Just(6000)],
    ) {
        let disc = disc(beams, width, organ, [1.0; 4]);
        let requested = regions(&disc, a, under, weights);
        let goals = Goals::new(requested.clone(), disc.rows.len()).unwrap();
        let matrix = Rows::from_columns(disc.matrix().view()).unwrap();
        let problem = goals.problem(&[matrix.view().into()]).unwrap();
        let plan = solve_plan(&problem, None, Options { dense_columns, ..Options::default() }).unwrap();
        prop_assert!(plan.weights.iter().all(|x| x.is_finite() && *x >= 0.0));
        let found = cost(&requested, &disc.dose(&plan.weights));
        let Certificate { objective, excess, .. } = plan.certificate;
        prop_assert!((objective - found).abs() <= 1e-5 * found + 1e-9, "{objective} is not {found}");
        prop_assert!(plan.certificate.relative_excess() <= 1e-5, "{:?} in {} steps", plan.certificate, plan.steps);
        let (weights, solved) = interior::region_weights(&disc.rows, disc.columns, &requested);
        let theirs = cost(&requested, &disc.dose(&weights));
        prop_assert!(found <= theirs * (1.0 + 1e-5) + 1e-9, "{found} {theirs} in {} steps", plan.steps);
        // The other solver is near as well: the two have the same optimum.
        prop_assert!(!solved || theirs <= found * 1.01 + 1e-3, "{found} {theirs} in {} steps", plan.steps);
        prop_assert!(found - theirs <= excess + 1e-5 * found + 1e-9, "{found} {theirs} {excess}");
    }
}

#[test]
fn one_bixel_no_objective_and_weights_beyond_measure() {
    let term = |row, side, goal, weight| Term { row, side, goal, weight };
    let both = |weight: f64| vec![term(0, Side::Under, 60.0, weight), term(1, Side::Over, 20.0, 1.0)];
    let one = |rows: Vec<Vec<f32>>, terms| Dense { columns: 1, rows, terms };
    let two = |rows: Vec<Vec<f32>>, terms| Dense { columns: 2, rows, terms };
    for dense in [
        one(vec![vec![1.0], vec![0.5]], both(1.0)),
        one(vec![vec![1.0], vec![0.5]], both(1e12)),
        one(vec![vec![1.0], vec![0.5]], both(1e-12)),
        one(vec![vec![1.0], vec![0.5]], Vec::new()),
        one(vec![vec![0.0], vec![0.0]], both(1.0)),
        one(vec![vec![1e-30], vec![1e-30]], both(1.0)),
        one(vec![vec![1e30], vec![1e30]], both(1.0)),
        two(vec![vec![1.0, 0.0], vec![0.5, 0.0]], both(1e9)),
        two(vec![vec![1.0, 1.0], vec![0.5, 0.5]], both(1e9)),
        two(vec![vec![1.0, 1e-20], vec![1e-20, 1.0]], both(1e9)),
        Dense { columns: 3, rows: Vec::new(), terms: Vec::new() },
    ] {
        for dense_columns in [0, 6000] {
            let problem = dense.problem();
            let found = solve(&problem, None, Options { dense_columns, ..Options::default() });
            let zero = dense.objective(&vec![0.0; dense.columns]);
            assert!(found.x.iter().all(|x| x.is_finite() && *x >= 0.0), "{dense:?} {found:?}");
            let good = found.certificate.kkt < 1e-6 || found.certificate.excess <= 1e-9 * zero;
            assert!(good && found.steps < 400, "{dense:?} {found:?}");
        }
    }
    let nothing = Problem::new(Csr::default(), []).unwrap();
    assert!(solve(&nothing, None, Options::default()).x.is_empty());
}
