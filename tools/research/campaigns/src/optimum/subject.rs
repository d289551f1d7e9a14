//! A patient whose beams are chosen again and again: goals, what the network says, and the doses of a ring in memory.

use std::num::NonZeroUsize;

use stillpoint_network::{Eye, Judgement, Model, Patient, Problem};
use stillpoint_plan::Rows;
use stillpoint_plan::beams::{Ring, pelvis_solutions};
use stillpoint_plan::dose::Machine;

/// Angles at which the network looks.
pub const ANGLES: usize = 90;

/// A patient with the doses of a ring.
pub struct Subject {
    pub name: String,
    /// The case with its goals.
    pub problem: Problem,
    pub ring: Ring,
    /// A matrix for each angle.
    pub doses: Vec<Rows>,
    /// What the network says of sets of beams.
    pub judgement: Judgement,
    /// The class set, where the site has one.
    pub class: Vec<Vec<f64>>,
}

impl Subject {
    /// The doses of all angles are computed.
    pub fn new(
        patient: &Patient,
        model: &Model,
        ring: Ring,
        beams: usize,
    ) -> Result<Self, Box<dyn std::error::Error>> {
        let problem = patient.problem()?;
        let machine = Machine::shipped()?;
        let eye =
            Eye::of_case(problem.case(), problem.requested(), &machine, ANGLES, patient.coarse.bixel_mm)?;
        let class = if problem.case().is_pelvis() { pelvis_solutions(beams) } else { Vec::new() };
        Ok(Self {
            name: patient.name(),
            ring,
            doses: problem.doses(ring, NonZeroUsize::MIN)?,
            judgement: model.judge(&eye),
            class: class.into_iter().take(1).collect(),
            problem,
        })
    }
}
