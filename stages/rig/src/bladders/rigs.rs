//! The rigs by their number of bladders.

use nalgebra::SVector;
use stillpoint_mechanics::plant::layouts::{FOAM, START_GAP};
use stillpoint_mechanics::plant::{OneDof, SixDof, ThreeDof};

use super::safety::{Safe, Safety};
use super::simulation::{Rig, Simulation, StartError, Surroundings};

/// Places of height, pitch and roll in x, y, z, pitch, roll, yaw.
const HEIGHT: usize = 2;
const PITCH: usize = 3;
const ROLL: usize = 4;

/// What all rigs are built of.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Mass of the head, kg.
    pub head_mass: f64,
    /// Time for which duties are valid, ns.
    pub time_to_live: u64,
    /// What comes then.
    pub safe: Safe,
    /// Person, faults and step.
    pub surroundings: Surroundings,
}

/// Height alone (section 4.2 of the dissertation).
///
/// # Errors
/// [`StartError`].
pub fn one_bladder(setup: Setup) -> Result<Box<dyn Rig>, StartError> {
    let plant = OneDof::rig(setup.head_mass).with_stop(FOAM);
    let air = plant.start_air();
    let safety = Safety::new(setup.time_to_live, setup.safe);
    let guess = SVector::repeat(START_GAP);
    Ok(Box::new(Simulation::new(plant, [HEIGHT], air, guess, safety, setup.surroundings)?))
}

/// Height, pitch and roll (section 4.3 of the dissertation).
///
/// # Errors
/// [`StartError`].
pub fn three_bladders(setup: Setup) -> Result<Box<dyn Rig>, StartError> {
    let plant = ThreeDof::rig(setup.head_mass).with_stop(FOAM);
    let air = plant.start_air();
    let safety = Safety::new(setup.time_to_live, setup.safe);
    let channels = [HEIGHT, PITCH, ROLL];
    Ok(Box::new(Simulation::new(plant, channels, air, SVector::zeros(), safety, setup.surroundings)?))
}

/// All six coordinates, between eight bladders (section 3.3.3 of the dissertation).
///
/// # Errors
/// [`StartError`].
pub fn eight_bladders(setup: Setup) -> Result<Box<dyn Rig>, StartError> {
    let plant = SixDof::rig(setup.head_mass).with_stop(FOAM);
    let air = plant.start_air();
    let safety = Safety::new(setup.time_to_live, setup.safe);
    let channels = [0, 1, HEIGHT, PITCH, ROLL, 5];
    Ok(Box::new(Simulation::new(plant, channels, air, SVector::zeros(), safety, setup.surroundings)?))
}
