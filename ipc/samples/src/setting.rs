//! Changes of parameters while a pipeline runs, and the answers of operators.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::names::YesNo;
use crate::{Layout, Sample, SampleKind, Shape};

/// A change of a live parameter. It reaches every operator that has live parameters; the one that the path names takes it.
pub struct Setting;

/// The fields of a [`Setting`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct SettingElement {
    /// Operator and parameter, such as `law.proportional`, in ASCII, filled with zeros.
    pub path: [u8; 96],
    /// The value as a config would write it, in UTF-8, filled with zeros.
    pub value: [u8; 160],
    /// Who sent it, in ASCII, filled with zeros.
    pub by: [u8; 32],
}

/// What an operator answers to a change of one of its parameters.
pub struct SettingAnswer;

/// The fields of a [`SettingAnswer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct SettingAnswerElement {
    /// Sequence number of the change that is answered.
    pub setting: u64,
    /// Changes that the operator took since it began, this one included: where `taken` is 1, the value holds in this
    /// generation.
    pub generation: u64,
    /// Number of the first activation in which the parameters of this generation hold.
    pub from: u64,
    /// Incarnation of the console that sent the change.
    pub console_incarnation: u32,
    /// Whether the operator took the value.
    #[codes(YesNo)]
    pub taken: u32,
    /// Operator and parameter, as in the change.
    pub path: [u8; 96],
    /// The value, as in the change.
    pub value: [u8; 160],
    /// Why the value was refused, in UTF-8, filled with zeros; empty where it was taken.
    pub reason: [u8; 256],
}

/// Bytes of a text that is filled with zeros, cut between two characters where it is too long.
pub fn filled<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

/// The text in bytes that are filled with zeros; empty where it is not UTF-8.
pub fn text(bytes: &[u8]) -> &str {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    std::str::from_utf8(&bytes[..end]).unwrap_or("")
}

impl SettingElement {
    /// A change. `None`: path or value has no room.
    pub fn new(path: &str, value: &str, by: &str) -> Option<Self> {
        let element = Self { path: filled(path), value: filled(value), by: filled(by) };
        (element.path() == path && element.value() == value).then_some(element)
    }

    /// Operator and parameter.
    pub fn path(&self) -> &str {
        text(&self.path)
    }

    /// The value as a config would write it.
    pub fn value(&self) -> &str {
        text(&self.value)
    }

    /// Who sent it.
    pub fn by(&self) -> &str {
        text(&self.by)
    }
}

impl SettingAnswerElement {
    /// Operator and parameter.
    pub fn path(&self) -> &str {
        text(&self.path)
    }

    /// The value as a config would write it.
    pub fn value(&self) -> &str {
        text(&self.value)
    }

    /// Why the value was refused; `None` where it was taken.
    pub fn refusal(&self) -> Option<&str> {
        (self.taken == YesNo::No as u32).then(|| text(&self.reason))
    }
}

impl Sample for Setting {
    type Body = ();
    type Element = SettingElement;
    const NAME: &'static str = "Setting";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "A change of a parameter of a running pipeline.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

impl Sample for SettingAnswer {
    type Body = ();
    type Element = SettingAnswerElement;
    const NAME: &'static str = "SettingAnswer";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str =
        "Whether an operator took a change of a parameter, and from when on it holds.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_or_value_without_room_is_no_change_and_a_long_reason_is_cut_between_characters() {
        assert!(SettingElement::new(&"p".repeat(97), "1", "").is_none());
        assert!(SettingElement::new("law.gain", &"1".repeat(161), "").is_none());
        assert!(SettingElement::new("law.gain", "a\0b", "").is_none());
        assert_eq!(text(&filled::<4>("abc→")), "abc");
    }
}
