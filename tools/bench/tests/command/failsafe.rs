//! The time from the last order to the safe state, asserted from the stamps of live sessions.
//! `stillpoint bench failsafe` runs a hundred trials of each fault.

use std::sync::Mutex;

use crate::reported;

const TRIALS: &str = "1";
/// Permits one run of the pipeline at a time: two runs would compete for the cores.
static LOOP: Mutex<()> = Mutex::new(());

/// Runs trials of a fault. Each must have the required reaction in time, the reason in the session, and no jump of a
/// duty.
fn is_safe_in_time(fault: &str) {
    let _one = LOOP.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let rows = reported(folder.path(), &["failsafe", "--fault", fault, "--trials", TRIALS, "--json"]);
    let row = &rows[0];
    assert_eq!(row["trials"], row["safe"], "{row}");
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
fn the_rig_goes_on_when_the_supervisor_hangs() {
    is_safe_in_time("stop-supervisor");
}

#[test]
fn the_rig_is_safe_100_ms_after_the_pose_is_stale_by_a_death() {
    is_safe_in_time("kill-perception");
}

#[test]
fn the_rig_is_safe_100_ms_after_the_pose_is_stale_by_a_hang() {
    is_safe_in_time("stop-perception");
}

#[test]
fn the_rig_is_safe_100_ms_after_the_camera_is_silent_for_three_frames() {
    is_safe_in_time("silent-camera");
}

#[test]
fn the_rig_is_safe_in_100_ms_when_a_pose_is_no_number() {
    is_safe_in_time("non-finite-pose");
}

#[test]
fn the_rig_is_safe_in_100_ms_where_full_queues_keep_orders_back() {
    is_safe_in_time("full-queue");
}

#[test]
fn the_rig_goes_on_through_a_burst_of_garbage() {
    is_safe_in_time("garbage");
}

#[test]
fn the_rig_goes_on_when_the_recorder_is_killed() {
    is_safe_in_time("kill-recorder");
}

#[test]
fn the_rig_goes_on_when_the_recorder_hangs() {
    is_safe_in_time("stop-recorder");
}

#[test]
fn the_rig_goes_on_when_the_console_is_killed() {
    is_safe_in_time("kill-console");
}

#[test]
fn the_rig_goes_on_when_the_console_hangs() {
    is_safe_in_time("stop-console");
}
