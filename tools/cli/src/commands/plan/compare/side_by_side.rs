//! The rows of two plans beside each other.

use serde_json::{Value, json};
use stillpoint_plan::dose::ArcLimits;
use stillpoint_plan::evaluation::StructureDose;
use stillpoint_plan::plan_file::PlanFileLeaves;
use stillpoint_plan::protocol::Judged;

use super::super::page::parts::{self, number};
use super::super::table::beams;
use super::NAMES;
use super::compared::Compared;
use crate::exit::Failure;

/// Two plans of one case.
pub struct SideBySide<'a> {
    /// The plans.
    pub plans: &'a [Compared; 2],
}

impl<'a> SideBySide<'a> {
    /// Of plans of one case alone.
    pub fn new(plans: &'a [Compared; 2]) -> Result<Self, Failure> {
        let [a, b] = plans;
        if a.case().hash != b.case().hash {
            return Err(Failure::wrong(format!(
                "the plans are of different cases: {} is of {} ({}), {} of {} ({}); plan one case twice",
                a.path.display(),
                a.case().name,
                a.case().hash,
                b.path.display(),
                b.case().name,
                b.case().hash
            )));
        }
        let doses = |s: &StructureDose| s.volumes.iter().map(|v| v.dose_gy).collect::<Vec<_>>();
        let first = a.shown().structures.first().map(doses);
        if let Some(odd) = plans.iter().find(|p| p.shown().structures.iter().any(|s| Some(doses(s)) != first))
        {
            let path = odd.path.display();
            return Err(Failure::wrong(format!(
                "{path}: its volumes are not at the doses of {}; plan the case again",
                a.path.display()
            )));
        }
        Ok(Self { plans })
    }

    /// Whether the values of both objectives can be compared.
    pub fn is_of_the_same_objectives(&self) -> bool {
        let [a, b] = self.plans;
        a.file.requested == b.file.requested
    }

