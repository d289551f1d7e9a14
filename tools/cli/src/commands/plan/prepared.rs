//! The doses of a plan, and what people should know of them.

use indicatif::{ProgressBar, ProgressStyle};
use stillpoint_plan::dose::DoseCache;
use stillpoint_plan::evaluation::leaving_outline;
use stillpoint_plan::recipe::PlanDoses;

use super::pooled::Pooled;
use super::request::Request;
use crate::exit::Failure;

/// Doses at which volumes are told, gray; those up to the highest prescription.
const VOLUMES_AT_GY: [f64; 7] = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0];

/// What plans are made on.
pub struct Prepared {
    /// Doses of the beams.
    pub doses: PlanDoses,
    /// Doses at which volumes are told, gray.
    pub volumes_at_gy: Vec<f64>,
    /// Highest prescribed dose, gray.
    pub prescribed_gy: f64,
    /// What people should know.
    pub notes: Vec<String>,
}

impl Prepared {
    /// Loads it; doses that are not in the cache are computed, by the pool if there is one.
    pub fn new(request: &Request, pooled: Option<&mut Pooled>) -> Result<Self, Failure> {
        let setup = &request.setup;
        let beams = request.needed_beams();
        let bar = bar((beams.len() * setup.engines().len()) as u64, "doses", request.quiet);
        let cache = match pooled {
            Some(pooled) => pooled.fill(setup.engines(), &setup.angles(&beams), || bar.inc(1)),
            None => DoseCache::in_folder(&request.doses).map_err(Failure::failed)?,
        };
        bar.set_position(0);
        let doses = PlanDoses::load(setup, &cache, &beams, request.threads, || bar.inc(1));
        bar.finish_and_clear();
        let doses = doses.map_err(Failure::failed)?;
        let prescribed_gy = setup.prescribed_gy();
        let mut notes = notes(request);
        let replaced = doses.solved.replaced();
        notes.extend(replaced.map(|fault| format!("a cached dose was computed again: {fault}")));
        Ok(Self { doses, volumes_at_gy: volumes_at_gy(prescribed_gy), prescribed_gy, notes })
    }

    /// Says what the plan is made on.
    pub fn print_notes(&self, request: &Request) {
        for note in &self.notes {
            outln!("note: {note}");
        }
        let (computed, bytes) = self.doses.solved.computed();
        outln!(
            "{} points with objectives, {:.2} mm apart at the borders of targets; {computed} doses computed, {:.0} MB of doses",
            request.setup.goals.voxels().len(),
            request.setup.points_mm(),
            bytes as f64 * 1e-6
        );
    }
}

/// Doses at which volumes are reported, up to the highest prescription.
pub fn volumes_at_gy(prescribed_gy: f64) -> Vec<f64> {
    VOLUMES_AT_GY.into_iter().filter(|gray| *gray <= prescribed_gy).collect()
}

/// What people should know of a plan, whatever its beams are.
pub fn notes(request: &Request) -> Vec<String> {
    let setup = &request.setup;
    let mut notes = setup.objective_set.notes.clone();
    notes.extend(leaving_outline(&setup.case).into_iter().map(|(name, outside_cm3, whole_cm3)| {
        format!(
            "{name}: {outside_cm3:.2} of its {whole_cm3:.2} cm3 are outside of the outline of the patient and get no \
             dose; they count in its figures"
        )
    }));
    notes.extend(request.protocol_note.clone());
    notes.extend(setup.spec.machine.beyond_table(&setup.case));
    notes.extend(request.caution.clone());
    if setup.case.fractions().is_none() {
        notes.push("the case does not state the number of fractions; the RTPLAN has one".to_owned());
    }
    notes
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
