//! What can break on a rig, and when.

/// What breaks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// A valve keeps the opening that it has. Inlet and outlet of the first bladder are 0 and 1, and so on.
    StuckValve {
        /// Which.
        valve: usize,
    },
    /// A bladder has a hole to the room.
    Leak {
        /// Which.
        bladder: usize,
        /// Diameter, m.
        diameter: f64,
    },
    /// The supply's gauge pressure falls to a part of what it was.
    WeakSupply {
        /// What is left of it, 0 to 1.
        left: f64,
    },
    /// Nothing comes back to the camera: its images are empty.
    BlindCamera,
    /// The camera sends nothing.
    SilentCamera,
    /// Duties get lost on their way.
    LostDuties {
        /// The part that arrives, 0 to 1.
        left: f64,
    },
}

impl Fault {
    /// Its bit in a [`RigState`](stillpoint_samples::RigState).
    pub fn bit(&self) -> u32 {
        match self {
            Self::StuckValve { .. } => 1,
            Self::Leak { .. } => 2,
            Self::WeakSupply { .. } => 4,
            Self::BlindCamera => 8,
            Self::SilentCamera => 16,
            Self::LostDuties { .. } => 32,
        }
    }
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheduled {
    /// What breaks.
    pub fault: Fault,
    /// When, ns after the rig's start.
    pub begin: u64,
    /// When it is mended, ns after the rig's start.
    pub end: u64,
}

impl Scheduled {
    /// Whether it acts at a time, ns after the rig's start.
    pub fn acts(&self, at: u64) -> bool {
        (self.begin..self.end).contains(&at)
    }
}
