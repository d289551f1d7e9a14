//! Priors: what is thought of a beam before any set with it is solved.

use thiserror::Error;

use super::greedy::leaves_room;
use super::ring::{BeamSet, Ring, RingError};

/// Passes over the beams of a set after its construction.
const PASSES: usize = 4;

/// Scores of candidate beams beside the beams that stay: finite, higher is better, one per candidate, the same for the same input.
pub trait Prior: Send + Sync {
    /// The scores, in the order of the candidates.
    fn scores(&self, ring: Ring, retained: &[u16], candidates: &[u16]) -> Vec<f64>;
}

/// Every beam is as good as any other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uniform;

impl Prior for Uniform {
    fn scores(&self, _: Ring, _: &[u16], candidates: &[u16]) -> Vec<f64> {
        vec![0.0; candidates.len()]
    }
}

/// Given angles, as for a class of patients: the score is minus the distance, degrees, to the nearest angle that no kept
/// beam stands for. A kept beam stands for the angle nearest to it.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassAngles {
    /// The angles, degrees.
    pub degrees: Vec<f64>,
}

impl Prior for ClassAngles {
    fn scores(&self, ring: Ring, retained: &[u16], candidates: &[u16]) -> Vec<f64> {
        let mut open: Vec<u16> = self.degrees.iter().map(|angle| ring.nearest(*angle)).collect();
        for beam in retained {
            let near = (0..open.len()).min_by_key(|i| ring.steps_between(open[*i], *beam));
            near.map(|near| open.remove(near));
        }
        let steps = |beam: u16| open.iter().map(|angle| ring.steps_between(*angle, beam)).min().unwrap_or(0);
        candidates.iter().map(|beam| -f64::from(steps(*beam)) * ring.step_deg()).collect()
    }
}

/// Several priors with a weight each: the sum of their weighted scores, each brought to mean 0 and deviation 1.
#[derive(Default)]
pub struct Mixture<'a> {
    /// Weights and priors.
    pub parts: Vec<(f64, Box<dyn Prior + 'a>)>,
}

impl Prior for Mixture<'_> {
    fn scores(&self, ring: Ring, retained: &[u16], candidates: &[u16]) -> Vec<f64> {
        let mut sum = vec![0.0; candidates.len()];
        for (weight, prior) in &self.parts {
            let scores = standardised(&prior.scores(ring, retained, candidates));
            sum.iter_mut().zip(scores).for_each(|(sum, score)| *sum += weight * score);
        }
        sum
    }
}

/// The reasons why a prior gives no set.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PriorError {
    /// So many beams do not fit.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// Another number of scores than of candidates.
    #[error("the prior gave {found} scores for {expected} candidates")]
    Count {
        /// Scores.
        found: usize,
        /// Candidates.
        expected: usize,
    },
    /// A score that cannot be compared.
    #[error("the prior gave beam {beam} the score {score}; scores must be finite")]
    Score {
        /// The beam.
        beam: u16,
        /// Its score.
        score: f64,
    },
}

/// The scores of a prior, checked.
pub fn checked_scores(
    prior: &dyn Prior,
    ring: Ring,
    retained: &[u16],
    candidates: &[u16],
) -> Result<Vec<f64>, PriorError> {
    let scores = prior.scores(ring, retained, candidates);
    if scores.len() != candidates.len() {
        return Err(PriorError::Count { found: scores.len(), expected: candidates.len() });
    }
    match candidates.iter().zip(&scores).find(|(_, score)| !score.is_finite()) {
        Some((beam, score)) => Err(PriorError::Score { beam: *beam, score: *score }),
        None => Ok(scores),
    }
}

