//! The ways to choose beams, on a disc with a target and an organ beside it.

mod robust;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use stillpoint_plan::beams::{
    BeamGame, BeamSet, Budget, Choice, Evaluated, Evaluator, Local, Memo, Method, Prior, Progress, Ring,
    SOLVE_TOLERANCE, SearchOptions, Solver, Stop, choose, class_solution, random_set, rotations,
};
use stillpoint_plan::fluence::{Goals, Objective, Overdose, StructureObjectives, Underdose};
use stillpoint_plan::{Csc, Rows};

const SIDE: usize = 21;
const BEAMS: usize = 5;

fn centre(voxel: usize) -> [f64; 2] {
    [voxel % SIDE, voxel / SIDE].map(|i| i as f64 - (SIDE / 2) as f64)
}

fn voxels(middle: [f64; 2], radius: f64) -> Vec<u32> {
    let inside = |at: [f64; 2]| (at[0] - middle[0]).hypot(at[1] - middle[1]) <= radius;
    (0..(SIDE * SIDE) as u32).filter(|v| inside(centre(*v as usize))).collect()
}

/// Parallel beams through a disc of radius 10, attenuated by depth, five bixels wide; the disc is moved beneath them.
fn disc_moved(by: [f64; 2]) -> Vec<Rows> {
    let beam = |b: u16| {
        let (sin, cos) = f64::from(4 * b).to_radians().sin_cos();
        let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
        for bixel in -2..=2 {
            for voxel in voxels([0.0, 0.0], 10.0) {
                let [x, y] = centre(voxel as usize);
                let (across, along) = (x * cos + y * sin, y * cos - x * sin);
                let across = across + by[0] * cos + by[1] * sin;
                let off = across - 1.5 * f64::from(bixel);
                let dose = (-0.05 * (10.0 - along) - off * off).exp();
                if dose > 1e-3 {
                    row.push(voxel);
                    value.push(dose as f32);
                }
            }
            starts.push(row.len() as u64);
        }
        Rows::from_columns(Csc::new(SIDE * SIDE, starts, row, value).unwrap().view()).unwrap()
    };
    (0..90).map(beam).collect()
}

fn disc() -> (Vec<Rows>, Goals) {
    let structure = |name: &str, voxels, objectives| StructureObjectives {
        name: name.into(),
        voxels,
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives,
    };
    let target = vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: 200.0 }),
        Objective::Overdose(Overdose { dose: 60.0, weight: 100.0 }),
    ];
    let goals = Goals::new(
        vec![
            structure("target", voxels([0.0, 0.0], 3.0), target),
            structure(
                "organ",
                voxels([0.0, 5.5], 2.0),
                vec![Objective::Overdose(Overdose { dose: 5.0, weight: 40.0 })],
            ),
            structure(
                "body",
                voxels([0.0, 0.0], 10.0),
                vec![Objective::Overdose(Overdose { dose: 15.0, weight: 10.0 })],
            ),
        ],
        SIDE * SIDE,
    )
    .unwrap();
    (disc_moved([0.0; 2]), goals)
}

/// The threads of this process; it notes how many sets it was told of and not yet asked for, at most.
struct Ahead<'a> {
    local: Local<'a, [Rows]>,
    begun: Vec<BeamSet>,
    most: usize,
}

impl Solver for Ahead<'_> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop> {
        // In the order in which they were begun.
        for set in sets {
            assert!(self.begun.first().is_none_or(|first| first == *set));
            self.begun.retain(|begun| begun != *set);
        }
        self.local.solve(sets, near, tolerance)
    }

    fn begin(&mut self, sets: &[&BeamSet], _: Option<&Evaluated>, _: f64) -> Result<(), Stop> {
        self.begun.extend(sets.iter().map(|set| (*set).clone()));
        self.most = self.most.max(self.begun.len());
        Ok(())
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        self.local.price(base, candidates)
    }
}

/// The threads of this process; it keeps the tolerances that it is asked for.
struct Noted<'a> {
    local: Local<'a, [Rows]>,
    tolerances: Vec<f64>,
}

impl Solver for Noted<'_> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop> {
        self.tolerances.push(tolerance);
        self.local.solve(sets, near, tolerance)
    }

    fn price(&mut self, neighbour: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        self.local.price(neighbour, candidates)
    }
}