    /// What must be known to compare the plans.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.is_of_the_same_objectives() {
            notes.push(
                "The plans were made with different objectives or at different points, so the values of the objective cannot be compared."
                    .to_owned(),
            );
        }
        if self.plans.iter().any(|p| p.file.arcs.is_some()) {
            notes.push(
                "Delivery is the time of monitor units, leaves and gantry, as fast as the machine of the arcs is. That of static beams \
                 has nothing for the beam to go on and off, nor for a couch."
                    .to_owned(),
            );
        }
        let is_shaped = |p: &Compared| p.file.leaves.is_some() || p.file.arcs.is_some();
        if is_shaped(&self.plans[0]) != is_shaped(&self.plans[1]) {
            notes.push(
                "One plan is in segments and the other is a fluence that no leaves have shaped.".to_owned(),
            );
        }
        notes
    }

    /// Rows of the plans as a whole: a name, and a text for each plan.
    pub fn rows(&self) -> Vec<(String, [String; 2])> {
        let mut rows: Vec<(String, [String; 2])> = Vec::new();
        let mut row = |name: &str, of: &dyn Fn(&Compared) -> String| {
            rows.push((name.to_owned(), [of(&self.plans[0]), of(&self.plans[1])]));
        };
        row("file", &|p| p.path.display().to_string());
        row("beams", &|p| beams(&p.file));
        row("method", &|p| p.file.method.to_string());
        row("bixels, mm", &|p| p.file.dose.bixel_mm.to_string());
        row("dose engine", &|p| p.file.dose.engine.to_string());
        row("grid of the dose, mm", &|p| format!("{:.2}", p.file.dose.grid.spacing_mm[0]));
        row("figures of", &|p| figures_of(p).to_owned());
        row("objective of the fluence", &|p| match p.file.arcs {
            Some(_) => "-".to_owned(),
            None => format!("{:.4}", p.file.objective),
        });
        if self.plans.iter().any(|p| p.file.arcs.is_some()) {
            row("objective of the arcs", &|p| match p.file.arcs {
                Some(_) => format!("{:.4}", p.file.objective),
                None => "-".to_owned(),
            });
        }
        let leaves = |p: &'a Compared| p.file.leaves.as_ref();
        if self.plans.iter().any(|p| leaves(p).is_some()) {
            let of = |p: &Compared, text: &dyn Fn(&PlanFileLeaves) -> String| {
                p.file.leaves.as_ref().map_or("-".to_owned(), text)
            };
            let objective = |l: &PlanFileLeaves| format!("{:.4} (+{:.1} %)", l.objective, 100.0 * l.loss);
            row("objective of the segments", &|p| of(p, &objective));
            row("segments", &|p| of(p, &|l| l.segments.to_string()));
        }
        row("monitor units a fraction", &|p| number(units(p), 0));
        let minutes = |p: &Compared| p.file.seconds(&self.limits_of_delivery()).map(|seconds| seconds / 60.0);
        row("delivery, min", &|p| number(minutes(p), 1));
        let fall_off = |p: &Compared| p.shown().fall_off;
        row("R50", &|p| number(fall_off(p).map(|f| f.r50), 2));
        row("D2cm (D0.03cc), Gy", &|p| number(fall_off(p).and_then(|f| f.d2cm_gy), 1));
        row("within 1 cm of the skin (D0.03cc), Gy", &|p| number(fall_off(p).and_then(|f| f.first_cm_gy), 1));
        for target in self.plans[0].shown().structures.iter().filter(|s| s.prescribed_gy.is_some()) {
            let of = |p: &Compared, figure: fn(&StructureDose) -> Option<f64>, digits: usize| {
                let found = p.shown().structures.iter().find(|s| s.name == target.name);
                number(found.and_then(figure), digits)
            };
            row(&format!("{}: V95%, %", target.name), &|p| of(p, |s| s.covered.map(|c| 100.0 * c), 1));
            row(&format!("{}: Paddick's index", target.name), &|p| of(p, |s| s.conformity, 2));
            row(&format!("{}: HI", target.name), &|p| of(p, |s| s.homogeneity, 3));
        }
        if self.plans.iter().any(|p| p.shown().protocol.is_some()) {
            row("protocol", &|p| p.shown().protocol.as_ref().map_or("-".to_owned(), |p| p.name.clone()));
            let count = |p: &Compared, passed| p.limits().iter().filter(|j| j.passed == Some(passed)).count();
            row("limits passed, failed", &|p| format!("{}, {}", count(p, true), count(p, false)));
        }
        rows
    }

    /// How fast the machine is on which the times of static beams are: that of the arcs, if there are some. Files of static beams
    /// have no such limits.
    fn limits_of_delivery(&self) -> ArcLimits {
        let of_arcs = self.plans.iter().find_map(|plan| plan.file.arcs.as_ref());
        of_arcs.map_or(ArcLimits::generic(), |arcs| arcs.limits)
    }

    /// Doses of which both plans tell the volume, gray.
    pub fn volumes_at_gy(&self) -> Vec<f64> {
        let of = |p: &Compared| -> Vec<f64> {
            let first = p.shown().structures.first();
            first.map_or(Vec::new(), |s| s.volumes.iter().map(|v| v.dose_gy).collect())
        };
        of(&self.plans[0])
    }

    /// Name of each structure, name of the plan, and figures; the plans of a structure after each other.
    pub fn structures(&self) -> impl Iterator<Item = ([&'a str; 2], &'a StructureDose)> {
        let plans = self.plans;
        plans[0].shown().structures.iter().flat_map(move |first| {
            plans.iter().zip(NAMES).filter_map(move |(plan, name)| {
                let figures = plan.shown().structures.iter().find(|s| s.name == first.name)?;
                Some(([&first.name[..], name], figures))
            })
        })
    }

    /// The limits of both plans, those of one limit at one place; limits that only one plan has are at the end.
    pub fn limits(&self) -> [parts::SideBySide; 2] {
        let [a, b] = [&self.plans[0], &self.plans[1]].map(|plan| plan.limits());
        let same = |x: &Judged, y: &Judged| x.structure == y.structure && x.limit == y.limit;
        let mut columns: [parts::SideBySide; 2] = [Vec::new(), Vec::new()];
        for judged in a {
            columns[0].push(Some(judged.clone()));
            columns[1].push(b.iter().find(|other| same(judged, other)).cloned());
        }
        for judged in b.iter().filter(|judged| !a.iter().any(|other| same(judged, other))) {
            columns[0].push(None);
            columns[1].push(Some(judged.clone()));
        }
        columns
    }

    /// Both plans for programs.
    pub fn to_json(&self) -> Vec<Value> {
        let plan = |(name, p): (&str, &Compared)| {
            json!({
                "name": name,
                "file": p.path,
                "angles_deg": p.file.angles_deg(),
                "method": p.file.method,
                "bixel_mm": p.file.dose.bixel_mm,
                "engine": p.file.dose.engine,
                "figures_of": if figures_of(p) == "planned fluence" { "fluence" } else { figures_of(p) },
                "arcs": p.file.arcs.as_ref().map(|arcs| arcs.arcs.iter().map(|arc| &arc.arc).collect::<Vec<_>>()),
                "delivery_s": p.file.seconds(&self.limits_of_delivery()),
                "objective": p.file.objective,
                "objective_of_segments": p.file.leaves.as_ref().map(|l| l.objective),
                "segments": p.file.leaves.as_ref().map(|l| l.segments),
                "monitor_units": units(p),
                "structures": p.shown().structures,
                "fall_off": p.shown().fall_off,
                "limits": p.limits(),
            })
        };
        NAMES.into_iter().zip(self.plans).map(plan).collect()
    }
}

/// What the figures of a plan are of.
fn figures_of(plan: &Compared) -> &'static str {
    match (&plan.file.arcs, &plan.file.leaves) {
        (Some(_), _) => "arcs",
        (None, Some(_)) => "segments",
        (None, None) => "planned fluence",
    }
}

/// Monitor units of one fraction; nothing for a fluence that is not sequenced.
fn units(plan: &Compared) -> Option<f64> {
    let of_segments = plan.file.leaves.as_ref().map(|leaves| leaves.monitor_units);
    of_segments.or(plan.file.arcs.as_ref().map(|arcs| arcs.monitor_units))
}