/// The set of `beams` that a prior builds, without a solve.
///
/// Beams are added one by one, each time the legal one of the highest score. Then each beam in turn is chosen again beside
/// the others, at most four times over, until the set stays. Among equal scores the beam farthest from those that stay is
/// taken, then the lowest.
pub fn set_of_prior(prior: &dyn Prior, ring: Ring, beams: usize) -> Result<BeamSet, PriorError> {
    ring.check_room(beams)?;
    let mut chosen: Vec<u16> = Vec::new();
    while chosen.len() < beams {
        let room = |beam: &u16| leaves_room(ring, &[&chosen[..], &[*beam]].concat(), beams);
        let legal: Vec<u16> = ring.legal(&chosen).into_iter().filter(room).collect();
        let Some(beam) = highest(prior, ring, &chosen, &legal)? else { break };
        chosen.push(beam);
    }
    for _ in 0..PASSES {
        let before = ring.set(&chosen)?;
        for slot in 0..chosen.len() {
            let mut retained = chosen.clone();
            retained.remove(slot);
            if let Some(beam) = highest(prior, ring, &retained, &ring.legal(&retained))? {
                chosen[slot] = beam;
            }
        }
        if ring.set(&chosen)? == before {
            break;
        }
    }
    Ok(ring.set(&chosen)?)
}

fn highest(
    prior: &dyn Prior,
    ring: Ring,
    retained: &[u16],
    candidates: &[u16],
) -> Result<Option<u16>, PriorError> {
    let scores = checked_scores(prior, ring, retained, candidates)?;
    let apart = |beam: u16| retained.iter().map(|other| ring.steps_between(beam, *other)).min().unwrap_or(0);
    let scored = candidates.iter().copied().zip(scores);
    let better = |a: (u16, f64), b: (u16, f64)| {
        let order = b.1.total_cmp(&a.1).then(apart(b.0).cmp(&apart(a.0)));
        if order.is_gt() { b } else { a }
    };
    Ok(scored.reduce(better).map(|(beam, _)| beam))
}

/// Values with their mean taken off, in units of their standard deviation; zeros where they are all equal.
pub fn standardised(values: &[f64]) -> Vec<f64> {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let deviation = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt();
    // Rounding of equal values is no difference.
    let none = deviation <= 1e-12 * mean.abs();
    values.iter().map(|v| if none { 0.0 } else { (v - mean) / deviation }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring() -> Ring {
        Ring::new(90, 5).unwrap()
    }

    #[test]
    fn class_angles_give_their_own_set() {
        let prior = ClassAngles { degrees: vec![44.0, 92.0, 120.0, 252.0, 336.0] };
        assert_eq!(set_of_prior(&prior, ring(), 5).unwrap().beams(), [11, 23, 30, 63, 84]);
        // Beside four of them the fifth is best.
        let scores = prior.scores(ring(), &[11, 24, 63, 84], &[10, 30, 40]);
        assert!(scores[1] > scores[2] && scores[2] > scores[0], "{scores:?}");
    }

    #[test]
    fn the_uniform_prior_spreads_its_beams() {
        let set = set_of_prior(&Uniform, ring(), 5).unwrap();
        let beams = set.beams();
        let least = (0..5).map(|i| ring().steps_between(beams[i], beams[(i + 1) % 5])).min();
        assert!(least.unwrap() >= 11, "{beams:?}");
    }

    #[test]
    fn sets_of_crowded_rings_are_legal() {
        for beams in 1..=18 {
            let set = set_of_prior(&Uniform, ring(), beams).unwrap();
            assert_eq!(set.beams().len(), beams);
        }
        assert!(matches!(set_of_prior(&Uniform, ring(), 19), Err(PriorError::Ring(_))));
    }

    #[test]
    fn a_mixture_weighs_its_parts() {
        let (one, other) = (ClassAngles { degrees: vec![0.0] }, ClassAngles { degrees: vec![180.0] });
        let mixture =
            Mixture { parts: vec![(1.0, Box::new(one)), (0.2, Box::new(other)), (1.0, Box::new(Uniform))] };
        assert_eq!(set_of_prior(&mixture, ring(), 1).unwrap().beams(), [0]);
    }

    #[test]
    fn wrong_scores_are_refused() {
        struct Wrong(Vec<f64>);
        impl Prior for Wrong {
            fn scores(&self, _: Ring, _: &[u16], _: &[u16]) -> Vec<f64> {
                self.0.clone()
            }
        }
        let of = |scores: Vec<f64>| set_of_prior(&Wrong(scores), ring(), 5).unwrap_err().to_string();
        assert_eq!(of(vec![1.0]), "the prior gave 1 scores for 90 candidates");
        assert!(of(vec![f64::NAN; 90]).contains("must be finite"));
    }
}
