//! How beams are chosen, with its only validation.

use std::num::NonZeroUsize;
use std::sync::Arc;

use stillpoint_patient::case::Case;
use thiserror::Error;

use super::name::{MethodName, PriorName};
use super::search::{LearnedBeams, PlanSearch};
use crate::beams::{
    BeamGame, ClassAngles, Directions, Geometry, Method, Mixture, Prior, Ring, RingError, SearchOptions,
    Uniform, class_solution, pelvis_solutions,
};
use crate::dose::BeamAngles;

/// Most solves of a method, if nothing else is requested.
pub const BUDGET: usize = 40;
/// The same of the method `network`.
pub const PROPOSALS: usize = 5;

/// Exchanges of the game of two players.
const EXCHANGES: usize = 2;
/// Most leaves that a search may have under way.
pub const MOST_LEAVES: usize = 64;

/// How the beams of a plan are chosen.
#[derive(Clone, Debug)]
pub struct PlanRequest {
    /// The method.
    pub method: MethodName,
    /// What is known of a beam before it is solved, mixed in equal parts; for the methods that take a prior.
    pub priors: Vec<PriorName>,
    /// What a network says of the case; for the method and the prior `network`.
    pub network: Option<Arc<dyn LearnedBeams>>,
    /// Beams of the plan.
    pub beams: usize,
    /// Angles of the beams of the method `given`.
    pub angles: Vec<BeamAngles>,
    /// Most sets of beams that are solved.
    pub budget: usize,
    /// Leaves that the search may have under way: each is chosen when all results but those are in. For the methods that
    /// look ahead. A plan depends on it.
    pub leaves: usize,
    /// Seed of the random methods.
    pub seed: u64,
    /// Threads; no plan depends on them.
    pub threads: NonZeroUsize,
}

/// The reasons why a request cannot be planned.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RequestError {
    /// The beams do not fit on the ring.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// Nothing may be solved.
    #[error("invalid budget of solves: 0 (allow at least 1, and for some methods one for each beam)")]
    NoSolve,
    /// So many leaves cannot be under way.
    #[error("invalid number of leaves under way: {0} (allowed: 1 to {MOST_LEAVES})")]
    Leaves(usize),
    /// The method does not look ahead.
    #[error("the method {0} takes no number of leaves (methods that take one: exchange, search)")]
    TakesNoLeaves(MethodName),
    /// The method has no use for the prior.
    #[error("the method {0} takes no prior (methods that take one: search, prior, construction, two-player)")]
    TakesNoPrior(MethodName),
    /// The method `prior` has no prior that works without solves.
    #[error("the method prior needs a prior without solves (allowed: geometry, class, uniform, network)")]
    PricesAlone,
    /// The prior `class` has no angles.
    #[error("the prior class has no angles for {0} beams (allowed: 5, 7)")]
    NoClassAngles(usize),
    /// There is a network without use.
    #[error(
        "a network is the model of the method network and of the prior network: give one of them, too, or no network"
    )]
    UnusedNetwork,
    /// The network is missing.
    #[error("the method network and the prior network need a network, and there is none")]
    NoNetwork,
    /// Given angles are not among those that are listed.
    #[error("the beam at {0} degrees is not among the directions of this set-up")]
    NotListed(BeamAngles),
    /// A given angle is not on the ring.
    #[error("invalid gantry angle: {found} (angles must be multiples of {step_deg} degrees)")]
    Angle {
        /// The angles of the beam.
        found: BeamAngles,
        /// Degrees between two angles of the ring.
        step_deg: f64,
    },
    /// Angles and beams do not agree.
    #[error(
        "{angles} gantry angles are given for {beams} beams: the method given needs one for each beam, other methods none"
    )]
    Angles {
        /// Angles.
        angles: usize,
        /// Beams.
        beams: usize,
    },
}

impl Default for PlanRequest {
    /// Five beams by exchange.
    fn default() -> Self {
        Self::of_method(MethodName::Exchange)
    }
}

impl PlanRequest {
    /// Five beams by a method, with its usual budget, on one thread.
    pub fn of_method(method: MethodName) -> Self {
        Self {
            method,
            priors: vec![PriorName::Price],
            network: None,
            beams: 5,
            angles: Vec::new(),
            budget: Self::usual_budget(method),
            leaves: Self::USUAL_LEAVES,
            seed: 0,
            threads: NonZeroUsize::MIN,
        }
    }

    /// The beams of these angles: one solve. Numbers are gantry angles, degrees.
    pub fn of_angles(angles: Vec<impl Into<BeamAngles>>) -> Self {
        let angles: Vec<BeamAngles> = angles.into_iter().map(Into::into).collect();
        Self { beams: angles.len(), angles, ..Self::of_method(MethodName::Given) }
    }

