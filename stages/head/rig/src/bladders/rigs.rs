//! A simulated rig from its entry in the table of rigs.

use stillpoint_mechanics::plant::layouts::{FOAM, rolling};
use stillpoint_mechanics::plant::rigs::{RigPlant, RigSpec, UsePlant};

use super::safety::{Safe, Safety};
use super::simulation::{Rig, Simulation, StartError, Surroundings};

/// What all rigs are built of.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Mass of the head, kg.
    pub head_mass: f64,
    /// Time for which duties are valid, ns.
    pub time_to_live: u64,
    pub safe: Safe,
    /// Whether the contacts move over head and bladders.
    pub contacts: Contacts,
    /// Person, faults and step.
    pub surroundings: Surroundings,
}

/// Where the bladders touch the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contacts {
    /// Always at the same places.
    Fixed,
    /// The contacts roll over head and bladders, stick and slide.
    Rolling,
}

/// The rig of this entry, over foam.
///
/// # Errors
/// [`StartError`].
pub fn simulated(spec: &RigSpec, setup: Setup) -> Result<Box<dyn Rig>, StartError> {
    spec.with(setup.head_mass, Simulated(setup))
}

struct Simulated(Setup);

impl UsePlant for Simulated {
    type Made = Result<Box<dyn Rig>, StartError>;

    fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) -> Self::Made {
        let Setup { head_mass, time_to_live, safe, contacts, surroundings } = self.0;
        let safety = Safety::new(time_to_live, safe);
        let mut plant = rig.plant.with_stop(FOAM);
        if contacts == Contacts::Rolling {
            plant.rolling = rolling(&rig.channels, head_mass, &plant.shell);
        }
        Ok(Box::new(Simulation::new(plant, rig.channels, rig.air, rig.guess, safety, surroundings)?))
    }
}
