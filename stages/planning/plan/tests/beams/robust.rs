//! The robust game: the first player chooses beams, the second a set-up error.

use std::num::NonZeroUsize;

use stillpoint_plan::Rows;
use stillpoint_plan::beams::{
    Budget, Evaluated, Evaluator, Method, Progress, SHARE_OF_A_SOLVE, SearchOptions, SecondPlayer, choose,
};
use stillpoint_plan::fluence::{Goals, Objective, Overdose, Underdose};

use super::{BEAMS, SIDE, disc, disc_moved, ring};

const ERRORS: [[f64; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// A search for the disc with the best set's plan, against the first `errors` of the list; none is the nominal game.
fn play(errors: Option<usize>, solves: usize, threads: usize) -> (Evaluated, Vec<Progress>) {
    let (matrices, goals) = disc();
    let (moving, still) = parts(&goals);
    let doses: Vec<Vec<Rows>> = ERRORS[..errors.unwrap_or(0)].iter().map(|by| disc_moved(*by)).collect();
    let second = SecondPlayer { doses: &doses, moving: &moving, still: &still, all: &goals };
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves })
        .with_threads(NonZeroUsize::new(threads).unwrap());
    if errors.is_some() {
        evaluator = evaluator.against(&second);
    }
    let method = Method::Search(SearchOptions::default());
    let best = choose(&method, &mut evaluator, None, 1).unwrap().best;
    (Evaluated::clone(&best), evaluator.history().to_vec())
}

/// The body counts as planned.
fn parts(goals: &Goals) -> (Goals, Goals) {
    let of = |body: bool| {
        let requested =
            goals.structures().iter().filter(|requested| (requested.name == "body") == body).cloned();
        Goals::new(requested.collect(), SIDE * SIDE).unwrap()
    };
    (of(false), of(true))
}

/// What a plan costs where the patient is moved, from the formulas.
fn by_hand(plan: &Evaluated, goals: &Goals, moved: [f64; 2]) -> f64 {
    let dose = |matrices: &[Rows]| -> Vec<f64> {
        let mut dose = vec![0.0; SIDE * SIDE];
        for beam in plan.beams.beams() {
            let weights = plan.weights_of(*beam).unwrap();
            for (voxel, dose) in dose.iter_mut().enumerate() {
                let (columns, values) = matrices[usize::from(*beam)].view().row(voxel);
                let of = columns.iter().zip(values).map(|(c, v)| weights[usize::from(*c)] * f64::from(*v));
                *dose += of.sum::<f64>();
            }
        }
        dose
    };
    let (planned, there) = (dose(&disc().0), dose(&disc_moved(moved)));
    let mut cost = 0.0;
    for structure in goals.structures() {
        let dose = if structure.name == "body" { &planned } else { &there };
        for objective in &structure.objectives {
            let (weight, off): (f64, Box<dyn Fn(f64) -> f64>) = match *objective {
                Objective::Overdose(Overdose { dose, weight }) => {
                    (weight, Box::new(move |d| f64::max(d - dose, 0.0)))
                }
                Objective::Underdose(Underdose { dose, weight }) => {
                    (weight, Box::new(move |d| f64::max(dose - d, 0.0)))
                }
                other => panic!("{other:?}"),
            };
            let sum: f64 = structure.voxels.iter().map(|v| off(dose[*v as usize]).powi(2)).sum();
            cost += weight * sum / structure.voxels.len() as f64;
        }
    }
    cost
}

#[test]
fn the_value_of_a_set_is_the_most_that_its_plan_costs_over_the_list() {
    let (_, goals) = disc();
    let (best, reported) = play(Some(4), 40, 1);
    let answer = best.answer.clone().unwrap();
    let planned = best.plan.certificate.objective;
    for (cost, moved) in answer.costs.iter().zip(ERRORS) {
        let expected = by_hand(&best, &goals, moved);
        assert!((cost / expected - 1.0).abs() < 1e-9, "{moved:?}: {cost} {expected}");
    }
    let worst = answer.costs.iter().copied().fold(planned, f64::max);
    assert_eq!(best.cost, worst);
    assert_eq!(answer.costs[answer.error.unwrap()], worst, "an error on this disc costs");
    let whole = reported.iter().filter(|p| p.beams.beams().len() == BEAMS);
    assert_eq!(best.cost, whole.map(|p| p.cost).fold(f64::INFINITY, f64::min));
}

#[test]
fn against_an_empty_list_it_is_the_nominal_game_to_the_bit() {
    let ((nominal, of_nominal), (robust, of_robust)) = (play(None, 30, 1), play(Some(0), 30, 1));
    assert_eq!(of_nominal, of_robust);
    let bits = |plan: &Evaluated| plan.plan.weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
    assert_eq!((bits(&nominal), nominal.cost.to_bits()), (bits(&robust), robust.cost.to_bits()));
    assert_eq!(robust.answer.unwrap().error, None);
}

#[test]
fn a_longer_list_costs_no_set_less() {
    let (matrices, goals) = disc();
    let (moving, still) = parts(&goals);
    let set = ring().set(&[3, 20, 41, 58, 77]).unwrap();
    let mut before = 0.0;
    for count in 0..=ERRORS.len() {
        let doses: Vec<Vec<Rows>> = ERRORS[..count].iter().map(|by| disc_moved(*by)).collect();
        let second = SecondPlayer { doses: &doses, moving: &moving, still: &still, all: &goals };
        let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
        let solved = evaluator.against(&second).evaluate(&set, None).unwrap();
        assert!(solved.cost >= before, "{count}: {} {before}", solved.cost);
        before = solved.cost;
    }
}

#[test]
fn answers_are_counted_and_threads_change_nothing() {
    let ((one, told_one), (three, told_three)) = (play(Some(4), 40, 1), play(Some(4), 40, 3));
    assert_eq!(told_one, told_three);
    assert_eq!((one.cost, one.answer), (three.cost, three.answer));
    let most = (40.0 / (1.0 + 4.0 * SHARE_OF_A_SOLVE)) as usize;
    assert_eq!(told_one.len(), most);
    assert!(most < 40);
}

#[test]
fn doses_of_another_grid_are_refused() {
    let (matrices, goals) = disc();
    let (moving, still) = parts(&goals);
    let small = stillpoint_plan::Csc::new(3, vec![0, 1, 1, 1, 1, 1], vec![0], vec![1.0]).unwrap();
    let doses = vec![vec![Rows::from_columns(small.view()).unwrap(); 90]];
    let second = SecondPlayer { doses: &doses, moving: &moving, still: &still, all: &goals };
    let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
    let set = ring().set(&[3, 20, 41, 58, 77]).unwrap();
    assert!(evaluator.against(&second).evaluate(&set, None).is_err());
}
