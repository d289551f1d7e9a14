//! Self-play with processes: a killed player and a killed training change nothing.

use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;

use crate::bench::{Bench, lives, wait_for};

/// A phantom to begin with and one to validate with, and two rounds of a game, on very coarse doses.
fn training(bench: &Bench, folder: &str, players: &str) -> Command {
    bench.command(&[
        "train",
        "planner",
        "--grid",
        "12mm",
        "--bixel",
        "24mm",
        "--first",
        "100002",
        "--train",
        "1",
        "--validate",
        "1",
        "--test",
        "0",
        "--start",
        "2",
        "--rounds",
        "2",
        "--games",
        "1",
        "--passes",
        "1",
        "--end",
        "1",
        "--players",
        players,
        "--data",
        folder,
        "--out",
        &format!("{folder}/planner"),
    ])
}

#[test]
fn self_play_with_a_killed_player_and_a_killed_training_resumes_to_the_same_weights() {
    let patience = Duration::from_secs(600);
    let bench = Bench::new();
    let whole = bench.begin(training(&bench, "whole", "2")).finish_within(patience);
    assert_eq!(whole.code(), 0, "{}", whole.err);
    let strength = |rounds: usize| format!("after {rounds} rounds: the first set of the network is ");
    assert!((0..3).all(|rounds| whole.err.contains(&strength(rounds))), "{}", whole.err);

    // It takes long to find the best sets of the phantom that is examined.
    std::fs::create_dir_all(bench.path("cut/games")).unwrap();
    let reference = "games/reference-varied-100003-plain.json";
    std::fs::copy(bench.path(&format!("whole/{reference}")), bench.path(&format!("cut/{reference}")))
        .unwrap();
    let cut = bench.begin(training(&bench, "cut", "1"));
    let player = cut.kill("player", 0);
    // Another takes its place and plays its game.
    cut.child("player", player);
    wait_for("a game of the first round", || {
        bench.path("cut/games/round-000-0000.json").exists().then_some(())
    });
    let player = cut.child("player", player);
    cut.signal(Signal::KILL);
    wait_for("the end of the player", || (!lives(player)).then_some(()));
    drop(cut);
    assert!(!bench.path("cut/planner.safetensors").exists());

    let resumed = bench.begin(training(&bench, "cut", "2")).finish_within(patience);
    assert_eq!(resumed.code(), 0, "{}", resumed.err);
    let file = |name: &str| std::fs::read(bench.path(name)).unwrap();
    assert_eq!(file("cut/planner.safetensors"), file("whole/planner.safetensors"));
    for game in std::fs::read_dir(bench.path("whole/games")).unwrap() {
        let name = game.unwrap().file_name().into_string().unwrap();
        assert_eq!(file(&format!("cut/games/{name}")), file(&format!("whole/games/{name}")), "{name}");
    }
    assert!(file("whole/planner-strength.svg").starts_with(b"<svg"));
    // The run that was killed has left nothing.
    assert_eq!(bench.run_ids(), [""; 0]);
}
