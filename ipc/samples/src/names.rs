//! What the numbers of a field mean: the words of codes, bits and parts, declared once with the sample type.
//!
//! ```
//! use stillpoint_samples::{ActuationState, Gate, GateReason, Sample};
//! let field = |name| Gate::KIND.element.iter().find(|f| f.name == name).unwrap();
//! assert_eq!(field("beam").names.text(1).unwrap(), "on");
//! let reasons = u64::from(GateReason::POSE_STALE | GateReason::POSITION);
//! assert_eq!(field("reasons").names.text(reasons).unwrap(), "pose stale, position");
//! assert_eq!(ActuationState::Holding.word(), "holding");
//! ```

/// One name of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// The word that people read: small letters.
    pub word: &'static str,
    /// The number, or the bit.
    pub value: u64,
    /// What it means, in a sentence.
    pub about: &'static str,
}

/// The names of an enumeration or of bits. Derive it for an enum with `#[derive(Codes)]`.
pub trait Codes {
    /// All names, in the order of their numbers.
    const CODES: &'static [Code];
}

/// What the numbers of a field mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// Numbers are numbers.
    None,
    /// The number is one of these codes.
    Codes(&'static [Code]),
    /// The number is a sum of these bits.
    Bits(&'static [Code]),
    /// Bit i is set for the part i of this name, such as valve 0.
    Each(&'static str),
    /// Value i of the array belongs to the code i.
    Parts(&'static [Code]),
    /// The array is a matrix of so many rows and columns, row by row.
    Rows(usize, usize),
}

/// What bits without any set are called.
pub const NO_BITS: &str = "none";

impl Names {
    /// The words of a number: one of an enumeration, each bit of a mask. `None`: the numbers of the field have no words.
    pub fn words(&self, number: u64) -> Option<Vec<String>> {
        match self {
            Self::None | Self::Parts(_) | Self::Rows(..) => None,
            Self::Codes(codes) => Some(vec![match codes.iter().find(|c| c.value == number) {
                Some(code) => code.word.to_owned(),
                None => format!("{number} (unknown to this build)"),
            }]),
            Self::Bits(codes) => {
                let known = codes.iter().filter(|c| c.value != 0 && number & c.value == c.value);
                let mut words: Vec<String> = known.map(|c| c.word.to_owned()).collect();
                let rest = codes.iter().fold(number, |rest, c| rest & !c.value);
                words.extend(set(rest).map(|bit| format!("bit {bit} (unknown to this build)")));
                Some(words)
            }
            Self::Each(part) => Some(set(number).map(|bit| format!("{part} {bit}")).collect()),
        }
    }

    /// The words of a number as text; `none` where no bit is set.
    pub fn text(&self, number: u64) -> Option<String> {
        let words = self.words(number)?;
        Some(if words.is_empty() { NO_BITS.to_owned() } else { words.join(", ") })
    }

    /// The codes that a page lists: of an enumeration, of bits, or of the parts of an array.
    pub const fn codes(&self) -> &'static [Code] {
        match self {
            Self::Codes(codes) | Self::Bits(codes) | Self::Parts(codes) => codes,
            Self::None | Self::Each(_) | Self::Rows(..) => &[],
        }
    }
}

/// The numbers of the bits that are set.
fn set(number: u64) -> impl Iterator<Item = u32> {
    (0..u64::BITS).filter(move |bit| number >> bit & 1 == 1)
}

/// Makes a struct of bits as constants, with their words: for masks that are put together in code.
macro_rules! bits {
    ($(#[doc = $of:literal])+ $name:ident { $(#[doc = $about:literal] $bit:ident = $value:expr, $word:literal;)+ }) => {
        $(#[doc = $of])+
        pub struct $name;

        impl $name {
            $(#[doc = $about] pub const $bit: u32 = $value;)+
            /// All with the words that people read.
            pub const ALL: &'static [(&'static str, u32)] = &[$(($word, Self::$bit)),+];

            /// The words of the bits that are set, in their order.
            pub fn words(bits: u32) -> impl Iterator<Item = &'static str> {
                Self::ALL.iter().filter(move |(_, bit)| bits & bit != 0).map(|(word, _)| *word)
            }
        }

        impl $crate::Codes for $name {
            const CODES: &'static [$crate::Code] =
                &[$($crate::Code { word: $word, value: $value, about: $about.trim_ascii() }),+];
        }
    };
}
pub(crate) use bits;

macro_rules! derived {
    ($($(#[doc = $of:literal])+ $name:ident { $(#[doc = $about:literal] $variant:ident = $value:expr;)+ })+) => { $(
        $(#[doc = $of])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, crate::Codes)]
        #[repr(u32)]
        #[allow(missing_docs)]
        pub enum $name { $(#[doc = $about] $variant = $value),+ }
    )+ };
}

derived! {
    /// A flag.
    YesNo {
        /// It is not so.
        No = 0;
        /// It is so.
        Yes = 1;
    }
    /// Whether the beam may be on.
    OnOff {
        /// The beam must be off.
        Off = 0;
        /// The beam may be on.
        On = 1;
    }
    /// The axes of a vector.
    Axis {
        /// Along x.
        X = 0;
        /// Along y.
        Y = 1;
        /// Along z.
        Z = 2;
    }
    /// The angles of an orientation.
    Angle {
        /// About x.
        Pitch = 0;
        /// About y.
        Roll = 1;
        /// About z.
        Yaw = 2;
    }
    /// The parts of a unit quaternion.
    Quaternion {
        /// The scalar.
        W = 0;
        /// Along x.
        X = 1;
        /// Along y.
        Y = 2;
        /// Along z.
        Z = 3;
    }
    /// The channels of a pose, as bits.
    Channel {
        /// Position along x.
        X = 1;
        /// Position along y.
        Y = 2;
        /// Position along z.
        Z = 4;
        /// Rotation about x.
        Pitch = 8;
        /// Rotation about y.
        Roll = 16;
        /// Rotation about z.
        Yaw = 32;
    }
    /// What the valves are told.
    ValveOrder {
        /// All valves are shut.
        Shut = 0;
        /// Inlets are shut, outlets open.
        Vent = 1;
        /// The valves follow the duties.
        Follow = 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ActuationReason, DutyReason, GateReason, RigFault};

    #[test]
    fn bits_have_their_words_and_unknown_ones_their_number() {
        let names = Names::Bits(GateReason::CODES);
        assert_eq!(names.text(0).as_deref(), Some("none"));
        let two = u64::from(GateReason::POSE_STALE | GateReason::PLAN);
        assert_eq!(names.text(two).as_deref(), Some("pose stale, plan"));
        assert_eq!(names.text(1 << 30).as_deref(), Some("bit 30 (unknown to this build)"));
        assert_eq!(Names::Each("valve").text(0b101).as_deref(), Some("valve 0, valve 2"));
        assert_eq!(Names::None.text(7), None);
    }

    #[test]
    fn codes_have_their_word_and_unknown_ones_their_number() {
        let names = Names::Codes(ValveOrder::CODES);
        assert_eq!(names.text(2).as_deref(), Some("follow"));
        assert_eq!(names.text(9).as_deref(), Some("9 (unknown to this build)"));
        assert_eq!(ValveOrder::from_number(1), Some(ValveOrder::Vent));
        assert_eq!(ValveOrder::from_number(9), None);
        assert_eq!(RigFault::StuckValve.word(), "stuck_valve");
    }

    #[test]
    fn no_table_gives_a_number_or_a_word_twice() {
        for codes in
            crate::all().iter().flat_map(|kind| kind.body.iter().chain(kind.element)).map(|f| f.names.codes())
        {
            for (i, code) in codes.iter().enumerate() {
                assert!(codes[..i].iter().all(|c| c.value != code.value && c.word != code.word), "{code:?}");
                assert!(!code.about.is_empty(), "{code:?} says nothing about itself");
            }
        }
        for codes in [GateReason::CODES, ActuationReason::CODES, DutyReason::CODES] {
            assert!(codes.iter().all(|c| c.value.is_power_of_two()));
        }
    }
}