#[test]
fn an_evaluator_solves_to_the_tolerance_that_it_is_given_and_to_none_that_is_no_solve() {
    let (matrices, goals) = disc();
    let set = ring().set(&[0, 18, 36, 54, 72]).unwrap();
    for tolerance in [None, Some(1e-3), Some(1e-9)] {
        let local = Local { influence: &matrices[..], goals: &goals, threads: NonZeroUsize::MIN };
        let mut noted = Noted { local, tolerances: Vec::new() };
        let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
        let mut evaluator = evaluator.with_solver(&mut noted);
        if let Some(tolerance) = tolerance {
            evaluator = evaluator.with_tolerance(tolerance).unwrap();
        }
        let solved = evaluator.evaluate(&set, None).unwrap();
        drop(evaluator);
        let requested = tolerance.unwrap_or(SOLVE_TOLERANCE);
        assert_eq!(noted.tolerances, [requested]);
        assert!(
            solved.plan.certificate.excess <= requested * solved.cost,
            "{requested}: {:?}",
            solved.plan.certificate
        );
    }
    for tolerance in [0.0, -1e-6, 2e-3, f64::NAN, f64::INFINITY] {
        let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
        assert!(evaluator.with_tolerance(tolerance).is_err(), "{tolerance}");
    }
}

fn methods() -> Vec<Method> {
    vec![
        Method::Equidistant,
        Method::Class(class_solution(BEAMS)),
        Method::Random,
        Method::Greedy,
        Method::Exchange(Vec::new()),
        Method::Annealing,
        Method::ColumnGeneration,
        Method::Prior,
        Method::Search(SearchOptions::default()),
        Method::Search(SearchOptions { price: 0.0, plies: 2, noise: 0.25, ..SearchOptions::default() }),
        Method::Game(BeamGame::Construction),
        Method::Game(BeamGame::Alternating { depth: 2 }),
    ]
}

fn ring() -> Ring {
    Ring::new(90, 5).unwrap()
}

fn run(method: &Method, solves: usize, threads: usize) -> (Choice, Vec<Progress>, usize) {
    let (matrices, goals) = disc();
    let mut reported = Vec::new();
    let (choice, prices) = {
        let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves });
        let mut evaluator = evaluator
            .with_threads(NonZeroUsize::new(threads).unwrap())
            .with_progress(|progress| reported.push(progress.clone()));
        let choice = choose(method, &mut evaluator, None, 7).unwrap();
        (choice, evaluator.prices())
    };
    (choice, reported, prices)
}

#[test]
fn every_method_keeps_to_the_budget_and_to_the_separation() {
    for method in methods() {
        let (choice, reported, _) = run(&method, 30, 1);
        assert!(
            reported.len() <= 30 && (choice.spent || reported.len() < 30 || method == Method::Random),
            "{method:?}"
        );
        assert_eq!(choice.best.beams.beams().len(), BEAMS);
        let best = reported.last().unwrap().best;
        assert_eq!(best, choice.best.cost, "{method:?}");
        for (i, progress) in reported.iter().enumerate() {
            assert_eq!(progress.solves, i + 1);
            assert!(ring().set(progress.beams.beams()).is_ok());
            assert!(i == 0 || progress.best <= reported[i - 1].best);
            assert!(
                reported[..i].iter().all(|earlier| earlier.beams != progress.beams),
                "{method:?} solves a set twice"
            );
        }
        assert!(choice.best.plan.certificate.relative_excess() < 1e-3, "{method:?} is not a solve");
    }
}

#[test]
fn methods_that_go_on_end_exactly_at_the_budget() {
    let search = Method::Search(SearchOptions::default());
    for method in [Method::Random, Method::Exchange(Vec::new()), Method::Annealing, search] {
        let (choice, reported, _) = run(&method, 17, 2);
        assert!(choice.spent && reported.len() == 17, "{method:?}: {}", reported.len());
    }
}

#[test]
fn every_method_gives_the_same_bytes_for_any_number_of_threads() {
    for method in methods() {
        let (one, told_one, prices_one) = run(&method, 12, 1);
        let (three, told_three, prices_three) = run(&method, 12, 3);
        assert_eq!((told_one, prices_one), (told_three, prices_three), "{method:?}");
        let bits = |choice: &Choice| choice.best.plan.weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&one), bits(&three), "{method:?}");
    }
}

