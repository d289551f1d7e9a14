//! The reference vectors of the search: formulas, matrix games, game trees.

use serde_json::Value;

use super::formulas::{dirichlet, puct};
use super::game::{Game, GameTree, Player};
use super::matrix::{exploitability, fictitious_play, gain_floor, loss_ceiling, saddle_point};
use crate::beams::random::draw;

fn cases(name: &str) -> Vec<Value> {
    let file = format!("{}/../../../tests/vectors/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let vectors: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let cases = vectors["cases"].as_array().unwrap().clone();
    assert!(!cases.is_empty());
    cases
}

/// Upper confidence bound of a child, `Q + c sqrt(2 ln n / N)` (5.8); infinite for a child without visits.
fn uct(q: f64, visits: u32, parent_visits: u32, c: f64) -> f64 {
    match visits {
        0 => f64::INFINITY,
        n => q + c * (2.0 * libm::log(f64::from(parent_visits)) / f64::from(n)).sqrt(),
    }
}

/// The policy of visits, `N^(1/tau) / sum` (5.7): 0 for children without visits. At `tau` 0 the child of most visits has
/// all, the first among equals. Without any visit every child has the same.
fn visit_policy(visits: &[u32], tau: f64) -> Vec<f64> {
    let most = visits.iter().copied().max().unwrap_or(0);
    if most == 0 {
        return vec![1.0 / visits.len().max(1) as f64; visits.len()];
    }
    if tau <= 0.0 {
        let first = visits.iter().position(|n| *n == most);
        return (0..visits.len()).map(|i| if Some(i) == first { 1.0 } else { 0.0 }).collect();
    }
    let logarithm = |n: u32| libm::log(f64::from(n)) / tau;
    let top = logarithm(most);
    let powers: Vec<f64> =
        visits.iter().map(|n| if *n == 0 { 0.0 } else { libm::exp(logarithm(*n) - top) }).collect();
    let sum: f64 = powers.iter().sum();
    powers.into_iter().map(|power| power / sum).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

/// Compares as the vector's tolerances say.
fn assert_near(case: &Value, name: &str, found: &[f64], expected: &[f64]) {
    let (rel, abs) = (number(&case["tol"]["rel"]), number(&case["tol"]["abs"]));
    assert_eq!(found.len(), expected.len());
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= abs + rel * e.abs(), "{} {name}: {found:?} {expected:?}", case["id"]);
    }
}

#[test]
fn bounds_and_policies_are_those_of_the_vectors() {
    for case in cases("g_selection") {
        let (given, out) = (&case["in"], &case["out"]);
        let (q, p) = (numbers(&given["Q"]), numbers(&given["P"]));
        let n: Vec<u32> = numbers(&given["N"]).iter().map(|n| *n as u32).collect();
        let (c, parent, all) = (number(&given["c"]), number(&given["n_parent"]) as u32, n.iter().sum());
        for (i, expected) in out["uct"].as_array().unwrap().iter().enumerate() {
            match expected.as_f64() {
                Some(expected) => assert_near(&case, "uct", &[uct(q[i], n[i], parent, c)], &[expected]),
                None => assert_eq!(uct(q[i], n[i], parent, c), f64::INFINITY),
            }
        }
        let bounds: Vec<f64> = (0..q.len()).map(|i| puct(q[i], p[i], n[i], all, c)).collect();
        assert_near(&case, "puct", &bounds, &numbers(&out["puct"]));
        let best = (0..q.len()).fold(0, |a, b| if bounds[b] > bounds[a] { b } else { a });
        assert_eq!(best as u64, out["argmax_puct"].as_u64().unwrap());
        assert_near(
            &case,
            "policy",
            &visit_policy(&n, number(&given["tau"])),
            &numbers(&out["visit_policy"]),
        );
    }
}

#[test]
fn a_policy_without_temperature_plays_the_most_visited_move() {
    assert_eq!(visit_policy(&[3, 7, 7], 0.0), [0.0, 1.0, 0.0]);
    assert_eq!(visit_policy(&[0, 0], 1.0), [0.5, 0.5]);
    // A temperature whose powers overflow without the largest taken off.
    assert_eq!(visit_policy(&[1000, 999], 1e-3)[0].to_bits() >> 52, 1022);
}

