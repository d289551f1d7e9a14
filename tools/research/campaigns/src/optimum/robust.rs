//! The robust game against the nominal one: beams that are chosen for the worst set-up error of a list, and for none.

use std::num::NonZeroUsize;

use stillpoint::Failure;
use stillpoint_plan::Rows;
use stillpoint_plan::beams::{
    Budget, Evaluated, Evaluator, Local, Method, SearchOptions, SecondPlayer, Solver as _, choose,
};
use stillpoint_plan::fluence::Goals;

use super::compare::cpu_seconds;
use super::failed;
use super::paired::Paired;
use super::subject::Subject;

/// The same number of answers and solves is timed so often.
const TIMED: usize = 10;

/// The methods that play both games.
const METHODS: [&str; 2] = ["exchange", "search"];

/// What the plan of a patient costs: as planned, and under the worst error.
struct Cost {
    planned: f64,
    worst: f64,
}

/// One method for one patient after so many solves, nominal and robust.
struct Pair {
    method: &'static str,
    solves: usize,
    nominal: Cost,
    robust: Cost,
    same: bool,
}

#[derive(Default)]
pub struct Robust {
    pairs: Vec<Pair>,
    /// For each patient: CPU-seconds of an answer to one error over those of a solve.
    shares: Vec<f64>,
}

impl Robust {
    /// Plays both games for a patient, with shifts of so many mm along each axis, both ways.
    pub fn play(
        &mut self,
        subject: &Subject,
        beams: usize,
        shift_mm: f64,
        at: &[usize],
    ) -> Result<(), Failure> {
        let [moving, still] = subject.problem.parts().map_err(Failure::failed)?;
        let mut doses: Vec<Vec<Rows>> = Vec::new();
        for axis in 0..3 {
            for direction in [-shift_mm, shift_mm] {
                let mut moved = [0.0; 3];
                moved[axis] = direction;
                let found = subject.problem.displaced(subject.ring, moved, NonZeroUsize::MIN);
                doses.push(found.map_err(Failure::failed)?);
            }
        }
        let all = subject.problem.goals();
        let second = SecondPlayer { doses: &doses, moving: &moving, still: &still, all };
        for method in METHODS {
            for solves in at {
                let nominal = best(subject, method, beams, *solves, None)?;
                let robust = best(subject, method, beams, *solves, Some(&second))?;
                let cost = |plan: &Evaluated| -> Result<Cost, Failure> {
                    let (worst, _) = second.answer(plan).map_err(Failure::failed)?;
                    Ok(Cost { planned: plan.plan.certificate.objective, worst })
                };
                let pair = Pair {
                    method,
                    solves: *solves,
                    nominal: cost(&nominal)?,
                    robust: cost(&robust)?,
                    same: nominal.beams == robust.beams,
                };
                errln!(
                    "{}, {method}, {solves} solves: nominal {:.1}, worst {:.1}; robust {:.1}, worst {:.1}",
                    subject.name,
                    pair.nominal.planned,
                    pair.nominal.worst,
                    pair.robust.planned,
                    pair.robust.worst
                );
                self.pairs.push(pair);
            }
        }
        self.shares.push(share(subject, all, &second, beams)?);
        Ok(())
    }

    pub fn report(&self) {
        outln!(
            "| method | solves | worst case, robust against nominal: mean %, better:worse, sign test, Wilcoxon | as planned | same set |"
        );
        outln!("| --- | --- | --- | --- | --- |");
        let mut solves: Vec<usize> = self.pairs.iter().map(|pair| pair.solves).collect();
        solves.sort_unstable();
        solves.dedup();
        for method in METHODS {
            for solves in &solves {
                let of = || self.pairs.iter().filter(|pair| pair.method == method && pair.solves == *solves);
                let reported = |cost: fn(&Cost) -> f64| {
                    let over: Vec<f64> =
                        of().map(|pair| 100.0 * (cost(&pair.robust) / cost(&pair.nominal) - 1.0)).collect();
                    Paired::new(&over, &vec![0.0; over.len()]).reported()
                };
                outln!(
                    "| {method} | {solves} | {} | {} | {} of {} |",
                    reported(|cost| cost.worst),
                    reported(|cost| cost.planned),
                    of().filter(|pair| pair.same).count(),
                    of().count()
                );
            }
        }
        let over = |pair: &Pair| pair.nominal.worst / pair.nominal.planned;
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
        outln!(
            "the worst case of the nominal plans costs {:.2} times what they cost as planned; an answer to one error takes {:.3} of a solve",
            mean(self.pairs.iter().map(over).collect()),
            mean(self.shares.clone())
        );
    }
}

/// The best plan of a game within so many solves; answers are counted.
fn best(
    subject: &Subject,
    method: &str,
    beams: usize,
    solves: usize,
    second: Option<&SecondPlayer<'_>>,
) -> Result<Evaluated, Failure> {
    let goals = subject.problem.goals();
    let mut evaluator = Evaluator::new(&subject.doses[..], goals, subject.ring, beams, Budget { solves });
    if let Some(second) = second {
        evaluator = evaluator.against(second);
    }
    let starts = subject.class.clone();
    let method = match method {
        "exchange" => Method::Exchange(starts),
        _ => Method::Search(SearchOptions { starts, ..SearchOptions::default() }),
    };
    let found = choose(&method, &mut evaluator, None, 0).map_err(|e| failed(e.into()))?;
    Ok(Evaluated::clone(&found.best))
}

/// CPU-seconds of an answer to one error over those of a solve that begins at a neighbouring set.
fn share(subject: &Subject, goals: &Goals, second: &SecondPlayer<'_>, beams: usize) -> Result<f64, Failure> {
    let rotations = stillpoint_plan::beams::rotations(subject.ring, beams).map_err(Failure::failed)?;
    let mut local = Local { influence: &subject.doses[..], goals, threads: NonZeroUsize::MIN };
    let (mut near, mut solving, mut answering): (Option<Evaluated>, f64, f64) = (None, 0.0, 0.0);
    for set in rotations.iter().take(TIMED) {
        let began = cpu_seconds();
        let solved = local.solve(&[set], near.as_ref(), 1e-6).map_err(|e| failed(e.into()))?;
        let solved_at = cpu_seconds();
        near = solved.into_iter().next();
        if let Some(plan) = &near {
            second.answer(plan).map_err(Failure::failed)?;
        }
        (solving, answering) = (solving + solved_at - began, answering + cpu_seconds() - solved_at);
    }
    Ok(answering / second.doses.errors() as f64 / solving)
}