/// The methods that look ahead, each with the most sets of a leaf.
fn looking_ahead() -> [(Method, usize); 2] {
    [(Method::Search(SearchOptions::default()), 1), (Method::Exchange(Vec::new()), 2)]
}

/// Every solve of a search with so many leaves under way, its prices, and the bits of the best plan.
fn wide(method: &Method, leaves: usize, threads: usize, solves: usize) -> (Vec<Progress>, usize, Vec<u64>) {
    let (matrices, goals) = disc();
    let [leaves, threads] = [leaves, threads].map(|n| NonZeroUsize::new(n).unwrap());
    let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves });
    let mut evaluator = evaluator.with_threads(threads).with_leaves(leaves);
    let choice = choose(method, &mut evaluator, None, 7).unwrap();
    let bits = choice.best.plan.weights.iter().map(|w| w.to_bits()).collect();
    (evaluator.history().to_vec(), evaluator.prices(), bits)
}

#[test]
fn the_number_of_leaves_decides_the_course_of_a_search_and_threads_do_not() {
    for (method, _) in looking_ahead() {
        let courses = [1, 4, 8].map(|leaves| {
            let one = wide(&method, leaves, 1, 40);
            assert_eq!(one.0.len(), 40, "{method:?}: what is begun counts");
            assert_eq!(one, wide(&method, leaves, 4, 40), "{method:?} with {leaves} leaves");
            let sets: BTreeSet<&BeamSet> = one.0.iter().map(|progress| &progress.beams).collect();
            assert_eq!(sets.len(), 40, "{method:?} solves a set twice");
            one.0
        });
        assert!(courses[0] != courses[1] && courses[1] != courses[2], "{method:?}");
    }
}

#[test]
fn as_many_leaves_are_in_progress_as_are_allowed_and_they_are_taken_in_their_order() {
    let (matrices, goals) = disc();
    for (method, sets) in looking_ahead() {
        for leaves in [1, 4, 8] {
            let local = Local { influence: &matrices[..], goals: &goals, threads: NonZeroUsize::MIN };
            let mut ahead = Ahead { local, begun: Vec::new(), most: 0 };
            let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 60 });
            let evaluator = evaluator.with_leaves(NonZeroUsize::new(leaves).unwrap());
            choose(&method, &mut evaluator.with_solver(&mut ahead), None, 7).unwrap();
            assert!(ahead.begun.is_empty(), "{method:?}: all that is begun is taken");
            // Five sets without a beam at first, and then two replacements of each.
            assert!((leaves..=sets * leaves).contains(&ahead.most), "{method:?}: {} of {leaves}", ahead.most);
        }
    }
}

#[test]
fn a_search_that_looks_ahead_pauses_and_goes_on_with_its_memo() {
    let (matrices, goals) = disc();
    for (method, _) in looking_ahead() {
        let (whole, ..) = wide(&method, 4, 1, 30);
        let mut memo = Memo::default();
        for pause in [3, 10, 11, 30] {
            let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 30 });
            let mut evaluator =
                evaluator.with_leaves(NonZeroUsize::new(4).unwrap()).with_pause(pause).with_memo(memo);
            let _ = choose(&method, &mut evaluator, None, 7);
            assert_eq!(evaluator.history(), &whole[..pause], "{method:?}");
            memo = evaluator.into_memo();
        }
    }
}

#[test]
fn search_pays_on_the_disc() {
    let cost = |method| run(&method, 60, 2).0.best.cost;
    let (random, greedy) = (cost(Method::Random), cost(Method::Greedy));
    let (exchange, equidistant) = (cost(Method::Exchange(Vec::new())), cost(Method::Equidistant));
    assert!(
        exchange <= greedy && exchange < random && exchange < equidistant,
        "{exchange} {greedy} {random} {equidistant}"
    );
    assert!(cost(Method::ColumnGeneration) <= greedy && cost(Method::Annealing) <= greedy);
}

