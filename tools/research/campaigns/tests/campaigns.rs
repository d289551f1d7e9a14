//! Arguments of campaigns.

use crate::bench::Bench;

#[test]
fn arguments_with_which_a_campaign_measures_nothing_are_refused() {
    let bench = Bench::new();
    for (campaign, option, wrong) in [
        ("identity", "scenes", "0"),
        ("identity", "rate", "20"),
        ("step", "seeds", "0"),
        ("step", "seconds", "nan"),
        ("step", "threads", "0"),
        ("robust", "seeds", "0"),
        ("robust", "seconds", "0"),
        ("tune", "rounds", "0"),
        ("tune", "held-out", "0"),
    ] {
        let done = bench.call(&[campaign, &format!("--{option}"), wrong]);
        assert_eq!(done.code(), 2, "{campaign} --{option} {wrong}: {}", done.err);
        assert!(done.err.contains(&format!("invalid value '{wrong}' for '--{option}")), "{}", done.err);
    }
}