    /// Most solves of a method, if nothing else is requested.
    pub fn usual_budget(method: MethodName) -> usize {
        if method == MethodName::Network { PROPOSALS } else { BUDGET }
    }

    /// Leaves that a method has under way, if nothing else is requested: one, by which most is known at each choice.
    pub const USUAL_LEAVES: usize = 1;

    /// Whether a network is needed.
    pub fn uses_network(&self) -> bool {
        self.method == MethodName::Network || self.priors.contains(&PriorName::Network)
    }

    /// The search for a case among directions of beams: those of a ring, or listed ones. This is the only validation of a request.
    ///
    /// # Errors
    /// A part of the request is out of range, or two parts contradict each other.
    pub fn check(&self, case: &Case, directions: impl Into<Directions>) -> Result<PlanSearch, RequestError> {
        let directions = directions.into();
        let ring = directions.ring();
        self.check_names()?;
        match (&self.network, self.uses_network()) {
            (Some(_), false) => return Err(RequestError::UnusedNetwork),
            (None, true) => return Err(RequestError::NoNetwork),
            _ => {}
        }
        ring.check_room(self.beams)?;
        let given = if self.method == MethodName::Given { self.beams } else { 0 };
        if self.angles.len() != given {
            return Err(RequestError::Angles { angles: self.angles.len(), beams: self.beams });
        }
        if let Some(found) = self.angles.iter().find(|angles| directions.beam(**angles).is_none()) {
            let found = *found;
            return Err(match directions.step_deg() {
                Some(step_deg) => RequestError::Angle { found, step_deg },
                None => RequestError::NotListed(found),
            });
        }
        Ok(PlanSearch {
            name: self.method,
            method: self.method_for(case, &directions)?,
            directions,
            beams: self.beams,
            budget: self.budget,
            leaves: NonZeroUsize::new(self.leaves).unwrap_or(NonZeroUsize::MIN),
            mixture: self.mixture(case, ring)?,
            seed: self.seed,
            threads: self.threads,
        })
    }

    /// What can be said without a case: names and budget.
    ///
    /// # Errors
    /// See [`PlanRequest::check`].
    pub fn check_names(&self) -> Result<(), RequestError> {
        if self.budget == 0 {
            return Err(RequestError::NoSolve);
        }
        if !(1..=MOST_LEAVES).contains(&self.leaves) {
            return Err(RequestError::Leaves(self.leaves));
        }
        if self.leaves > 1 && !self.method.looks_ahead() {
            return Err(RequestError::TakesNoLeaves(self.method));
        }
        let by_price = self.priors.iter().all(|prior| *prior == PriorName::Price);
        if !by_price && !self.method.takes_prior() {
            return Err(RequestError::TakesNoPrior(self.method));
        }
        if by_price && self.method == MethodName::Prior {
            return Err(RequestError::PricesAlone);
        }
        Ok(())
    }

    fn method_for(&self, case: &Case, directions: &Directions) -> Result<Method, RequestError> {
        let ring = directions.ring();
        // On a coarse ring the angles of a habit may fall together: then there is no such start.
        let is_legal = |angles: &Vec<f64>| {
            let beams: Vec<u16> = angles.iter().map(|angle| ring.nearest(*angle)).collect();
            ring.set(&beams).is_ok()
        };
        let starts = || match case.is_pelvis() {
            true => pelvis_solutions(self.beams).into_iter().filter(is_legal).collect(),
            false => Vec::new(),
        };
        Ok(match self.method {
            MethodName::Equidistant => Method::Equidistant,
            MethodName::Class => Method::Class(class_solution(self.beams)),
            MethodName::Given => Method::Sets(vec![directions.set_of(&self.angles)?]),
            MethodName::Random => Method::Random,
            MethodName::Greedy => Method::Greedy,
            MethodName::Exchange => Method::Exchange(starts()),
            MethodName::Annealing => Method::Annealing,
            MethodName::Columns => Method::ColumnGeneration,
            MethodName::Search => Method::Search(self.search_options(starts)),
            MethodName::Prior => Method::Prior,
            MethodName::Network => {
                let network = self.network.as_ref().ok_or(RequestError::NoNetwork)?;
                Method::Sets(network.proposals(ring, self.beams, self.budget)?)
            }
            MethodName::Construction => Method::Game(BeamGame::Construction),
            MethodName::TwoPlayer => Method::Game(BeamGame::Alternating { depth: EXCHANGES }),
        })
    }

