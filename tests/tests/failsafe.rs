//! From the last order to the safe state: asserted from the stamps of sessions, live. `stillpoint bench failsafe` makes
//! the full count.

use crate::bench::Bench;

/// Two trials of a fault; all of them must end in the safe state in time.
fn is_safe_in_time(fault: &str) {
    let bench = Bench::new();
    let rows = bench.call(&["bench", "failsafe", "--fault", fault, "--trials", "2", "--json"]).good();
    let row = &rows[0];
    assert_eq!((&row["trials"], &row["safe"]), (&2.into(), &2.into()), "{row}");
}

#[test]
fn the_rig_is_safe_in_100_ms_when_the_controller_is_killed() {
    is_safe_in_time("kill-control");
}

#[test]
fn the_rig_is_safe_in_100_ms_when_the_controller_hangs() {
    is_safe_in_time("stop-control");
}

#[test]
fn the_rig_is_safe_in_100_ms_when_the_supervisor_is_killed() {
    is_safe_in_time("kill-supervisor");
}

#[test]
fn the_rig_is_safe_100_ms_after_the_pose_is_stale() {
    is_safe_in_time("stop-perception");
}
