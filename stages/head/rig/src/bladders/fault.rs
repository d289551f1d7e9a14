//! The faults of a rig, and their times.

use stillpoint_samples::{Command, RigFault};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// A valve keeps the opening that it has. Inlet and outlet of the first bladder are 0 and 1, and so on.
    StuckValve {
        /// Number of the valve, from 0.
        valve: usize,
    },
    /// A bladder has a hole to the room.
    Leak {
        /// Number of the bladder, from 0.
        bladder: usize,
        /// Diameter, m.
        diameter: f64,
    },
    /// The supply's gauge pressure falls to a part of what it was.
    WeakSupply {
        /// The fraction that is left, 0 to 1.
        left: f64,
    },
    /// The camera measures nothing: its images are empty.
    BlindCamera,
    /// The camera sends no images.
    SilentCamera,
    /// The camera sends the first image that it takes while it is broken, again and again, as if it were new.
    FrozenCamera,
    /// Duties get lost on their way.
    LostDuties {
        /// The part that arrives, 0 to 1.
        left: f64,
    },
}

impl Fault {
    /// Its bit in a [`RigState`](stillpoint_samples::RigState).
    pub fn bit(&self) -> u32 {
        let fault = match self {
            Self::StuckValve { .. } => RigFault::StuckValve,
            Self::Leak { .. } => RigFault::Leak,
            Self::WeakSupply { .. } => RigFault::WeakSupply,
            Self::BlindCamera => RigFault::BlindCamera,
            Self::SilentCamera => RigFault::SilentCamera,
            Self::FrozenCamera => RigFault::FrozenCamera,
            Self::LostDuties { .. } => RigFault::LostDuties,
        };
        fault as u32
    }
}

/// What a person says to a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultText {
    /// Begin this fault, for this many ns, or until it is removed.
    Break(Fault, Option<u64>),
    /// Remove all faults that people began.
    Mend,
}

/// Why a rig does not take the command of a fault.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FaultError {
    #[error("the fault has no name: give one, or 0 to remove all faults")]
    Unnamed,
    #[error("the number of the valve or bladder must be a whole number from 0")]
    Part,
    #[error("the fraction that is left must be from 0 to 1")]
    Left,
    #[error("there is no fault {0}")]
    Unknown(f64),
    #[error("a leak has a diameter above 0 m, up to {LARGEST_LEAK} m")]
    Diameter,
    #[error("a fault lasts longer than 0 s, up to {LONGEST} s")]
    Lasts,
    #[error("invalid number of the {what}: {part} (allowed: 0 to {})", count.saturating_sub(1))]
    Number { what: &'static str, part: usize, count: usize },
}

impl FaultText {
    /// What a command says: fault, part, amount and seconds, as far as they are given.
    ///
    /// # Errors
    /// The reason why a value is refused.
    pub fn of(command: &Command) -> Result<Self, FaultError> {
        let given = (command.given as usize).min(command.values.len());
        let value = |i: usize| command.values[..given].get(i).copied();
        let Some(kind) = value(0) else {
            return Err(FaultError::Unnamed);
        };
        if kind == 0.0 {
            return Ok(Self::Mend);
        }
        let which = whole(value(1).unwrap_or(0.0)).ok_or(FaultError::Part)?;
        let left = || {
            let left = value(2).unwrap_or(0.0);
            (0.0..=1.0).contains(&left).then_some(left).ok_or(FaultError::Left)
        };
        let known =
            RigFault::ALL.iter().map(|(_, fault)| *fault).find(|fault| f64::from(*fault as u32) == kind);
        let fault = match known.ok_or(FaultError::Unknown(kind))? {
            RigFault::StuckValve => Fault::StuckValve { valve: which },
            RigFault::Leak => {
                let diameter = value(2).unwrap_or(LEAK);
                if !(diameter > 0.0 && diameter <= LARGEST_LEAK) {
                    return Err(FaultError::Diameter);
                }
                Fault::Leak { bladder: which, diameter }
            }
            RigFault::WeakSupply => Fault::WeakSupply { left: left()? },
            RigFault::BlindCamera => Fault::BlindCamera,
            RigFault::SilentCamera => Fault::SilentCamera,
            RigFault::FrozenCamera => Fault::FrozenCamera,
            RigFault::LostDuties => Fault::LostDuties { left: left()? },
        };
        let lasts = match value(3) {
            None => None,
            Some(seconds) if seconds > 0.0 && seconds <= LONGEST => Some((seconds * 1e9) as u64),
            Some(_) => return Err(FaultError::Lasts),
        };
        Ok(Self::Break(fault, lasts))
    }
}

impl FaultText {
    /// Refuses a part that a rig of so many bladders does not have.
    ///
    /// # Errors
    /// The number of the valve or bladder, and those that there are.
    pub fn check(&self, bladders: usize) -> Result<(), FaultError> {
        let (what, part, count) = match self {
            Self::Break(Fault::StuckValve { valve }, _) => ("valve", *valve, 2 * bladders),
            Self::Break(Fault::Leak { bladder, .. }, _) => ("bladder", *bladder, bladders),
            _ => return Ok(()),
        };
        if part < count {
            return Ok(());
        }
        Err(FaultError::Number { what, part, count })
    }
}

/// Diameter of a leak if none is given, m.
const LEAK: f64 = 0.5e-3;
const LARGEST_LEAK: f64 = 10e-3;
/// s.
const LONGEST: f64 = 36e6;

fn whole(value: f64) -> Option<usize> {
    ((0.0..=255.0).contains(&value) && value.fract() == 0.0).then_some(value as usize)
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheduled {
    pub fault: Fault,
    /// When, ns after the rig's start.
    pub begin: u64,
    /// Time at which it ends, ns after the rig's start.
    pub end: u64,
}

impl Scheduled {
    /// Whether it acts at a time, ns after the rig's start.
    pub fn acts(&self, at: u64) -> bool {
        (self.begin..self.end).contains(&at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reported(values: &[f64]) -> Result<FaultText, FaultError> {
        let mut command = Command { given: values.len() as u32, ..Command::default() };
        command.values[..values.len()].copy_from_slice(values);
        FaultText::of(&command)
    }

    #[test]
    fn a_command_says_what_breaks_and_for_how_long() {
        let leak = Fault::Leak { bladder: 2, diameter: 1e-3 };
        assert_eq!(reported(&[2.0, 2.0, 1e-3, 1.5]), Ok(FaultText::Break(leak, Some(1_500_000_000))));
        assert_eq!(reported(&[1.0, 5.0]), Ok(FaultText::Break(Fault::StuckValve { valve: 5 }, None)));
        assert_eq!(reported(&[4.0, 0.0, 0.8]), Ok(FaultText::Break(Fault::WeakSupply { left: 0.8 }, None)));
        assert_eq!(reported(&[16.0]), Ok(FaultText::Break(Fault::SilentCamera, None)));
        assert_eq!(reported(&[0.0]), Ok(FaultText::Mend));
    }

    #[test]
    fn a_command_that_makes_no_sense_is_refused_with_words() {
        let bad: [&[f64]; 8] = [
            &[],
            &[3.0],
            &[f64::NAN],
            &[1.0, 0.5],
            &[2.0, 0.0, 0.0],
            &[4.0, 0.0, 1.1],
            &[8.0, 0.0, 0.0, 0.0],
            &[8.0, 0.0, 0.0, f64::INFINITY],
        ];
        for values in bad {
            assert!(reported(values).is_err(), "{values:?}");
        }
    }
}