    /// With prices alone the search begins where exchange does; with another prior at the set that the prior builds.
    fn search_options(&self, starts: impl Fn() -> Vec<Vec<f64>>) -> SearchOptions {
        let by_price = self.priors.contains(&PriorName::Price);
        let is_mixed = self.priors.iter().any(|prior| *prior != PriorName::Price);
        let starts = if is_mixed { Vec::new() } else { starts() };
        SearchOptions {
            starts: starts.into_iter().take(1).collect(),
            price: if by_price { 1.0 } else { 0.0 },
            prior: if is_mixed { 1.0 } else { 0.0 },
            ..SearchOptions::default()
        }
    }

    /// The mixture of the priors but for prices; none if none is left.
    fn mixture(&self, case: &Case, ring: Ring) -> Result<Option<Mixture<'static>>, RequestError> {
        let mut parts: Vec<(f64, Box<dyn Prior>)> = Vec::new();
        for name in &self.priors {
            let prior: Box<dyn Prior> = match name {
                PriorName::Price => continue,
                PriorName::Network => self.network.as_ref().ok_or(RequestError::NoNetwork)?.prior(),
                PriorName::Uniform => Box::new(Uniform),
                PriorName::Geometry => Box::new(Geometry::of_case(case, ring)),
                PriorName::Class => {
                    let degrees = pelvis_solutions(self.beams).into_iter().next();
                    let degrees = degrees.ok_or(RequestError::NoClassAngles(self.beams))?;
                    Box::new(ClassAngles { degrees })
                }
            };
            parts.push((1.0, prior));
        }
        Ok((!parts.is_empty()).then_some(Mixture { parts }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::phantom;

    fn refused(request: &PlanRequest) -> RequestError {
        request.check(&phantom(0).unwrap(), Ring::new(90, 5).unwrap()).err().unwrap()
    }

    #[test]
    fn a_request_that_contradicts_itself_is_refused_with_its_reason() {
        let of = PlanRequest::of_method;
        assert_eq!(refused(&PlanRequest { budget: 0, ..of(MethodName::Greedy) }), RequestError::NoSolve);
        let with = |method, prior| PlanRequest { priors: vec![prior], ..of(method) };
        assert_eq!(
            refused(&with(MethodName::Annealing, PriorName::Geometry)),
            RequestError::TakesNoPrior(MethodName::Annealing)
        );
        let wide = |method, leaves| PlanRequest { leaves, ..of(method) };
        for leaves in [0, MOST_LEAVES + 1] {
            assert_eq!(refused(&wide(MethodName::Search, leaves)), RequestError::Leaves(leaves));
        }
        let greedy = MethodName::Greedy;
        assert_eq!(refused(&wide(greedy, 2)), RequestError::TakesNoLeaves(greedy));
        assert_eq!(refused(&of(MethodName::Prior)), RequestError::PricesAlone);
        let class = with(MethodName::Search, PriorName::Class);
        assert_eq!(refused(&PlanRequest { beams: 6, ..class }), RequestError::NoClassAngles(6));
        assert_eq!(refused(&of(MethodName::Network)), RequestError::NoNetwork);
        assert_eq!(refused(&with(MethodName::Prior, PriorName::Network)), RequestError::NoNetwork);
        assert!(matches!(
            refused(&PlanRequest { beams: 19, ..of(MethodName::Random) }),
            RequestError::Ring(_)
        ));
    }

    #[test]
    fn given_angles_must_be_on_the_ring_and_belong_to_the_method_given() {
        let angles = PlanRequest::of_angles(vec![0.0, 10.0]);
        assert_eq!(refused(&angles), RequestError::Angle { found: 10.0.into(), step_deg: 4.0 });
        for wild in [f64::NAN, f64::INFINITY] {
            assert!(matches!(refused(&PlanRequest::of_angles(vec![wild])), RequestError::Angle { .. }));
        }
        let searched =
            PlanRequest { method: MethodName::Exchange, ..PlanRequest::of_angles(vec![0.0, 40.0]) };
        assert_eq!(refused(&searched), RequestError::Angles { angles: 2, beams: 2 });
        assert!(matches!(
            refused(&PlanRequest::of_angles(Vec::<f64>::new())),
            RequestError::Ring(RingError::NoBeam)
        ));
        // An angle a rounding below a whole turn is 0 degrees.
        let turned = PlanRequest::of_angles(vec![-1e-12, 400.0]);
        let search = turned.check(&phantom(0).unwrap(), Ring::new(90, 5).unwrap()).unwrap();
        assert_eq!(search.needed_beams(), [0, 10]);
    }
}
