//! The rig as the far end of datagrams.

use stillpoint_actuate::{Key, LONGEST, Message, Order, Receiving, Safe, Session, encode};
use stillpoint_pipeline::files::KeptFiles;
use stillpoint_pipeline::operator::{
    FrameRule, Kind, Output, Registry, Role, SetupError, Stage, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{Datagram, FarEnd, FarEndDoing, FarEndElement, RigMode, RigState, Sample};
use stillpoint_testing::{Run, run};

use super::script::heights;

const KEY: &str = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f";
const OTHER: &str = "ff0102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f";

/// A sender that rests for its first 200 ms and then has the base's inlet opened.
#[derive(Clone, Params)]
struct SenderParams {
    /// Its key file.
    #[param(file)]
    key: String,
    /// When it falls silent.
    #[param(unit = "ns", default = "1 h")]
    silent_from: u64,
}

struct Sender {
    params: SenderParams,
    key: Key,
    begin: Option<u64>,
}

impl Operator for Sender {
    type Params = SenderParams;
    const KIND: Kind = Kind {
        name: "test.sender",
        about: "Datagrams that a test writes down.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[
            Output {
                name: "datagram",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "For the valves.",
            },
            Output { name: "beam", sample: Datagram::KIND, frame: FrameRule::None, about: "For the beam." },
        ],
        timer: Timer::Required,
    };

    fn new(params: SenderParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let key = Key::parse(&setup.file(&params.key)?).map_err(|e| SetupError(e.to_string()))?;
        Ok(Self { params, key, begin: None })
    }

    fn capacities(_: &SenderParams) -> Vec<usize> {
        vec![LONGEST, LONGEST]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let begin = *self.begin.get_or_insert(activation.time);
        let since = activation.time - begin;
        if since >= self.params.silent_from {
            return Ok(());
        }
        let session = Session { started: begin, nonce: 5 };
        for (port, receiving) in [Receiving::Valves, Receiving::Beam].into_iter().enumerate() {
            let mut message = Message {
                sequence: activation.index,
                stamp: activation.time,
                ..Message::resting(receiving, session)
            };
            if since >= 200_000_000 {
                message.order = Order::Follow;
            }
            if receiving == Receiving::Valves {
                message.safe = Safe::Vent;
                if since >= 200_000_000 {
                    message.valves = 6;
                    message.duty[0] = 0.3;
                }
            }
            let mut bytes = [0; LONGEST];
            let count = encode(&message, &self.key, &mut bytes).map_err(|e| StepError(e.to_string()))?;
            outputs.send_slice::<Datagram>(port, &(), &bytes[..count])?;
        }
        Ok(())
    }
}

const STAGES: &[Stage] = &[Stage::of::<Sender>()];

fn text(sender: &str, rig: &str, inputs: &str) -> String {
    format!(
        "
stillpoint: 1
name: rig
seed: 7
frames: {{ camera: {{ parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] }} }}
operators:
  sender: {{ use: test.sender, every: 10 ms, params: {{ {sender} }} }}
  rig:
    use: rig.three_bladders
    every: 10 ms
    frame: camera
    inputs: {{ {inputs} }}
    params: {{ motion: still, camera: {{ width: 64 px, height: 48 px, focal_length: 56 px }}, {rig} }}
"
    )
}

const BOTH: &str =
    "datagram: { from: sender.datagram, delay: 2 ms }, beam: { from: sender.beam, delay: 2 ms }";

fn attempt(text: &str, ms: u64) -> Result<Run, String> {
    let mut files = KeptFiles::default();
    files.files.insert("rig.key".into(), KEY.into());
    files.files.insert("other.key".into(), OTHER.into());
    run(text, &Registry::new(&[stillpoint_rig::STAGES, STAGES]), &files, ms)
}

fn account(run: &Run, tick: usize) -> FarEndElement {
    *run.samples::<FarEnd>("rig.far_end")[tick].first().unwrap()
}

fn mode(run: &Run, tick: usize) -> RigMode {
    run.samples::<RigState>("rig.state")[tick].first().unwrap().mode()
}

#[test]
fn the_valves_follow_datagrams_and_vent_when_they_stop_after_the_beam() {
    let run = attempt(&text("key: rig.key, silent_from: 1500 ms", "key: rig.key", BOTH), 4000).unwrap();
    assert!(run.failed().is_empty());
    assert_eq!(
        (mode(&run, 0), mode(&run, 10), mode(&run, 100)),
        (RigMode::Waiting, RigMode::Holding, RigMode::Driven)
    );
    assert_eq!(mode(&run, 399), RigMode::Venting);
    let heights = heights(&run);
    assert!(
        heights[150] > heights[0] + 1e-3 && heights[399] < heights[155],
        "{} {}",
        heights[0],
        heights[150]
    );
    let accounts: Vec<FarEndElement> =
        run.samples::<FarEnd>("rig.far_end").iter().map(|a| *a.first().unwrap()).collect();
    let (beam, vent) = (
        accounts.iter().rposition(|a| a.beam == 1).unwrap(),
        accounts.iter().position(|a| a.doing() == FarEndDoing::Venting).unwrap(),
    );
    // The last datagram was made at 1490 ms and lives for 60 ms.
    assert!(beam < vent && (155..=157).contains(&vent), "{beam} {vent}");
    let last = accounts.last().unwrap();
    assert_eq!((last.accepted, last.refused, last.refused_beam), (150, 0, 0));
}

#[test]
fn datagrams_of_another_key_are_refused_and_counted_and_the_rig_waits() {
    let run = attempt(&text("key: other.key", "key: rig.key", BOTH), 1000).unwrap();
    let last = account(&run, 99);
    assert_eq!((last.accepted, mode(&run, 99)), (0, RigMode::Waiting));
    assert!(last.refused > 90 && last.refused_beam + last.refused > 180, "{last:?}");
}

#[test]
fn datagrams_that_all_get_lost_are_missed() {
    let faults = "key: rig.key, faults: [{ kind: lost_duties, at: 1 s, lasts: 500 ms }]";
    let run = attempt(&text("key: rig.key", faults, BOTH), 3000).unwrap();
    assert_eq!(
        (mode(&run, 90), mode(&run, 120), mode(&run, 299)),
        (RigMode::Driven, RigMode::Venting, RigMode::Driven)
    );
    assert!((45..=55).contains(&account(&run, 299).missing), "{:?}", account(&run, 299));
}

#[test]
fn datagrams_without_a_key_and_a_key_without_datagrams_are_refused() {
    let said = |text: &str| attempt(text, 100).err().unwrap();
    let without = said(&text("key: rig.key", "head_mass: 5 kg", BOTH));
    assert!(without.contains("datagrams are not taken without a key"), "{without}");
    let idle = said(&text("key: rig.key", "key: rig.key", ""));
    assert!(idle.contains("no datagrams come"), "{idle}");
}
