//! The controllers side by side on the rig: heads of other masses, and a noisy pose.

use stillpoint_operator::files::MemoryFiles;

use super::loops::{STEP, rise, worst_after};
use super::plants::{closed_loop_with, truth};

/// The network that comes with the project.
const SHIPPED: &[u8] = include_bytes!("../../data/controller-3dof.safetensors");

/// Root mean square of the distance from the target over the last `seconds` of a run of 80 s, mm and degrees.
fn rms(run: &stillpoint_testing::Run, seconds: f64) -> [f64; 3] {
    let truth = truth(run);
    let (start, end) = (truth[0].1, truth.last().unwrap().0);
    let late: Vec<[f64; 3]> = truth
        .iter()
        .filter(|(t, _)| *t > end - seconds)
        .map(|(_, at)| {
            let moved =
                [(at[0] - start[0]) * 1e3, (at[1] - start[1]).to_degrees(), (at[2] - start[2]).to_degrees()];
            [moved[0] - 11.5, moved[1] - 1.35, moved[2] - 10.0]
        })
        .collect();
    std::array::from_fn(|i| (late.iter().map(|e| e[i] * e[i]).sum::<f64>() / late.len() as f64).sqrt())
}

#[test]
fn heads_of_other_masses_and_noisy_poses_are_held_by_every_law() {
    let mut files = MemoryFiles::default();
    files.files.insert("net".into(), SHIPPED.to_vec());
    let laws = [
        ("pi", "control.pi, every: 10 ms"),
        ("lqg", "control.lqg, every: 10 ms"),
        ("mrac, tanh", "control.mrac, every: 10 ms"),
        ("mrac, lstm", "control.mrac, every: 10 ms, params: { features: lstm, model: net }"),
    ];
    let heads = [
        ("5 kg", "kinetics: rig"),
        ("4 kg", "kinetics: rig, mass: 4 kg"),
        ("6 kg", "kinetics: rig, mass: 6 kg"),
        ("5 kg, 3 % noise", "kinetics: rig, noise: 0.35 mm, angle_noise: 0.04 deg"),
    ];
    for (what, head) in heads {
        for (name, law) in laws {
            let run = closed_loop_with(&files, head, STEP, law, 80);
            let (worst, rms) = (worst_after(&run, 60.0), rms(&run, 10.0));
            println!("| {what} | {name} | {:.1} | {worst:.3?} | {rms:.3?} |", rise(&run));
            assert!(worst[0] < 0.6 && worst[1] < 0.6 && worst[2] < 0.4, "{what}, {name}: {worst:?}");
        }
    }
}
