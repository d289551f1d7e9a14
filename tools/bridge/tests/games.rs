//! Games over a pool: real workers, real processes, loopback.

use std::num::NonZeroUsize;
use std::process::Stdio;

use stillpoint_network::game::play;
use stillpoint_network::patient::Body;
use stillpoint_network::{Due, Patient, Rules};
use stillpoint_patient::case::{varied_phantom, write};
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool, PoolGames};

use crate::bench::two_ports;
use crate::common::{model, patient};
use crate::pool::{Ends, program};

/// Spacing of the doses: coarse, so that games are short.
const GRID_MM: f64 = 16.0;
const RULES: Rules = Rules { beams: 5, class: false, rotations: 2, proposed: 2, search: 8, random: 2 };

#[test]
fn games_of_two_workers_of_which_one_is_killed_are_those_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let case = folder.path().join("a.case");
    write(&varied_phantom(9).unwrap(), &case).unwrap();
    let of_file = Patient { body: Body::File(case), ..patient(0, GRID_MM) };
    let patients = (0..7).map(|seed| patient(seed, GRID_MM)).chain([of_file]);
    let due = |(seed, patient): (u64, Patient)| Due { name: format!("g{seed}"), patient, seed, rules: RULES };
    let games: Vec<Due> = (0..).zip(patients).map(due).collect();
    let model = model();
    let expected: Vec<Vec<u8>> = games
        .iter()
        .map(|due| play(Some(&model), &due.patient, due.seed, due.rules, NonZeroUsize::MIN).unwrap())
        .map(|game| game.to_bytes().unwrap())
        .collect();

    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let worker = |name: &str, place: &str| {
        let cache = folder.path().join(name);
        let mut command = program(&["worker", place, &endpoint, "--name", name, "--slots", "1", "--cache"]);
        Ends(command.arg(cache).stdout(Stdio::null()).spawn().unwrap())
    };
    let _good = worker("good", "--listen");
    let mut killed = Some(worker("killed", "--connect"));
    let courier = ChildCourier::start(program(&["plan-client", "--connect", &endpoint])).unwrap();
    let mut pool = Pool::new(courier, ClientSettings::new(Build::here().unwrap()));
    let mut players = PoolGames::new(NonZeroUsize::MIN);
    let mut played = vec![Vec::new(); games.len()];
    let doubtful = players.play(&mut pool, Some(&model), &games, &mut |place, game| {
        played[place] = game.to_bytes().unwrap();
        killed = None;
        Ok(())
    });
    assert!(doubtful.unwrap().is_empty());
    assert!(played == expected);
    assert!(pool.tally().remote > 0, "{:?}", pool.tally());
}
