//! What a kind of operator is called, takes and sends.

use stillpoint_samples::SampleKind;

/// What an operator is to the outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Sees only its activations. Replay runs it again.
    Operator,
    /// Turns the outside into samples. Replay takes its recorded samples.
    Source,
}

/// How an input is consumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Every sample in order, one per activation; the oldest goes when more than this many wait.
    Queue(u32),
    /// The newest sample, held from activation to activation. It causes an activation only where the operator has
    /// neither a timer nor another kind of input.
    Latest,
    /// One sample each from all inputs of the set, their origins within this many ns of each other.
    Sync {
        /// Greatest distance of the origins, ns.
        within: u64,
    },
}

/// Which frame the samples of an output are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameRule {
    /// No frame: the numbers are not coordinates.
    None,
    /// The frame that the operator's `frame:` names; it must be given.
    Key,
    /// The frame that `frame:` names, else the frame of this input.
    KeyOr(&'static str),
    /// The frame of this input.
    SameAs(&'static str),
    /// This frame.
    Named(&'static str),
}

/// An input port of a kind of operator.
#[derive(Clone, Copy, Debug)]
pub struct Input {
    /// Name in the config.
    pub name: &'static str,
    /// What it takes.
    pub sample: &'static SampleKind,
    /// How it is consumed where the config does not say.
    pub policy: Policy,
    /// Whether the config must connect it.
    pub required: bool,
    /// Its purpose, in one line.
    pub about: &'static str,
}

/// An output port of a kind of operator.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Name in the config.
    pub name: &'static str,
    /// What it sends.
    pub sample: &'static SampleKind,
    /// Frame of its samples.
    pub frame: FrameRule,
    /// Its purpose, in one line.
    pub about: &'static str,
}

/// Whether a kind of operator has a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timer {
    /// It has none; `every:` is refused.
    No,
    /// `every:` may be given.
    Optional,
    /// `every:` must be given.
    Required,
}

/// What an operator's kind is called, takes, sends and is for.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name in the config, `family.kind`.
    pub name: &'static str,
    /// What it does, in one line.
    pub about: &'static str,
    /// Operator or source.
    pub role: Role,
    /// Input ports; their place is their number.
    pub inputs: &'static [Input],
    /// Output ports; their place is their number.
    pub outputs: &'static [Output],
    /// Whether it has a timer.
    pub timer: Timer,
}

/// Port of the topic of laps.
pub const TIMING: &str = "timing";
/// Names of topics that an operator has without saying so.
const IMPLICIT: [&str; 4] = [TIMING, "journal", "inbox", "settings"];
/// The longest name of a lap: as a metric it ends in `_s`.
const LONGEST_LAP: usize = 30;

/// Refuses a kind, when it is compiled, whose outputs would share their topic with another, or whose laps have names
/// that do not fit.
pub(crate) const fn check_names(kind: &Kind, laps: &[&str]) {
    let mut output = 0;
    while output < kind.outputs.len() {
        let mut name = 0;
        while name < IMPLICIT.len() {
            assert!(
                !is_same(kind.outputs[output].name, IMPLICIT[name]),
                "timing, journal, inbox and settings are topics that every operator may have: give the output another name"
            );
            name += 1;
        }
        output += 1;
    }
    let mut lap = 0;
    while lap < laps.len() {
        assert!(
            !laps[lap].is_empty() && laps[lap].len() <= LONGEST_LAP,
            "the name of a lap has 1 to 30 bytes"
        );
        lap += 1;
    }
}

const fn is_same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut same = a.len() == b.len();
    let mut at = 0;
    while same && at < a.len() {
        same = a[at] == b[at];
        at += 1;
    }
    same
}
