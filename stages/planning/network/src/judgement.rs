//! What the network says of the sets of a case, and the sets of the best value.

use std::collections::BTreeSet;

use stillpoint_plan::beams::{BeamSet, Prior, Ring, RingError, rotations};

/// Weight of the policy beside the value where beams are scored. Both are in units in which the network was trained.
const POLICY_WEIGHT: f64 = 0.02;

/// Numbers for each angle and each pair of angles, from which the value of every set and the policy beside every set follow.
///
/// The value of a set is the mean over its beams plus the mean over its pairs plus what a perceptron says of the whole set: it
/// stands for `ln(cost / reference)`, with a reference that is the same for all sets of a case, so that less is better. The
/// logit of a beam beside a set is its number plus the mean over the pairs that it makes.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// For each angle: for the value, for the policy.
    single: Vec<[f32; 2]>,
    /// For each pair `a * angles + b`.
    pair: Vec<[f32; 2]>,
    set: SetHead,
}

/// The perceptron over a set: its hidden layer is the rectified sum of a bias, the mean over beams and the mean over pairs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SetHead {
    /// One for each hidden unit.
    pub bias: Vec<f32>,
    /// Weights of the hidden units in the value.
    pub out: Vec<f32>,
    /// For each angle what it adds to each unit.
    pub angles: Vec<f32>,
    /// The same for each pair `a * angles + b`.
    pub pairs: Vec<f32>,
}

impl SetHead {
    fn value(&self, set: &[usize], angles: usize) -> f64 {
        let width = self.bias.len();
        let mut hidden = self.bias.clone();
        let mut add = |from: &[f32], place: usize, part: f32| {
            let of = &from[width * place..width * (place + 1)];
            hidden.iter_mut().zip(of).for_each(|(sum, value)| *sum += part * value);
        };
        let (beams, pairs) = shares(set.len());
        for (place, a) in set.iter().enumerate() {
            add(&self.angles, *a, beams as f32);
            set[..place].iter().for_each(|b| add(&self.pairs, a * angles + b, pairs as f32));
        }
        hidden.iter().zip(&self.out).map(|(h, out)| f64::from(h.max(0.0) * out)).sum()
    }
}

/// What a beam and what a pair is of a set of so many beams.
fn shares(beams: usize) -> (f64, f64) {
    let count = beams as f64;
    (1.0 / count.max(1.0), 1.0 / (0.5 * count * (count - 1.0)).max(1.0))
}

impl Judgement {
    pub(crate) fn new(single: Vec<[f32; 2]>, pair: Vec<[f32; 2]>, set: SetHead) -> Self {
        Self { single, pair, set }
    }

    /// Angles.
    pub fn angles(&self) -> usize {
        self.single.len()
    }

    /// Numbers of each angle: for the value, for the policy.
    pub fn single(&self) -> &[[f32; 2]] {
        &self.single
    }

    /// Numbers of each pair `a * angles + b`: for the value, for the policy.
    pub fn pair(&self) -> &[[f32; 2]] {
        &self.pair
    }

    /// The value of a set of angles: less is better.
    pub fn value(&self, set: &[usize]) -> f64 {
        let (of_beam, of_pair) = shares(set.len());
        let singles: f64 = set.iter().map(|a| f64::from(self.single[*a][0])).sum();
        let mut pairs = 0.0;
        for (place, a) in set.iter().enumerate() {
            pairs += set[..place].iter().map(|b| f64::from(self.pair_of(*a, *b)[0])).sum::<f64>();
        }
        of_beam * singles + of_pair * pairs + self.set.value(set, self.angles())
    }

    /// The logit of the policy: of adding an angle to those that are kept. More is better.
    pub fn logit(&self, angle: usize, retained: &[usize]) -> f64 {
        let pairs: f64 = retained.iter().map(|b| f64::from(self.pair_of(angle, *b)[1])).sum();
        f64::from(self.single[angle][1]) + pairs / retained.len().max(1) as f64
    }

    /// Both heads together, for a beam that is added to those that are kept. More is better.
    pub fn score(&self, angle: usize, retained: &[usize]) -> f64 {
        let with: Vec<usize> = retained.iter().copied().chain([angle]).collect();
        // Of a mean over more beams, one beam is a smaller part.
        let share = with.len() as f64;
        POLICY_WEIGHT * self.logit(angle, retained) - share * self.value(&with)
    }

    fn pair_of(&self, a: usize, b: usize) -> [f32; 2] {
        self.pair[a * self.single.len() + b]
    }

