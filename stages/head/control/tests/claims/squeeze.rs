//! Bladders that are more than the channels they hold.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_testing::Bench;

/// What a law says to two channels on three bladders whose pressures nobody tells.
fn refusal(law: &str, channels: &str) -> Option<String> {
    let text = format!(
        "
stillpoint: 1
name: squeeze
frames: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}
operators:
  feed: {{ use: feed.track, frame: couch }}
  target: {{ use: control.target, every: 10 ms, inputs: {{ state: feed.out }} }}
  law: {{ use: {law}, every: 10 ms, inputs: {{ state: feed.out, target: target.reference }}, params: {{ plant: {{ channels: {channels} }} }} }}
"
    );
    Bench::new(&text, "law", stillpoint_control::STAGES, &MemoryFiles::default()).err()
}

#[test]
fn every_law_asks_for_the_pressures_where_bladders_could_squeeze_unseen() {
    for law in ["control.pi", "control.lqg", "control.mrac"] {
        assert_eq!(refusal(law, "[z, pitch, roll]"), None, "{law}");
        let message = refusal(law, "[z, roll]").unwrap();
        assert!(
            message.contains("3 bladders hold 2 channels") && message.contains("valves.state"),
            "{law}: {message}"
        );
    }
}