#[test]
fn dirichlet_noise_is_a_distribution_with_the_right_variance() {
    let (parts, alpha, draws) = (4, 0.5, 4000);
    let mut rng = draw(1, 2, 3);
    let (mut mean, mut square) = (0.0, 0.0);
    for _ in 0..draws {
        let noise = dirichlet(parts, alpha, &mut rng);
        assert!((noise.iter().sum::<f64>() - 1.0).abs() < 1e-12 && noise.iter().all(|p| *p >= 0.0));
        mean += noise[0] / f64::from(draws);
        square += noise[0] * noise[0] / f64::from(draws);
    }
    // Mean 1/4, variance (1/4)(3/4)/(4 alpha + 1).
    assert!((mean - 0.25).abs() < 0.02, "{mean}");
    assert!((square - mean * mean - 0.0625).abs() < 0.01, "{square}");
}

#[test]
fn matrix_games_have_the_values_of_the_vectors() {
    for case in cases("g_matrix_games") {
        let (given, out) = (&case["in"], &case["out"]);
        let costs: Vec<Vec<f64>> = given["G"].as_array().unwrap().iter().map(numbers).collect();
        let mixed = saddle_point(&costs).unwrap();
        assert_near(&case, "value", &[mixed.value], &[number(&out["value"])]);
        assert!(exploitability(&costs, &mixed.rows, &mixed.columns) < 1e-6, "{}", case["id"]);
        let (floor, (ceiling, _)) = (gain_floor(&costs), loss_ceiling(&costs));
        assert_near(&case, "floor", &[floor], &[number(&out["pure_gain_floor_maxmin"])]);
        assert_near(&case, "ceiling", &[ceiling], &[number(&out["pure_loss_ceiling_minmax"])]);
        assert!(floor <= mixed.value + 1e-9 && mixed.value <= ceiling + 1e-9);
        let rounds = given["fictitious_play_iterations"].as_u64().unwrap() as usize;
        let played = fictitious_play(&costs, rounds);
        let found = exploitability(&costs, &played.rows, &played.columns);
        assert!(found < 5.0 * number(&out["fp_exploitability"]) + 1e-6, "{}: {found}", case["id"]);
    }
    assert_eq!(saddle_point(&[]), None);
    assert_eq!(saddle_point(&[vec![1.0, 2.0], vec![1.0]]), None);
}

/// A full tree whose leaves have costs; its players alternate.
struct Full {
    branching: usize,
    depth: usize,
    leaves: Vec<f64>,
}

impl Game for Full {
    type Place = (usize, usize);
    type Error = std::convert::Infallible;

    fn root(&self) -> Self::Place {
        (0, 0)
    }
    fn player(&self, (depth, _): &Self::Place) -> Player {
        if depth % 2 == 0 { Player::Minimiser } else { Player::Maximiser }
    }
    fn moves(&self, (depth, _): &Self::Place) -> usize {
        if *depth == self.depth { 0 } else { self.branching }
    }
    fn after(&self, (depth, number): &Self::Place, action: usize) -> Self::Place {
        (depth + 1, number * self.branching + action)
    }
    fn priors(&mut self, _: &Self::Place) -> Result<Vec<f64>, Self::Error> {
        Ok(vec![1.0 / self.branching as f64; self.branching])
    }
    fn cost(&mut self, (depth, number): &Self::Place) -> Result<f64, Self::Error> {
        Ok(if *depth == self.depth { self.leaves[*number] } else { 0.5 })
    }
}

#[test]
fn game_trees_find_the_moves_of_the_vectors() {
    for case in cases("g_minimax_trees") {
        let (given, out) = (&case["in"], &case["out"]);
        let game = Full {
            branching: number(&given["branching"]) as usize,
            depth: number(&given["depth"]) as usize,
            leaves: numbers(&given["leaf_cost"]),
        };
        let iterations = given["iterations"].as_u64().unwrap();
        let mut tree = GameTree::new(game, number(&given["c_puct"]), 0.5).unwrap();
        for _ in 0..iterations {
            tree.visit().unwrap();
        }
        let visits = tree.root_visits();
        let most_visited = visits.iter().position(|v| Some(v) == visits.iter().max()).unwrap();
        assert_eq!(most_visited as u64, out["best_root_action"].as_u64().unwrap());
        for (found, expected) in visits.iter().zip(numbers(&out["reference_root_visits"])) {
            let off = (f64::from(*found) - expected).abs();
            assert!(off <= 0.01 * iterations as f64, "{}: {found} {expected}", case["id"]);
        }
    }
}
