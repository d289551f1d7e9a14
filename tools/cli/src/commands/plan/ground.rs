//! The case made ready: what is wanted of it, and the doses of the beams it may get.

use indicatif::{ProgressBar, ProgressStyle};
use stillpoint_plan::beams::{RingDoses, SecondPlayer};
use stillpoint_plan::dose::{BixelSpec, DoseCache, DoseEngine, DoseParams};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::objectives::ObjectiveSet;
use stillpoint_plan::sampling::Sampling;

use super::pooled::Pooled;
use super::request::{Request, RobustBy};
use crate::exit::Failure;

/// Doses at which volumes are told, gray; those up to the highest prescription.
const VOLUMES_AT_GY: [f64; 7] = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0];

/// What plans are made on.
pub struct Ground {
    /// The points whose dose is optimised.
    pub sampling: Sampling,
    /// What is wanted of each structure: objectives in gray, on the points that count for it.
    pub aims: ObjectiveSet,
    /// The same as plans are solved for: over all set-ups, or in the robust game for the planned one.
    pub goals: Goals,
    /// The second player of the robust game.
    pub opponent: Option<Opponent>,
    /// The engines of the points, of each set-up, the planned one first.
    pub engines: Vec<DoseEngine>,
    /// Doses of the beams.
    pub doses: RingDoses,
    /// Doses at which volumes are told, gray.
    pub volumes_at_gy: Vec<f64>,
    /// Highest prescribed dose, gray.
    pub prescribed_gy: f64,
    /// What people should know.
    pub notes: Vec<String>,
}

/// What the second player of the robust game needs.
pub struct Opponent {
    /// Doses of the beams under each set-up error.
    doses: RingDoses,
    /// Goals of what moves with the patient, and of what counts as planned.
    parts: [Goals; 2],
}

impl Ground {
    /// Makes it; doses that are not in the cache are computed, by the pool if there is one.
    pub fn new(request: &Request, pooled: Option<&mut Pooled>) -> Result<Self, Failure> {
        let Request { case, .. } = request;
        let sampling = Sampling::new(case, request.grid_mm, request.bixel_mm).map_err(Failure::failed)?;
        let over = DoseParams::over(case.grid(), request.grid_mm);
        let params =
            DoseParams { grid: *sampling.grid(), bixels: BixelSpec::of_width(request.bixel_mm), ..over };
        let engine = DoseEngine::of_case(case, request.machine.clone(), params).map_err(Failure::failed)?;
        let engine = sampling.engine(&engine);
        let mut aims = request.objectives.for_points(case, &sampling).map_err(Failure::failed)?;
        let is_game = request.robust_by == RobustBy::Worst;
        let solved_for = if is_game { 1 } else { request.setups_mm.len() };
        let goals = aims.goals(solved_for).map_err(Failure::failed)?;
        let moving = engine.within(aims.followed());
        let mut engines = vec![engine];
        for shift_mm in &request.setups_mm[1..] {
            engines.push(moving.shifted(*shift_mm).map_err(Failure::failed)?);
        }
        let beams = request.needed_beams();
        let bar = bar((beams.len() * engines.len()) as u64, "doses", request.quiet);
        let cache = DoseCache::in_folder(&request.doses).map_err(Failure::failed)?;
        if let Some(pooled) = pooled {
            let angles: Vec<f64> = beams.iter().map(|beam| request.ring.angle_deg(*beam)).collect();
            pooled.fill(&cache, &engines, &angles, || bar.inc(1));
            bar.set_position(0);
        }
        let load = |engines: &[DoseEngine]| {
            RingDoses::load(&cache, engines, request.ring, &beams, request.threads, || bar.inc(1))
                .map_err(Failure::failed)
        };
        let (solved, errors) = engines.split_at(solved_for);
        let doses = load(solved)?;
        let opponent = match is_game {
            true => Some(Opponent { doses: load(errors)?, parts: aims.parts().map_err(Failure::failed)? }),
            false => None,
        };
        bar.finish_and_clear();
        let prescribed_gy = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let mut notes = std::mem::take(&mut aims.notes);
        notes.extend(doses.replaced().map(|fault| format!("a cached dose was computed again: {fault}")));
        notes.extend(request.caution.clone());
        if case.fractions().is_none() {
            notes.push("the case does not state the number of fractions; the RTPLAN has one".to_owned());
        }
        Ok(Self {
            sampling,
            volumes_at_gy: VOLUMES_AT_GY.into_iter().filter(|gray| *gray <= prescribed_gy).collect(),
            aims,
            goals,
            opponent,
            engines,
            doses,
            prescribed_gy,
            notes,
        })
    }

    /// The second player of the robust game, where it is played.
    pub fn second_player(&self) -> Option<SecondPlayer<'_>> {
        let Opponent { doses, parts: [moving, still] } = self.opponent.as_ref()?;
        Some(SecondPlayer { doses, moving, still, all: &self.goals })
    }

    /// The engine of the points in the planned set-up.
    pub fn engine(&self) -> &DoseEngine {
        &self.engines[0]
    }

    /// Says what the plan is made on.
    pub fn tell(&self) {
        for note in &self.notes {
            outln!("note: {note}");
        }
        let (computed, bytes) = self.doses.computed();
        outln!(
            "{} points with objectives, {:.2} mm apart at the borders of targets; {computed} doses computed, {:.0} MB of doses",
            self.goals.voxels().len(),
            self.sampling.grid().spacing_mm[0],
            bytes as f64 * 1e-6
        );
    }
}

/// A progress bar on standard error, where that is a terminal.
pub fn bar(length: u64, what: &'static str, quiet: bool) -> ProgressBar {
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(length) };
    // The template is ours, so it is one.
    let style = ProgressStyle::with_template("{prefix:>18} {bar:32} {pos}/{len}  {elapsed}  {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_prefix(what);
    bar
}
