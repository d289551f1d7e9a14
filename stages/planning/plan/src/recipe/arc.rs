//! A plan of arcs for a set-up.
//!
//! The leaves are searched by pencil beams on fewer points than plans of static beams have: the doses of all that leaves can open from all
//! angles must be at hand. Then the dose of each interval is computed at all points of the set-up, by the method of the plan
//! and at closer angles, and the weights are solved again on that.

use std::num::NonZeroUsize;

use thiserror::Error;

use super::engine::PlanEngine;
use super::setup::{PlanSetup, SetupError};
use super::spec::{PointScheme, SetupSpec};
use crate::arc::{
    ArcBeam, ArcDose, ArcError, ArcField, ArcOptions, ArcSpec, Bounds, SpacingError, Trajectory, optimise,
};
use crate::dose::BeamAngles;

/// A plan of arcs.
#[derive(Clone, Debug)]
pub struct PlannedArcs {
    /// The arcs; those that open nothing are left out.
    pub beams: Vec<ArcBeam>,
    /// The objective of the dose that is reported, at the points of the set-up.
    pub objective: f64,
    /// That dose at the points with objectives, gray.
    pub dose: Vec<f64>,
    /// What the spacing of angles does to it.
    pub spacing: SpacingError,
    /// The objective of the search for leaves, at its own points: of the start, and after each round.
    pub objectives: Vec<f64>,
    /// Points of the search.
    pub points: usize,
    /// Fluence, over all fractions, of a monitor unit in each.
    pub weight_per_unit: f64,
}

/// The reasons why there is no plan of arcs.
#[derive(Debug, Error)]
pub enum ArcPlanError {
    /// The machine has no leaves.
    #[error("arcs need leaves, and the machine file has no `collimator`: give a machine file with one")]
    NoLeaves,
    /// Set-up errors.
    #[error("arcs are planned for the planned set-up alone: leave out --robust")]
    Robust,
    /// The machine file says that the gantry collides.
    #[error(
        "the arc {arc} passes gantry {gantry_deg} degrees at couch 0, which is not in `free_angles` of the machine file; give other arcs"
    )]
    Blocked {
        /// The arc.
        arc: ArcSpec,
        /// Its first control point that is not free, degrees.
        gantry_deg: f64,
    },
    /// The points of the search cannot be made.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// There is no arc.
    #[error(transparent)]
    Arc(#[from] ArcError),
}

/// What happens while arcs are planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArcProgress {
    /// The doses of all that leaves can open are there.
    Doses,
    /// A round of the search has ended, with its objective.
    Round(usize, f64),
    /// The dose of another interval that is reported.
    Interval,
}

impl PlanSetup {
    /// Plans arcs for the planned set-up. Any number of threads gives the same bytes.
    ///
    /// # Errors
    /// The machine has no leaves, an arc passes angles that are not free, there are set-up errors, or a dose cannot be computed.
    pub fn plan_arcs(
        &self,
        arcs: &[ArcSpec],
        options: ArcOptions,
        threads: NonZeroUsize,
        on_progress: impl Fn(ArcProgress) + Sync,
    ) -> Result<PlannedArcs, ArcPlanError> {
        let collimator = self.spec.machine.file().collimator.as_ref().ok_or(ArcPlanError::NoLeaves)?;
        if !self.spec.errors_mm.is_empty() {
            return Err(ArcPlanError::Robust);
        }
        let free = self.spec.machine.free_angles();
        for arc in arcs {
            let angles = arc.control_points_deg().into_iter().map(|deg| BeamAngles::from(deg).wrapped());
            let is_free = |at: &BeamAngles| free.iter().any(|range| range.holds(*at));
            if let Some(at) = angles.into_iter().find(|at| !is_free(at)) {
                return Err(ArcPlanError::Blocked { arc: *arc, gantry_deg: at.gantry_deg });
            }
        }
        let spec = SetupSpec { points: PointScheme::Sparse, engine: PlanEngine::Pencil, ..self.spec.clone() };
        let search = Self::new(self.case.clone(), spec)?;
        let field = ArcField::new(search.engine(), &search.goals, collimator, arcs, threads)?;
        on_progress(ArcProgress::Doses);
        let mu_per_weight = collimator.mu_per_weight / f64::from(self.case.fractions().unwrap_or(1));
        let limits = self.spec.machine.arc_limits();
        let bounds = Bounds::new(&field, &limits, collimator, mu_per_weight)?;
        let on_round = |round, cost| on_progress(ArcProgress::Round(round, cost));
        let found = optimise(&field, &search.goals, &bounds, options, threads, on_round)?;
        let mut trajectory = found.trajectory;
        let points = search.goals.voxels().len();
        drop(search);
        let beams = |trajectory: &Trajectory| {
            ArcBeam::all(&field, trajectory, collimator, arcs, mu_per_weight, bounds.gap_mm)
        };
        let all_give = |beams: &[ArcBeam]| match idle(arcs, beams) {
            Some(arc) => Err(ArcError::Idle(arc)),
            None => Ok(()),
        };
        let moving = beams(&trajectory);
        all_give(&moving)?;
        let on_interval = || on_progress(ArcProgress::Interval);
        let doses = ArcDose::new(self.engine(), &self.goals, collimator, &moving, threads, on_interval)?;
        let columns = doses.columns(&self.goals)?;
        let last = columns.improve(&self.goals, &bounds.weights, &mut trajectory.weights)?;
        let solved = beams(&trajectory);
        all_give(&solved)?;
        // Jaws and leaves are those of the doses; the units are new.
        let beams: Vec<ArcBeam> =
            moving.into_iter().zip(&solved).map(|(beam, of)| beam.with_units(of)).collect();
        if let Some(fault) = beams.iter().find_map(|beam| beam.fault(&limits, collimator)) {
            return Err(ArcError::Limit(fault).into());
        }
        Ok(PlannedArcs {
            beams,
            objective: last.cost(),
            dose: last.dose().to_vec(),
            spacing: doses.spacing_error(&trajectory.weights),
            objectives: found.objectives,
            points,
            weight_per_unit: 1.0 / mu_per_weight,
        })
    }
}

/// The first arc that is not among those that give something: those are in the same order.
fn idle(arcs: &[ArcSpec], beams: &[ArcBeam]) -> Option<ArcSpec> {
    let mut beams = beams.iter().peekable();
    arcs.iter().find(|arc| beams.next_if(|beam| beam.spec == **arc).is_none()).copied()
}
