//! What holds for every shape of the table, so that a further one is tested without a further test.

#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

use super::super::goals::{Goals, PlanProblem, StructureObjectives};
use super::super::line;
use super::super::problem::Problem;
use super::*;
use crate::{Csc, Rows};

const VOXELS: usize = 9;
/// Step of finite differences, Gy.
const STEP: f64 = 1e-4;

/// Every text form with the name of its shape.
fn examples() -> impl Iterator<Item = (&'static str, &'static str, ObjectiveSpec)> {
    let all =
        ObjectiveSpec::EXAMPLES.iter().flat_map(|(name, texts)| texts.iter().map(move |text| (*name, *text)));
    all.map(|(name, text)| (name, text, serde_json::from_str(text).unwrap()))
}

/// One structure with one objective, each voxel with a bixel of its own that gives it 1 Gy.
struct Alone {
    goals: Goals,
    problem: PlanProblem,
}

impl Alone {
    fn new(objective: Objective, volumes: &[f64], to_target_mm: &[f64]) -> Self {
        let structure = StructureObjectives {
            name: "structure".into(),
            voxels: (0..VOXELS as u32).collect(),
            volumes: volumes.to_vec(),
            to_target_mm: to_target_mm.to_vec(),
            objectives: vec![objective],
        };
        let goals = Goals::new(vec![structure], VOXELS).unwrap();
        let starts = (0..=VOXELS as u64).collect();
        let matrix = Csc::new(VOXELS, starts, (0..VOXELS as u32).collect(), vec![1.0; VOXELS]).unwrap();
        let matrix = Rows::from_columns(matrix.view()).unwrap();
        let problem = goals.problem(&[matrix.view().into()]).unwrap();
        Self { goals, problem }
    }

    fn cost(&self, dose: &[f64]) -> f64 {
        self.goals.cost(dose).unwrap()
    }

    /// The convex problem at these doses: DVH points with the voxels that they choose.
    fn convex(&self, dose: &[f64]) -> Problem {
        let points = self.problem.dvh.iter();
        let points = points.flat_map(|p| p.terms(&p.costing(dose)).collect::<Vec<_>>());
        let terms = self.problem.convex.terms().iter().copied().chain(points).collect();
        self.problem.convex.with_terms(terms).unwrap()
    }

    /// All columns at these doses: those that are no bixels at their best.
    fn columns(&self, dose: &[f64]) -> Vec<f64> {
        let problem = self.convex(dose);
        let mut x = dose.to_vec();
        x.resize(problem.matrix().columns(), 0.0);
        for j in VOXELS..x.len() {
            let (mut at, mut change) = (rows(&problem), rows(&problem));
            let mut unit = vec![0.0; x.len()];
            unit[j] = 1.0;
            problem.doses(&x, &mut at);
            problem.doses(&unit, &mut change);
            x[j] = line::minimise(&problem, &at, &change, f64::INFINITY);
        }
        x
    }

    /// Slope and curvature along a change of all columns, at doses with these columns.
    fn along(&self, dose: &[f64], x: &[f64], change: &[f64]) -> (f64, f64) {
        let problem = self.convex(dose);
        let (mut at, mut by) = (rows(&problem), rows(&problem));
        problem.doses(x, &mut at);
        problem.doses(change, &mut by);
        line::slope_at(&problem, &at, &by, 0.0)
    }

    /// The curvature that steps of the solver are made with.
    fn model(&self, dose: &[f64], x: &[f64], change: &[f64]) -> f64 {
        let problem = self.convex(dose);
        let (mut at, mut by) = (rows(&problem), rows(&problem));
        problem.doses(x, &mut at);
        problem.doses(change, &mut by);
        let own: f64 = problem.curvatures(&at).iter().zip(&by).map(|(c, by)| c * by * by).sum();
        let square = |u: &[f64]| u.iter().zip(change).map(|(u, x)| u * x).sum::<f64>().powi(2);
        own + problem.bends(&at).iter().map(|(bend, u)| bend * square(u)).sum::<f64>()
    }

    /// The rows that DVH points choose.
    fn chosen(&self, dose: &[f64]) -> Vec<Vec<(u32, f64)>> {
        self.problem.dvh.iter().map(|point| point.costing(dose)).collect()
    }
}

fn rows(problem: &Problem) -> Vec<f64> {
    vec![0.0; problem.matrix().rows()]
}

fn moved(dose: &[f64], by: f64, direction: &[f64]) -> Vec<f64> {
    dose.iter().zip(direction).map(|(dose, direction)| dose + by * direction).collect()
}

fn numbers(least: f64, most: f64) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(least..most, VOXELS)
}

fn near(found: f64, expected: f64, scale: f64) -> bool {
    (found - expected).abs() <= 1e-4 * expected.abs().max(scale)
}