#[test]
fn exchange_begins_at_the_given_sets_and_prices_beside_the_four_that_stay() {
    let starts = vec![vec![0.0, 72.0, 144.0, 216.0, 288.0], vec![20.0, 100.0, 180.0, 260.0, 324.0]];
    let (choice, reported, _) = run(&Method::Exchange(starts.clone()), 40, 1);
    let angles =
        |i: usize| reported[i].beams.beams().iter().map(|b| ring().angle_deg(*b)).collect::<Vec<_>>();
    assert_eq!([angles(0), angles(1)], [starts[0].clone(), starts[1].clone()]);
    let first = reported[0].cost.min(reported[1].cost);
    assert_eq!(reported[2].beams.beams().len(), BEAMS - 1, "the set without one beam is solved");
    for replaced in &reported[3..5] {
        assert!(reported[2].beams.beams().iter().all(|beam| replaced.beams.beams().contains(beam)));
    }
    assert!(choice.spent && choice.best.cost < first, "{} {first}", choice.best.cost);
    let wrong = Method::Exchange(vec![vec![0.0, 90.0]]);
    let (matrices, goals) = disc();
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 9 });
    assert!(choose(&wrong, &mut evaluator, None, 1).is_err());
}

#[test]
fn greedy_takes_a_solve_for_each_beam_and_counts_its_prices() {
    let (choice, reported, prices) = run(&Method::Greedy, 100, 1);
    assert!(!choice.spent);
    assert_eq!(reported.len(), BEAMS);
    // 90 beams, then those of the other rounds that keep their distance.
    assert!((90 + 81..=90 * BEAMS).contains(&prices), "{prices}");
}

#[test]
fn a_budget_too_small_for_a_plan_is_said() {
    let (matrices, goals) = disc();
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 3 });
    let message = choose(&Method::Greedy, &mut evaluator, None, 1).err().unwrap().to_string();
    assert!(message.contains("3 solves are too few for a plan of 5 beams"), "{message}");
}

#[test]
fn warm_starts_end_at_the_cost_of_cold_ones() {
    let (matrices, goals) = disc();
    let evaluator = || Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 20 });
    let (mut one, mut other) = (evaluator(), evaluator());
    let near = one.evaluate(&ring().set(&[0, 18, 36, 54, 72]).unwrap(), None).unwrap();
    for last in 73..80 {
        let set = ring().set(&[0, 18, 36, 54, last]).unwrap();
        let (warm, cold) = (one.evaluate(&set, Some(&near)).unwrap(), other.evaluate(&set, None).unwrap());
        assert!((warm.cost / cold.cost - 1.0).abs() < 1e-6, "{} {}", warm.cost, cold.cost);
    }
}

#[test]
fn a_set_is_solved_once() {
    let (matrices, goals) = disc();
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
    let set = ring().set(&[0, 18, 36, 54, 72]).unwrap();
    let cost = evaluator.evaluate(&set, None).unwrap().cost;
    assert_eq!(evaluator.evaluate(&set, None).unwrap().cost, cost);
    assert_eq!((evaluator.solves(), evaluator.solves_left()), (1, 0));
    assert_eq!(evaluator.evaluate(&ring().set(&[1]).unwrap(), None).err(), Some(Stop::Spent));
}

#[test]
fn rotations_of_equal_beams_are_all_there_once() {
    for (beams, turns) in [(5, 18), (9, 10), (7, 13)] {
        let sets = rotations(ring(), beams).unwrap();
        assert_eq!(sets.len(), turns);
        assert!(sets.iter().enumerate().all(|(i, set)| !sets[..i].contains(set)));
    }
}

#[test]
fn random_sets_come_up_equally_often() {
    let ring = Ring::new(12, 3).unwrap();
    let all = ring.sets(3).unwrap() as usize;
    let mut counts = BTreeMap::new();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let draws = 2000 * all;
    for _ in 0..draws {
        *counts.entry(random_set(ring, 3, &mut rng).unwrap()).or_insert(0_usize) += 1;
    }
    assert_eq!(counts.len(), all);
    // Five standard deviations of a binomial count.
    assert!(counts.values().all(|n| n.abs_diff(2000) < 5 * 45), "{counts:?}");
}

