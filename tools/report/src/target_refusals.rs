//! Refused targets, from the samples of a target operator.

use serde::Serialize;
use stillpoint_samples::{Channel, Codes, Names, Refusal, TargetElement};

/// Refusals that are kept one by one; more are counted.
const RETAINED: usize = 1000;
/// The channels in the order of their bits.
pub const CHANNELS: [&str; 6] = [
    Channel::X.word(),
    Channel::Y.word(),
    Channel::Z.word(),
    Channel::Pitch.word(),
    Channel::Roll.word(),
    Channel::Yaw.word(),
];

/// The refused targets of one operator.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Refusals {
    /// Targets that were asked for.
    pub asked: u32,
    /// Targets that were refused.
    pub refused: u64,
    /// The first refused targets.
    pub each: Vec<RefusedTarget>,
    /// Whether the last target was refused, so that the previous one is still valid.
    pub stands_refused: bool,
    /// Why the last refused target was refused.
    pub why: Option<String>,
}

/// A target that was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RefusedTarget {
    /// Time of the refusal, ns.
    pub stamp: u64,
    /// Why, and in which channels.
    pub why: String,
}

impl Refusals {
    /// Takes the target of this time, ns.
    pub fn take(&mut self, stamp: u64, target: &TargetElement) {
        // An operator that was restarted counts from zero again.
        if target.asked == self.asked {
            return;
        }
        self.asked = target.asked;
        self.stands_refused = target.refusal != Refusal::None as u32;
        if self.stands_refused {
            self.refused += 1;
            let why = words(target);
            if self.each.len() < RETAINED {
                self.each.push(RefusedTarget { stamp, why: why.clone() });
            }
            self.why = Some(why);
        }
    }

    /// A sentence about the refusals, if there were any.
    pub fn sentence(&self) -> Option<String> {
        let why = self.why.as_ref()?;
        let Self { asked, refused, .. } = self;
        Some(format!("{refused} of {asked} targets were refused, the last because {why}"))
    }
}

/// Why a target was refused, and in which channels.
pub fn words(target: &TargetElement) -> String {
    let why = Refusal::from_number(target.refusal)
        .map_or("of a reason that is unknown to this build", Refusal::words);
    let channels = Names::Bits(Channel::CODES).words(u64::from(target.unreachable)).unwrap_or_default();
    if channels.is_empty() { why.to_owned() } else { format!("{why} ({})", channels.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_refusal_counts_once_and_says_why() {
        let mut found = Refusals::default();
        let none = TargetElement::NONE;
        let refused = |asked, refusal: Refusal, unreachable| TargetElement {
            asked,
            refusal: refusal as u32,
            unreachable,
            ..none
        };
        found.take(0, &none);
        found.take(1, &refused(1, Refusal::None, 0));
        assert_eq!((found.sentence(), found.stands_refused), (None, false));
        for stamp in 2..5 {
            found.take(stamp, &refused(2, Refusal::Unreachable, 0b1100));
        }
        found.take(5, &refused(3, Refusal::WrongNumber, 0));
        found.take(6, &refused(4, Refusal::None, 0));
        assert_eq!((found.refused, found.asked, found.stands_refused), (2, 4, false));
        assert_eq!(found.each[0], RefusedTarget { stamp: 2, why: "it cannot be reached (z, pitch)".into() });
        assert_eq!(
            found.sentence().unwrap(),
            "2 of 4 targets were refused, the last because it needs one value for each channel that is held"
        );
    }
}
