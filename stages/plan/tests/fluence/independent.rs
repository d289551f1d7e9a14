//! Random problems, solved beside another solver: no point that it finds is better by more than a millionth.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};
use proptest::prelude::*;
use stillpoint_plan::Csc;
use stillpoint_plan::fluence::{Certificate, Csr, Options, Problem, Side, Term, solve};

/// A dense matrix by rows, `f32` as every dose is, with its terms.
#[derive(Clone, Debug)]
struct Dense {
    columns: usize,
    rows: Vec<Vec<f32>>,
    terms: Vec<Term>,
}

impl Dense {
    fn problem(&self) -> Problem {
        let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
        for j in 0..self.columns {
            for (i, entries) in self.rows.iter().enumerate().filter(|(_, entries)| entries[j] != 0.0) {
                row.push(i as u32);
                value.push(entries[j]);
            }
            starts.push(row.len() as u64);
        }
        let matrix = Csc::new(self.rows.len(), starts, row, value).unwrap();
        Problem::new(Csr::from_columns(matrix.view()), self.terms.iter().copied()).unwrap()
    }

    /// `F(x)`, from the definition.
    fn objective(&self, x: &[f64]) -> f64 {
        let dose = |row: &[f32]| row.iter().zip(x).map(|(a, x)| f64::from(*a) * x).sum::<f64>();
        let cost = |term: &Term| {
            let away = dose(&self.rows[term.row as usize]) - term.goal;
            let costing = if term.side == Side::Over { away } else { -away };
            term.weight * costing.max(0.0).powi(2)
        };
        self.terms.iter().map(cost).sum()
    }

    /// Weights by Clarabel: a slack for every term, `min sum w s^2`, `+-(A x - goal) <= s`, `x >= 0`.
    fn by_clarabel(&self) -> Vec<f64> {
        let (n, terms) = (self.columns, &self.terms);
        let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n + terms.len()];
        let mut bounds = Vec::new();
        for (i, term) in terms.iter().enumerate() {
            let sign = if term.side == Side::Over { 1.0 } else { -1.0 };
            for (j, a) in self.rows[term.row as usize].iter().enumerate().filter(|(_, a)| **a != 0.0) {
                columns[j].push((i, sign * f64::from(*a)));
            }
            columns[n + i].push((i, -1.0));
            bounds.push(sign * term.goal);
        }
        for (j, column) in columns[..n].iter_mut().enumerate() {
            column.push((terms.len() + j, -1.0));
            bounds.push(0.0);
        }
        let weights = |j: usize| if j < n { Vec::new() } else { vec![(j, 2.0 * terms[j - n].weight)] };
        let quadratic = csc(n + terms.len(), (0..n + terms.len()).map(weights).collect());
        let constraints = csc(bounds.len(), columns);
        let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
        let linear = vec![0.0; n + terms.len()];
        let cones = [SupportedConeT::NonnegativeConeT(bounds.len())];
        let mut solver =
            DefaultSolver::new(&quadratic, &linear, &constraints, &bounds, &cones, settings).unwrap();
        solver.solve();
        solver.solution.x[..n].iter().map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 }).collect()
    }

    /// Asserts that ours is feasible and no worse than Clarabel's by a millionth, and that the certificate holds there.
    fn hold(&self, options: Options) {
        let problem = self.problem();
        let ours = solve(&problem, None, options);
        assert!(ours.x.len() == self.columns && ours.x.iter().all(|x| x.is_finite() && *x >= 0.0));
        let (theirs, zero) = (self.objective(&self.by_clarabel()), self.objective(&vec![0.0; self.columns]));
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

fn csc(rows: usize, columns: Vec<Vec<(usize, f64)>>) -> CscMatrix<f64> {
    let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for column in &columns {
        row.extend(column.iter().map(|entry| entry.0));
        value.extend(column.iter().map(|entry| entry.1));
        starts.push(row.len());
    }
    CscMatrix::new(rows, columns.len(), starts, row, value)
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

fn weight() -> impl Strategy<Value = f64> {
    (0.0..4.0).prop_map(|power| 10f64.powf(power))
}

/// Any small matrix: empty rows and columns, columns alike, goals in either order, also none of them within reach.
fn any() -> impl Strategy<Value = Dense> {
    (1_usize..9, 0_usize..20).prop_flat_map(|(columns, rows)| {
        let entry = prop_oneof![2 => Just(0.0_f32), 3 => 0.01_f32..2.0, 1 => Just(1.0_f32)];
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
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]
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
