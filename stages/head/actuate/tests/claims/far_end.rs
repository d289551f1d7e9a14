//! `actuate.far_end` behind valves and gate, in the simulated executor.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{Actuation, Diagnostics, Duties, DutiesElement, FarEnd, FarEndDoing, FarEndElement};
use stillpoint_testing::run::{Run, START};

use super::whole::{Said, files, registry, text};

const OTHER_KEY: &[u8] = b"ff112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef";

fn run(description: &Said<'_>, key: &str, ms: u64) -> Run {
    let far = format!(
        "  far: {{ use: actuate.far_end, every: 5 ms, params: {{ key: {key} }}, \
         inputs: {{ valves: {{ from: valves.datagram, delay: 2 ms }}, beam: {{ from: gate.datagram, delay: 2 ms }} }} }}\n"
    );
    let mut files: MemoryFiles = files();
    files.files.insert("other.key".to_string(), OTHER_KEY.to_vec());
    stillpoint_testing::run(&(text(description) + &far), &registry(), &files, ms).unwrap()
}

fn states(run: &Run) -> Vec<(u64, FarEndElement)> {
    let samples = run.samples::<FarEnd>("far.state");
    samples.iter().map(|s| ((s.header.stamp - START) / 1_000_000, *s.first().unwrap())).collect()
}

fn last_duties(run: &Run) -> DutiesElement {
    *run.samples::<Duties>("far.duties").last().unwrap().first().unwrap()
}

#[test]
fn it_holds_until_armed_then_follows_what_was_sent_and_lets_the_beam_on() {
    let run = run(&Said::default(), "rig.key", 2_000);
    assert_eq!(run.failed(), [] as [&str; 0]);
    let states = states(&run);
    let at = |ms: u64| states.iter().find(|(t, _)| *t >= ms).unwrap().1;
    assert_eq!(at(0).doing(), FarEndDoing::Venting, "before the first datagram");
    assert_eq!(at(300).doing(), FarEndDoing::Holding, "the program is there and not armed");
    assert_eq!((at(1900).doing(), at(1900).beam), (FarEndDoing::Following, 1));
    assert_eq!((at(1900).refused, at(1900).refused_beam, at(1900).missing), (0, 0, 0));
    assert!(at(1900).ends > at(1900).arrived && at(1900).arrived < START + 1_900_000_000 + 5_000_000);
    let sent = run.samples::<Actuation>("valves.state");
    let sent = sent[sent.len() - 2].first().unwrap().duty;
    for (done, sent) in last_duties(&run).duty.iter().zip(sent) {
        assert!((done - f64::from(sent as f32)).abs() < 1e-3, "{done} is not {sent}");
    }
}

#[test]
fn with_another_key_it_vents_and_counts_every_datagram_as_forged() {
    let run = run(&Said::default(), "other.key", 1_000);
    let (_, last) = *states(&run).last().unwrap();
    assert_eq!((last.doing(), last.beam, last.accepted), (FarEndDoing::Venting, 0, 0));
    assert!(last.refused > 50);
    let duties = last_duties(&run);
    assert_eq!(duties.duty[..6], [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
    let reported = run.samples::<Diagnostics>("far.diagnostics");
    let forged = reported.last().unwrap().elements.iter().find(|m| m.name() == "forged").unwrap().value;
    assert_eq!(forged, (last.refused + last.refused_beam) as f64);
}
