//! Parameters of `plan.optimizer`.

use stillpoint_operator::{Choice, Params, SetupError};
use stillpoint_plan::protocol::{Limit, Of, Protocol};
use stillpoint_plan::recipe::{MethodName, PlanEngine, PriorName};

/// Which plan becomes the standing plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Standing {
    /// The best plan of the first request for the planned set-up, and later each plan that a person accepts.
    First,
    /// Only plans that a person accepts.
    Accepted,
}

/// How beams are chosen; `docs/science/beams.md` describes each method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum MethodChoice {
    /// Equally spaced beams; every rotation is tried.
    Equidistant,
    /// The usual angles for the pelvis with 5 or 7 beams; equally spaced beams for other numbers.
    Class,
    /// The best of uniformly drawn sets.
    Random,
    /// Beams are added one by one, by price.
    Greedy,
    /// Single beams are exchanged as long as the objective improves.
    Exchange,
    /// Simulated annealing from the greedy set.
    Annealing,
    /// Column generation.
    Columns,
    /// Tree search over exchanges, guided by `prior`.
    Search,
    /// The set that `prior` builds by itself.
    Prior,
    /// The sets that a trained network proposes.
    Network,
    /// Tree search of the game in which beams are added one by one, guided by `prior`.
    Construction,
    /// Tree search of the game in which two players exchange beams in turn, guided by `prior`.
    TwoPlayer,
}

impl From<MethodChoice> for MethodName {
    fn from(choice: MethodChoice) -> Self {
        match choice {
            MethodChoice::Equidistant => Self::Equidistant,
            MethodChoice::Class => Self::Class,
            MethodChoice::Random => Self::Random,
            MethodChoice::Greedy => Self::Greedy,
            MethodChoice::Exchange => Self::Exchange,
            MethodChoice::Annealing => Self::Annealing,
            MethodChoice::Columns => Self::Columns,
            MethodChoice::Search => Self::Search,
            MethodChoice::Prior => Self::Prior,
            MethodChoice::Network => Self::Network,
            MethodChoice::Construction => Self::Construction,
            MethodChoice::TwoPlayer => Self::TwoPlayer,
        }
    }
}

/// What is known of a beam before it is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum PriorChoice {
    /// All beams are alike.
    Uniform,
    /// Prices next to the beams that stay.
    Price,
    /// Path lengths through the body and through organs.
    Geometry,
    /// The usual angles for the pelvis with 5 or 7 beams.
    Class,
    /// A trained network over the geometry of the case.
    Network,
}

impl From<PriorChoice> for PriorName {
    fn from(choice: PriorChoice) -> Self {
        match choice {
            PriorChoice::Uniform => Self::Uniform,
            PriorChoice::Price => Self::Price,
            PriorChoice::Geometry => Self::Geometry,
            PriorChoice::Class => Self::Class,
            PriorChoice::Network => Self::Network,
        }
    }
}

/// Method by which dose is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum EngineChoice {
    /// Pencil beams: fast, and too high in lung and behind air.
    Pencil,
    /// Superposition of point kernels: slower, and near Monte Carlo there.
    Superposition,
}

impl From<EngineChoice> for PlanEngine {
    fn from(choice: EngineChoice) -> Self {
        match choice {
            EngineChoice::Pencil => Self::Pencil,
            EngineChoice::Superposition => Self::Superposition,
        }
    }
}

/// A limit that the standing plan keeps.
#[derive(Clone, Debug, Params)]
pub struct LimitParams {
    /// A structure of the case, `target` for each target by its own prescription, or `plan` for the whole plan.
    pub on: String,
    /// The limit, such as `V75Gy[%] <= 15`: quantities as in protocols.
    pub limit: String,
}

/// What happens to a request when no worker of the pool has been there for the time of patience.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Degraded {
    /// This operator goes on by itself, up to `solves` solves.
    Local,
    /// The work on the request ends, and the request is answered with refusal 9. The plans before it are kept.
    Keep,
}

/// A pool of workers that compute doses, solves and prices. It is used where the input `answers` is connected.
#[derive(Clone, Debug, Params)]
pub struct PoolParams {
    /// Session time without any worker after which the degraded mode begins. A call for which no worker shows a sign of work
    /// for so long is computed by this operator.
    #[param(unit = "ns", default = "60 s", min = "1 s", max = "1 h")]
    pub patience: u64,
    /// The degraded mode.
    #[param(default = "local")]
    pub degraded: Degraded,
    /// Solves of a request after which the degraded mode `local` ends the work. What workers solved before counts.
    #[param(default = 8, min = 1, max = 1000)]
    pub solves: u64,
    /// Share of the answers of workers that are compared with those of another worker or of this operator.
    #[param(default = 0.03125, min = 0, max = 1)]
    pub checked: f64,
}