#[test]
fn search_improves_on_its_start_and_follows_the_best_set() {
    let options =
        SearchOptions { starts: vec![vec![0.0, 72.0, 144.0, 216.0, 288.0]], ..SearchOptions::default() };
    let (choice, reported, prices) = run(&Method::Search(options.clone()), 60, 1);
    assert_eq!(reported[0].beams.beams(), [0, 18, 36, 54, 72]);
    assert_eq!(reported[1].beams.beams().len(), BEAMS - 1, "a set without one beam is solved and priced");
    assert!(
        prices > 0 && choice.best.cost < 0.99 * reported[0].cost,
        "{} {}",
        choice.best.cost,
        reported[0].cost
    );
    // Each set is a move from a set that was solved before: one beam less, or another one in its place.
    let told_of = |from: &BeamSet| reported.iter().position(|earlier| earlier.beams == *from);
    let moved = |to: &BeamSet, from: &BeamSet| {
        to.beams().iter().filter(|beam| !from.beams().contains(beam)).count() <= 1
    };
    for (place, progress) in reported.iter().enumerate().filter(|(_, progress)| progress.from.is_some()) {
        let from = progress.from.as_ref().unwrap();
        assert!(told_of(from).unwrap() < place && moved(&progress.beams, from), "{progress:?}");
    }
    assert!(reported.iter().filter(|progress| progress.from.is_none()).count() < 10);
    // Without prices no smaller set is solved, and nothing is priced.
    let plain = SearchOptions { price: 0.0, ..options };
    let (choice, reported, prices) = run(&Method::Search(plain), 60, 1);
    assert!(prices == 0 && reported.iter().all(|progress| progress.beams.beams().len() == BEAMS));
    assert!(choice.best.cost <= reported[0].cost);
}

#[test]
fn a_prior_that_knows_the_best_set_is_followed() {
    let best = run(&Method::Exchange(Vec::new()), 120, 2).0.best;
    let (matrices, goals) = disc();
    let prior = Knows(best.beams.beams().to_vec());
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 12 });
    // One beam of the best set is another one at first.
    let others = &best.beams.beams()[1..];
    let wrong = *ring()
        .legal(others)
        .iter()
        .max_by_key(|beam| ring().steps_between(**beam, best.beams.beams()[0]))
        .unwrap();
    let start = [others, &[wrong]].concat().iter().map(|beam| ring().angle_deg(*beam)).collect();
    let options =
        SearchOptions { starts: vec![start], price: 0.0, prior: 2.0, c: 4.0, ..SearchOptions::default() };
    let found = choose(&Method::Search(options), &mut evaluator, Some(&prior), 1).unwrap().best;
    assert!(evaluator.history()[0].cost > best.cost);
    assert_eq!(found.beams, best.beams);
    let mut evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, Budget { solves: 1 });
    let built = choose(&Method::Prior, &mut evaluator, Some(&prior), 1).unwrap().best;
    assert_eq!(built.beams, best.beams);
}

/// Knows the beams of a set.
struct Knows(Vec<u16>);

impl Prior for Knows {
    fn scores(&self, _: Ring, _: &[u16], candidates: &[u16]) -> Vec<f64> {
        candidates.iter().map(|beam| f64::from(u8::from(self.0.contains(beam)))).collect()
    }
}

#[test]
fn a_search_in_parts_takes_the_way_of_the_whole() {
    let (matrices, goals) = disc();
    let exchange = Method::Exchange(Vec::new());
    for method in [Method::Search(SearchOptions::default()), exchange, Method::Annealing, Method::Random] {
        let (_, whole, _) = run(&method, 23, 1);
        let mut memo = Memo::default();
        for solves in [1, 4, 5, 9, 23] {
            let budget = Budget { solves: 23 };
            let evaluator = Evaluator::new(&matrices[..], &goals, ring(), BEAMS, budget);
            let mut evaluator = evaluator.with_memo(memo).with_pause(solves);
            let _ = choose(&method, &mut evaluator, None, 7);
            let (part, direction) = (evaluator.history(), &whole[..solves]);
            assert_eq!(part.len(), solves, "{method:?}");
            // Prices that were asked for just before a pause are counted then.
            let seen = |p: &Progress| (p.solves, p.beams.clone(), p.cost, p.best);
            assert!(
                part.iter().map(seen).eq(direction.iter().map(seen)),
                "{method:?}: {part:?} {direction:?}"
            );
            memo = evaluator.into_memo();
        }
    }
}
