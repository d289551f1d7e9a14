//! Sessions of every release: each stays here as it was recorded, and replays with every later build.

use std::path::Path;

use crate::bench::{Bench, text};

/// A session of a release, and how many samples of it are compared.
const SESSIONS: &[(&str, u64)] = &[("0.1.0", 608)];

#[test]
fn the_session_of_every_release_replays_bit_for_bit() {
    let bench = Bench::new();
    for (release, compared) in SESSIONS {
        let session = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/sessions/{release}.mcap"));
        let replay = bench.call(&["replay", text(&session), "--json"]).good();
        assert_eq!(replay["identical_all"], true, "{release}");
        let identical = replay["identical"].as_object().unwrap().values().map(|n| n.as_u64().unwrap());
        assert_eq!(identical.sum::<u64>(), *compared, "{release}");
    }
}