/// Parameters of `plan.optimizer`.
#[derive(Clone, Debug, Params)]
pub struct OptimizerParams {
    /// The case file, a path relative to the pipeline file; the session keeps it. Without it, the case is the synthetic
    /// pelvis of seed 0.
    #[param(file)]
    pub case: Option<String>,
    /// JSON table of objectives, a path relative to the pipeline file; the session keeps it. Its entries take precedence over
    /// the built-in table.
    #[param(file)]
    pub objectives: Option<String>,
    /// Machine file, a path relative to the pipeline file; the session keeps it. Without it, the machine is the built-in
    /// generic 6 MV machine.
    #[param(file)]
    pub machine: Option<String>,
    /// YAML file of limits that the standing plan keeps, as far as the case has their structures: a path relative to the
    /// pipeline file; the session keeps it.
    #[param(file)]
    pub protocol: Option<String>,
    /// Method of choosing beams, as `--method` of `stillpoint plan`.
    #[param(default = "exchange")]
    pub method: MethodChoice,
    /// What is known of a beam before it is solved, for the methods `search`, `prior`, `construction` and `two_player`.
    /// Several are mixed in equal parts.
    #[param(default = "[\"price\"]")]
    pub prior: Vec<PriorChoice>,
    /// Model file of the method and the prior `network`, a path relative to the pipeline file; the session keeps it. Without
    /// it, the network is the one that comes with stillpoint.
    #[param(file)]
    pub network: Option<String>,
    /// Leaves that the methods `exchange` and `search` have under way at most, as `--leaves` of `stillpoint plan`: so many
    /// workers of a pool have work. The plans depend on it.
    #[param(default = 1, min = 1, max = 64)]
    pub leaves: u64,
    /// Number of gantry angles, equally spaced from 0. Beams of a plan are at least 20 degrees apart.
    #[param(default = 36, min = 6, max = 90)]
    pub angles: u64,
    /// Distance between the points whose dose is optimised. At the borders of targets it is half of that, and at most a
    /// quarter of a bixel.
    #[param(unit = "m", default = "5 mm", min = "2 mm", max = "20 mm")]
    pub grid: f64,
    /// Width of a bixel.
    #[param(unit = "m", default = "10 mm", min = "4 mm", max = "40 mm")]
    pub bixel: f64,
    /// Method by which dose is computed, as `--engine` of `stillpoint plan`.
    #[param(default = "pencil")]
    pub engine: EngineChoice,
    /// Shift along an axis of the patient above which a request is refused. Bixels are placed that much farther beyond the
    /// target, so that a new plan can follow it.
    #[param(unit = "m", default = "10 mm", min = "0 mm", max = "50 mm")]
    pub reach: f64,
    /// Rotation above which a request is refused. Doses are computed for the shift only: a smaller rotation has no effect
    /// on them.
    #[param(unit = "rad", default = "1 deg", min = "0 deg", max = "5 deg")]
    pub turn: f64,
    /// Number of beams whose doses one tick computes.
    #[param(default = 4, min = 1, max = 90)]
    pub doses: u64,
    /// Number of solves of one tick.
    #[param(default = 2, min = 1, max = 1000)]
    pub solves: u64,
    /// The standing plan holds if 98 % of the target get at least this part of the prescription ...
    #[param(default = 0.9, min = 0, max = 1)]
    pub least: f64,
    /// ... and 2 % of the target get at most this part of it.
    #[param(default = 1.15, min = 1, max = 10)]
    pub most: f64,
    /// Further limits that the standing plan keeps, of its dose on a grid of the spacing `grid`.
    #[param(default = "[]")]
    pub limits: Vec<LimitParams>,
    /// Which plan becomes the standing plan.
    #[param(default = "first")]
    pub standing: Standing,
    /// Bixels of an update at most. A request whose plan can have more is refused.
    #[param(default = 16384, min = 1, max = 1000000)]
    pub max_bixels: u64,
    /// The pool of workers behind the input `answers`.
    pub pool: PoolParams,
}

/// The limits as a protocol.
pub fn limits(given: &[LimitParams]) -> Result<Protocol, SetupError> {
    let limit = |given: &LimitParams| {
        let of = match given.on.as_str() {
            "target" => Of::EachTarget,
            "plan" => Of::Plan,
            name => Of::Structure { name: name.to_owned(), patterns: Vec::new() },
        };
        Limit::new(of, &given.limit, "").map_err(|e| SetupError(format!("`limits`: {e}")))
    };
    Ok(Protocol {
        name: "limits".into(),
        fraction_gy: None,
        limits: given.iter().map(limit).collect::<Result<_, _>>()?,
    })
}
