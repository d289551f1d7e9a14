//! The arguments of `stillpoint plan`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use stillpoint_plan::recipe::{MethodName, PlanEngine, PlanRequest, PriorName, RobustBy};

use crate::pool::PoolArgs;

/// What is planned.
#[derive(Args)]
pub struct PlanArgs {
    /// The case file, or several; see `stillpoint case`.
    #[arg(value_name = "CASE")]
    pub(super) cases: Vec<PathBuf>,
    /// Number of beams.
    #[arg(long, default_value_t = 5)]
    pub(super) beams: usize,
    /// Maximum number of sets of beams that are solved. Default: 40, and 5 for `--method network`.
    #[arg(long)]
    pub(super) budget: Option<usize>,
    /// Method of choosing beams.
    #[arg(long, value_parser = names(&MethodName::ALL, MethodName::word, MethodName::about), default_value = "exchange")]
    pub(super) method: MethodName,
    /// What is known of a beam before it is solved, for the methods `search`, `prior`, `construction` and `two-player`.
    /// Several, separated by commas, are mixed in equal parts.
    #[arg(long, value_parser = names(&PriorName::ALL, PriorName::word, PriorName::about), value_delimiter = ',', default_value = "price")]
    pub(super) prior: Vec<PriorName>,
    /// Model file of `--method network` and `--prior network`, made by `stillpoint-research train planner`. Default: the network that
    /// comes with stillpoint.
    #[arg(long, value_name = "FILE")]
    pub(super) network: Option<PathBuf>,
    /// Leaves that the methods `exchange` and `search` have under way at most: each is chosen when all results but those are
    /// in. More leaves keep more cores or workers busy, and each is chosen with less knowledge. The plan depends on it, and
    /// plan.json states it.
    #[arg(long, value_name = "N", default_value_t = PlanRequest::USUAL_LEAVES)]
    pub(super) leaves: usize,
    /// Gantry angles in degrees, such as `0,90,-40.5`, to 0.01 degrees and as near to each other as you like; no search is run.
    /// `72@30` is a beam at gantry 72 and couch 30 degrees (patient support angle of IEC 61217); without `@` the couch is at 0.
    #[arg(long, allow_hyphen_values = true, conflicts_with_all = ["beams", "budget", "leaves", "method", "compare", "prior"])]
    pub(super) angles: Option<String>,
    /// Arcs, in which the gantry turns while the beam is on: `1` or `2` full ones, or `182..178cw,178..182cc`, where `cw` is clockwise (IEC 61217
    /// angles rise) and `cc` is counter-clockwise. The fluence of arcs is that of the leaves. Arcs take no couch angles, no set-up errors and no pool.
    #[arg(long, value_name = "ARCS", allow_hyphen_values = true, conflicts_with_all = ["angles", "start", "couch", "beams", "budget", "leaves", "method", "compare", "prior", "network", "robust", "robust_by", "fluence_only", "pool", "seed", "doses"])]
    pub(super) arc: Option<String>,
    /// Folder of a plan, or its plan.json: its beams are planned again, with its fluence as a start. For another image of the
    /// patient, or other objectives. The plan is that of `--angles` with these angles, found in fewer steps.
    #[arg(long, value_name = "PLAN", conflicts_with_all = ["angles", "couch", "beams", "budget", "leaves", "method", "compare", "prior", "robust_by"])]
    pub(super) start: Option<PathBuf>,
    /// Couch angles (patient support, IEC 61217): `0`, `free` as far as the machine has room, or the largest angle to both sides
    /// in degrees, 15 or more, such as `30`. The search begins with the best beams at couch 0 and has its budget once more, so
    /// its objective is never worse. plan.json reports which structures with objectives get more dose than without couch angles.
    #[arg(long, value_name = "ANGLE", default_value = "0", conflicts_with_all = ["angles"])]
    pub(super) couch: String,
    /// Run every method, each with the whole budget, and keep the best plan.
    #[arg(long, conflicts_with = "method")]
    pub(super) compare: bool,
    /// Plan for several set-ups: the planned one, and the patient shifted by this length along each axis in both
    /// directions. Without a length, the shift is 3 mm.
    #[arg(long, value_name = "SHIFT", num_args = 0..=1, default_missing_value = "3mm")]
    pub(super) robust: Option<String>,
    /// What is optimised with `--robust`.
    #[arg(long, value_enum, default_value_t = RobustChoice::Mean, requires = "robust")]
    pub(super) robust_by: RobustChoice,
    /// JSON table of objectives; its entries take precedence over the built-in table.
    #[arg(long, value_name = "FILE")]
    pub(super) objectives: Option<PathBuf>,
    /// YAML file of limits that the plan aims at and is compared with: a limit that no objective serves gets one. Default: the
    /// built-in protocol of the site of the case: prostate, head and neck, or lung.
    #[arg(long, value_name = "FILE")]
    pub(super) protocol: Option<PathBuf>,
    /// Machine file; the default is the built-in generic 6 MV machine.
    #[arg(long, value_name = "FILE")]
    pub(super) machine: Option<PathBuf>,
    /// Method by which dose is computed.
    #[arg(long, value_parser = names(&PlanEngine::ALL, PlanEngine::word, PlanEngine::about), default_value = "auto")]
    pub(super) engine: PlanEngine,
    /// Do not sequence the fluence for the leaves of the machine. The RTPLAN then has no segments and no monitor units.
    #[arg(long)]
    pub(super) fluence_only: bool,
    /// Spacing of the points whose dose is optimised. At the borders of targets it is half of that, and at most a quarter
    /// of a bixel. The reported dose is recomputed on a finer grid, that of `--dose-grid`.
    #[arg(long, value_name = "LENGTH", default_value = "5mm")]
    pub(super) grid: String,
    /// Spacing of the grid of the reported dose, its figures and the RTDOSE, 1 mm to 5 mm. Default: 2 mm, or four fifths of the
    /// spacing of the points at the borders of targets where that is finer.
    #[arg(long, value_name = "LENGTH")]
    pub(super) dose_grid: Option<String>,
    /// Width of a bixel.
    #[arg(long, value_name = "LENGTH", default_value = "10mm")]
    pub(super) bixel: String,
    /// How far within the edge of the patient, as the source sees him, every ray of a bixel runs at least.
    #[arg(long, value_name = "LENGTH", default_value = "0mm")]
    pub(super) body_margin: String,
    /// Let bixels miss the patient, up to this length from the edge, for targets at the skin.
    #[arg(long, value_name = "LENGTH", conflicts_with = "body_margin")]
    pub(super) flash: Option<String>,
    /// Export a plan that the plan check refuses, for this reason, after a person has looked at the plan. plan.json records the
    /// reason. Without it, a refused plan has no DICOM files, and the command exits with 6.
    #[arg(long, value_name = "REASON")]
    pub(super) accept_check: Option<String>,
    /// Output folder; the default is `plans/CASE`. With several cases: the folder of their folders, by default `plans`.
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Folder in which doses are cached between plans, about 5 MB per beam with 10 mm bixels.
    #[arg(long, value_name = "DIR", default_value = "doses")]
    pub(super) doses: PathBuf,
    /// Copy the name, ID, birth date and sex of the patient from this DICOM folder into the exported DICOM.
    #[arg(long, value_name = "DICOM_DIR")]
    pub(super) keep_identity: Option<PathBuf>,
    /// Seed of the random methods.
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Number of threads; the plan does not depend on it. Default: all cores.
    #[arg(long)]
    pub(super) threads: Option<std::num::NonZeroUsize>,
    /// Number of patients that are planned at the same time, where there are several cases; no plan depends on it. Default: half
    /// of the threads, and 4 with `--pool`.
    #[arg(long)]
    pub(super) jobs: Option<std::num::NonZeroUsize>,
    #[command(flatten)]
    pub(super) pool: PoolArgs,
    /// Write all calls of the pool into this file: kinds, sizes, times, workers, and this program's own time between them.
    /// `stillpoint bench pool` computes from it how long the plan takes with other workers and another network.
    #[arg(long, value_name = "FILE", requires = "pool")]
    pub(super) pool_record: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What is optimised where there are several set-ups.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum RobustChoice {
    /// The mean over the set-ups, by beams and by fluence.
    Mean,
    /// The worst set-up, by beams: the robust game. The fluence is that for the planned set-up; a second player answers each
    /// set of beams with the set-up under which it costs most, and the search minimises that cost. Its answers are counted in
    /// the budget, each set-up as 0.02 solves.
    Worst,
}

impl From<RobustChoice> for RobustBy {
    fn from(choice: RobustChoice) -> Self {
        match choice {
            RobustChoice::Mean => Self::Mean,
            RobustChoice::Worst => Self::Worst,
        }
    }
}

/// The names of a list, each with what it does.
fn names<T>(
    all: &[T],
    word: fn(T) -> &'static str,
    about: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T>
where
    T: Copy + FromStr + Send + Sync + 'static,
    T::Err: std::error::Error + Send + Sync,
{
    let value = |name: &T| PossibleValue::new(word(*name)).help(about(*name));
    PossibleValuesParser::new(all.iter().map(value)).try_map(|text| text.parse::<T>())
}
