//! Games over the pool are those of one process.

use std::num::NonZeroUsize;

use stillpoint_network::game::play;
use stillpoint_network::patient::Body;
use stillpoint_network::{Due, Model, Patient, Rules};
use stillpoint_patient::case::{varied_phantom, write};
use stillpoint_pool::{Call, ClientSettings, Pool, PoolGames};

use crate::common::{model, patient};
use crate::simulated::{CALM, Part, Simulated, build};

/// Spacing of the doses: coarse, so that games are short.
pub const GRID_MM: f64 = 24.0;
const RULES: Rules = Rules { beams: 5, class: false, rotations: 1, proposed: 1, search: 6, random: 1 };

fn due(name: &str, patient: Patient, seed: u64) -> Due {
    Due { name: name.to_owned(), patient, seed, rules: RULES }
}

/// Games of phantoms, and one of a case file.
fn games(folder: &std::path::Path) -> Vec<Due> {
    let path = folder.join("a.case");
    write(&varied_phantom(3).unwrap(), &path).unwrap();
    let mut games: Vec<Due> =
        (0..2).map(|seed| due(&format!("g{seed}"), patient(seed, GRID_MM), seed)).collect();
    games.push(due("file", Patient { body: Body::File(path), ..patient(0, GRID_MM) }, 7));
    games
}

fn alone(network: Option<&Model>, games: &[Due]) -> Vec<Vec<u8>> {
    let bytes = |due: &Due| {
        play(network, &due.patient, due.seed, due.rules, NonZeroUsize::MIN).unwrap().to_bytes().unwrap()
    };
    games.iter().map(bytes).collect()
}

/// The bytes of these games over a pool, and the earlier ones that are in doubt.
fn pooled(
    players: &mut PoolGames,
    pool: &mut Pool<Simulated>,
    network: Option<&Model>,
    games: &[Due],
) -> (Vec<Vec<u8>>, Vec<String>) {
    let mut played = vec![Vec::new(); games.len()];
    let doubtful = players.play(pool, network, games, &mut |place, game| {
        played[place] = game.to_bytes().unwrap();
        Ok(())
    });
    (played, doubtful.unwrap())
}

fn pool(checked: f64, parts: &[Part]) -> Pool<Simulated> {
    let settings = ClientSettings { checked, ..ClientSettings::new(build()) };
    Pool::new(Simulated::new(1, CALM, parts), settings)
}

#[test]
fn games_are_the_same_with_no_worker_one_and_three_and_with_workers_that_are_killed() {
    let folder = tempfile::tempdir().unwrap();
    let games = games(folder.path());
    let model = model();
    let expected = alone(Some(&model), &games);
    let dying = Part { dies_after: 2, ..Part::default() };
    for parts in [vec![], vec![Part::default()], vec![Part::default(); 3], vec![dying]] {
        let (workers, dies) = (parts.len(), parts.iter().any(|part| part.dies_after > 0));
        let mut pool = pool(0.0, &parts);
        let mut players = PoolGames::new(NonZeroUsize::MIN);
        let (played, doubtful) = pooled(&mut players, &mut pool, Some(&model), &games);
        assert!(played == expected && doubtful.is_empty(), "{workers} workers");
        assert_eq!(pool.courier().jobs().iter().sum::<usize>() > 0, workers > 0);
        assert_eq!(pool.courier().deaths > 0, dies);
    }
}

#[test]
fn games_of_a_worker_that_lies_later_are_played_again_or_named() {
    let games: Vec<Due> =
        (10..20).map(|seed| due(&format!("g{seed}"), patient(seed, GRID_MM), seed)).collect();
    let expected = alone(None, &games);
    // Its first answer is compared, some of the later ones are not.
    let parts = [Part { wrong_from: 2, ..Part::default() }, Part::default()];
    let mut pool = pool(0.3, &parts);
    let mut players = PoolGames::new(NonZeroUsize::MIN);
    let (mut played, mut named) = (Vec::new(), Vec::new());
    for games in games.chunks(2) {
        let (bytes, doubtful) = pooled(&mut players, &mut pool, None, games);
        played.extend(bytes);
        named.extend(doubtful);
    }
    assert!(pool.workers()["w0"].shut_out.is_some(), "{:?}", pool.take_news());
    // Games that went out before it was caught, and that nothing compared.
    assert!(!named.is_empty());
    for ((due, played), expected) in games.iter().zip(&played).zip(&expected) {
        assert!(played == expected || named.contains(&due.name), "{}", due.name);
    }
}

#[test]
fn a_game_that_nobody_can_play_is_an_error_with_its_name() {
    let rules = Rules { beams: 40, ..RULES };
    let games = [Due { rules, ..due("crowded", patient(1, GRID_MM), 1) }];
    let mut pool = pool(0.0, &[Part::default()]);
    let mut players = PoolGames::new(NonZeroUsize::MIN);
    let fault = players.play(&mut pool, None, &games, &mut |_, _| Ok(())).unwrap_err();
    assert!(fault.to_string().starts_with("crowded, varied-1-plain: "), "{fault}");
}

#[test]
fn the_call_of_a_game_is_read_as_it_is_written_and_needs_a_case_for_a_case_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let hash = stillpoint_pool::Hash::of(b"case");
    for Due { patient, seed, rules, .. } in games(folder.path()) {
        let is_file = matches!(patient.body, Body::File(_));
        let call = |case| Call::Game { network: Some(hash), case, patient: patient.clone(), seed, rules };
        let (with, without) = (call(Some(hash)), call(None));
        let (good, bad) = if is_file { (with, without) } else { (without, with) };
        assert_eq!(Call::from_bytes(&good.to_bytes()).unwrap(), good);
        assert!(Call::from_bytes(&bad.to_bytes()).is_err());
        assert_eq!(good.inputs(), [hash]);
    }
}
