//! Beam angles: the classical ways to choose them (ch. 5.1, SCIENCE G1), counted in solves.
//!
//! ```
//! use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, choose};
//! use stillpoint_plan::fluence::{Goals, Objective, StructureObjectives, Underdose};
//! use stillpoint_plan::{Csc, Rows};
//!
//! // Two voxels, six beams of one bixel: those with even numbers reach the target, voxel 0.
//! let matrix = |beam: u32| Csc::new(2, vec![0, 1], vec![beam % 2], vec![1.0 + beam as f32]);
//! let beams: Vec<Csc> = (0..6).map(matrix).collect::<Result<_, _>>()?;
//! let beams: Vec<Rows> = beams.iter().map(|beam| Rows::from_columns(beam.view())).collect::<Result<_, _>>()?;
//! let target = StructureObjectives {
//!     name: "target".into(),
//!     voxels: vec![0],
//!     volumes: Vec::new(),
//!     to_target_mm: Vec::new(),
//!     objectives: vec![Objective::Underdose(Underdose { dose: 60.0, weight: 1.0 })],
//! };
//! let goals = Goals::new(vec![target], 2)?;
//! let mut evaluator = Evaluator::new(&beams[..], &goals, Ring::new(6, 2)?, 2, Budget { solves: 4 });
//! let choice = choose(&Method::Greedy, &mut evaluator, None, 1)?;
//! assert_eq!(choice.best.beams.beams().len(), 2);
//! assert_eq!(evaluator.solves(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `ring`: angles, distances, legal sets
//! - `directions`: the angles of gantry and couch behind the numbers of beams
//! - `doses`: their dose matrices, from the cache
//! - `lattice`: candidates with couch angles; `lazy`: their doses, computed when they are needed
//! - `evaluator`: what a set costs: solved once, cached, counted
//! - `ahead`: sets that are under way while a search goes on
//! - `solver`: where sets are solved and beams are priced
//! - `price`: what a beam promises beside a plan
//! - `prior`: what is thought of a beam without a solve; `geometry`: from the image
//! - [`search`]: tree search: exchanges, games
//! - `second`: the second player of the robust game, who picks a set-up error
//! - `method`: the ways to choose; `greedy`, `exchange`, `random`, `annealing`, `columns`

mod ahead;
mod annealing;
mod columns;
mod directions;
mod doses;
mod evaluator;
mod exchange;
mod geometry;
mod greedy;
mod lattice;
mod lazy;
mod method;
mod price;
mod prior;
mod random;
mod ring;
pub mod search;
mod second;
mod solver;

pub use directions::Directions;
pub use doses::RingDoses;
pub use evaluator::{Budget, Evaluated, Evaluator, Influence, Memo, Progress, Stop};
pub use exchange::improve;
pub use geometry::Geometry;
pub use lattice::candidates;
pub use lazy::LazyDoses;
pub use method::{Choice, ChoiceError, Method, choose, class_solution, pelvis_solutions, rotations};
pub use prior::{ClassAngles, Mixture, Prior, PriorError, Uniform, checked_scores, set_of_prior};
pub use random::set as random_set;
pub use ring::{BeamSet, Ring, RingError};
pub use search::{BeamGame, SearchOptions};
pub use second::{Answer, Displaced, SHARE_OF_A_SOLVE, SecondPlayer};
pub use solver::{
    Begun, COARSEST_TOLERANCE, Local, SOLVE_TOLERANCE, Solver, ToleranceError, checked_tolerance,
    price_beams, solve_beams, start_weights,
};