#[test]
fn the_slope_and_the_curvature_of_every_shape_are_those_of_its_cost() {
    for (_, text, spec) in examples() {
        let mut runner = TestRunner::new_with_rng(
            Config { cases: 150, failure_persistence: None, ..Config::default() },
            proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
        );
        let checked = std::cell::Cell::new(0);
        let draws =
            (numbers(1.0, 90.0), numbers(0.1, 3.0), numbers(0.0, 40.0), numbers(-1.0, 1.0), 20.0..80.0);
        let outcome = runner.run(&draws, |(dose, volumes, to_target_mm, direction, prescribed_gy)| {
            let objective = spec.resolve(prescribed_gy, 80.0);
            let alone = Alone::new(objective, &volumes, &to_target_mm);
            let (before, after) = (moved(&dose, -STEP, &direction), moved(&dose, STEP, &direction));
            let cost = alone.cost(&dose);
            let x = alone.columns(&dose);
            let mut rows = rows(&alone.problem.convex);
            alone.convex(&dose).doses(&x, &mut rows);
            let of_problem = alone.convex(&dose).objective(&rows);
            prop_assert!(
                near(of_problem, cost, 0.1 * objective.weight()),
                "{text}: {of_problem} is not {cost}"
            );
            // The best columns behind the bixels move with the doses.
            let (x_before, x_after) = (alone.columns(&before), alone.columns(&after));
            let change: Vec<f64> =
                x_after.iter().zip(&x_before).map(|(a, b)| (a - b) / (2.0 * STEP)).collect();
            let (slope, curvature) = alone.along(&dose, &x, &change);
            let ends = [alone.along(&before, &x_before, &change), alone.along(&after, &x_after, &change)];
            let chosen = alone.chosen(&dose);
            let kink = (ends[0].1 - ends[1].1).abs() > 0.01 * (ends[0].1 + ends[1].1).abs();
            if kink || chosen != alone.chosen(&before) || chosen != alone.chosen(&after) {
                return Ok(());
            }
            let expected = (alone.cost(&after) - alone.cost(&before)) / (2.0 * STEP);
            prop_assert!(near(slope, expected, objective.weight()), "{text}: slope {slope}, but {expected}");
            let expected = (ends[1].0 - ends[0].0) / (2.0 * STEP);
            let weight = objective.weight();
            prop_assert!(
                near(curvature, expected, 1e-2 * weight),
                "{text}: curvature {curvature}, but {expected}"
            );
            let model = alone.model(&dose, &x, &change);
            prop_assert!(model >= curvature - 1e-9 * weight, "{text}: {model} is less than {curvature}");
            checked.set(checked.get() + usize::from(curvature > 1e-3 * weight));
            Ok(())
        });
        assert!(outcome.is_ok(), "{outcome:?}");
        assert!(checked.get() >= 15, "{text} costs in {} draws only", checked.get());
    }
}

#[test]
fn every_text_form_is_read_as_it_is_written_and_bears_the_name_of_its_file() {
    for (name, text, spec) in examples() {
        let written = serde_json::to_string(&spec).unwrap();
        assert_eq!(serde_json::from_str::<ObjectiveSpec>(&written).unwrap(), spec, "{written}");
        assert!(text.starts_with(&format!("{{\"{name}\":")), "{name}: {text}");
        let objective = spec.resolve(60.0, 70.0);
        let written = serde_json::to_string(&objective).unwrap();
        assert_eq!(serde_json::from_str::<Objective>(&written).unwrap(), objective, "{written}");
        let unknown = text.replacen('{', "{ ", 1).replacen(": {", ": {\"weigth\": 1, ", 1);
        assert!(serde_json::from_str::<ObjectiveSpec>(&unknown).is_err(), "{unknown}");
    }
}

#[test]
fn no_shape_takes_a_number_out_of_its_range() {
    for (_, text, spec) in examples() {
        let objective = spec.resolve(60.0, 70.0);
        assert_eq!(objective.check("a"), Ok(()), "{text}");
        for factor in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(objective.scaled(factor).check("a").is_err(), "{text} times {factor}");
        }
        if spec.doses().iter().any(|dose| matches!(dose, Dose::OfPrescription(_))) {
            for prescribed_gy in [-60.0, f64::NAN, f64::INFINITY] {
                assert!(spec.resolve(prescribed_gy, 70.0).check("a").is_err(), "{text} of {prescribed_gy}");
            }
        }
    }
}

#[test]
fn at_an_even_dose_a_shape_costs_nothing_exactly_where_its_quantity_is_met() {
    let (volumes, to_target_mm) = ([1.0; VOXELS], [5.0; VOXELS]);
    for (_, text, spec) in examples() {
        let objective = spec.resolve(60.0, 70.0);
        let alone = Alone::new(objective, &volumes, &to_target_mm);
        for gray in (1..90).map(|gray| f64::from(gray) + 0.5) {
            let cost = alone.cost(&[gray; VOXELS]);
            if let Some(measured) = objective.measure(&Dvh::new(&[gray; VOXELS]).unwrap()) {
                assert_eq!(measured.met(), cost == 0.0, "{text} at {gray} Gy: {measured:?} costs {cost}");
            }
            if let Some(tolerated) = objective.tolerated_gy() {
                assert_eq!(gray <= tolerated, cost == 0.0, "{text} at {gray} Gy costs {cost}");
            }
        }
    }
}