    /// The angle of the network that is nearest to a beam of a ring.
    pub fn angle_of(&self, ring: Ring, beam: u16) -> usize {
        let part = ring.angle_deg(beam) / 360.0 * self.angles() as f64;
        part.round() as usize % self.angles()
    }

    /// The `most` sets of so many beams that have the best value, the best first.
    ///
    /// From rotations of equal beams and from the policy's own set, beams are exchanged one by one as long as
    /// the value improves. It is a local search: a better set can exist.
    pub fn best_sets(&self, ring: Ring, beams: usize, most: usize) -> Result<Vec<BeamSet>, RingError> {
        let mut starts = rotations(ring, beams)?;
        starts.extend(self.by_policy(ring, beams));
        let mut found: BTreeSet<BeamSet> = BTreeSet::new();
        for start in starts {
            let mut now = start.beams().to_vec();
            while let Some(next) = self.better(ring, &now) {
                now = next;
            }
            found.insert(ring.set(&now)?);
            // Beside the best set its neighbours are good, too.
            for slot in 0..now.len() {
                let mut others = now.clone();
                others.remove(slot);
                let mut list: Vec<BeamSet> = ring
                    .legal(&others)
                    .into_iter()
                    .filter_map(|beam| ring.set(&[&others[..], &[beam]].concat()).ok())
                    .collect();
                list.sort_by(|a, b| self.of(ring, a.beams()).total_cmp(&self.of(ring, b.beams())));
                list.truncate(most);
                found.extend(list);
            }
        }
        let mut all: Vec<(f64, BeamSet)> =
            found.into_iter().map(|set| (self.of(ring, set.beams()), set)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        Ok(all.into_iter().take(most).map(|(_, set)| set).collect())
    }

    /// At most `most` sets of good value that differ: of each two, a beam of one is at least `apart` steps from all beams of
    /// the other. The set of the best value is the first.
    ///
    /// # Errors
    /// So many beams do not fit.
    pub fn spread_sets(
        &self,
        ring: Ring,
        beams: usize,
        most: usize,
        apart: u16,
    ) -> Result<Vec<BeamSet>, RingError> {
        let mut chosen: Vec<BeamSet> = Vec::new();
        for set in self.best_sets(ring, beams, usize::MAX)? {
            let differs = |other: &BeamSet| {
                let far = |a: &u16| other.beams().iter().all(|b| ring.steps_between(*a, *b) >= apart);
                set.beams().iter().any(far)
            };
            if chosen.iter().all(differs) {
                chosen.push(set);
            }
            if chosen.len() == most {
                break;
            }
        }
        Ok(chosen)
    }

    fn of(&self, ring: Ring, beams: &[u16]) -> f64 {
        let angles: Vec<usize> = beams.iter().map(|beam| self.angle_of(ring, *beam)).collect();
        self.value(&angles)
    }

    /// The set that the policy builds, beam by beam.
    fn by_policy(&self, ring: Ring, beams: usize) -> Option<BeamSet> {
        let mut retained: Vec<u16> = Vec::new();
        while retained.len() < beams {
            let legal = ring.legal(&retained);
            let angles: Vec<usize> = retained.iter().map(|beam| self.angle_of(ring, *beam)).collect();
            let logit = |beam: &u16| self.logit(self.angle_of(ring, *beam), &angles);
            let best = legal.into_iter().max_by(|a, b| logit(a).total_cmp(&logit(b)))?;
            retained.push(best);
        }
        ring.set(&retained).ok()
    }

    /// The best exchange of one beam that improves the value.
    fn better(&self, ring: Ring, now: &[u16]) -> Option<Vec<u16>> {
        let mut best: Option<(f64, Vec<u16>)> = None;
        let at = self.of(ring, now);
        for slot in 0..now.len() {
            let mut others = now.to_vec();
            others.remove(slot);
            for beam in ring.legal(&others) {
                let set = [&others[..], &[beam]].concat();
                let value = self.of(ring, &set);
                if value < best.as_ref().map_or(at - 1e-9, |(value, _)| *value) {
                    best = Some((value, set));
                }
            }
        }
        best.map(|(_, set)| set)
    }
}

impl Prior for Judgement {
    fn scores(&self, ring: Ring, retained: &[u16], candidates: &[u16]) -> Vec<f64> {
        let retained: Vec<usize> = retained.iter().map(|beam| self.angle_of(ring, *beam)).collect();
        candidates.iter().map(|beam| self.score(self.angle_of(ring, *beam), &retained)).collect()
    }
}
