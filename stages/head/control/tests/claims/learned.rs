//! Controllers with files: a plant that was identified, a network that was trained, and what they refuse.

use std::collections::BTreeMap;

use nalgebra::Vector1;
use stillpoint_control::features::{Features, Learned};
use stillpoint_identify::{InnovationModel, Provenance, Record, Signal, fit};
use stillpoint_mechanics::plant::{OneDof, State};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::Diagnostics;

use super::loops::{STEP, worst_after};
use super::network::predictor;
use super::plants::{closed_loop_with, truth, try_loop};
use stillpoint_mechanics::random::Random;

/// A model of the head on one bladder, from a record in which its valves open and shut at random about its rest.
fn identified(unit: &str) -> MemoryFiles {
    let plant = OneDof::rig(5.0);
    let air = Vector1::new(0.000_9);
    let rest = plant.equilibrium(&air, Vector1::new(0.09)).unwrap();
    let mut state = State::at_rest(rest, air);
    let mut random = Random::new(11);
    let (mut input, mut output, mut push) = (Vec::new(), Vec::new(), 0.0);
    for k in 0..1500 {
        if k % 8 == 0 {
            push = 0.15 * random.normal();
        }
        // A little towards the rest, so that it stays about it.
        let net: f64 = (push - 20.0 * (state.position.x - rest.x)).clamp(-1.0, 1.0);
        input.push(net);
        output.push(state.position.x - rest.x + 2e-5 * random.normal());
        let mut drive = plant.idle();
        drive.duty = [[net.max(0.0), (-net).max(0.0)]];
        for _ in 0..50 {
            state = plant.advance(&state, &drive, 2e-3);
        }
    }
    let found = fit(&Record { input: &input, output: &output }, 3).unwrap();
    let signal = |name: &str, unit: &str, offset: f64| Signal {
        name: name.into(),
        unit: unit.into(),
        offset,
        scale: 1.0,
    };
    let signals = [signal("lqg.duties:net.0", "", 0.0), signal("filter.state:position.2", unit, rest.x)];
    let provenance = Provenance {
        sha256: String::new(),
        samples: found.samples,
        fit_percent: found.fit_percent,
        program: "test".into(),
    };
    let model = InnovationModel::new(&found.model, 0.1, found.noise_variance, signals, provenance).unwrap();
    let mut files = MemoryFiles::default();
    files.files.insert("model.json".into(), model.to_json().unwrap().into_bytes());
    files
}

const ONE: &str = "plant: { channels: [z], bladders: [{ z: 13 mm/s }] }";

#[test]
fn a_law_of_an_identified_model_holds_the_height() {
    let law = format!("control.lqg, every: 100 ms, params: {{ {ONE}, model: model.json, rise: 4 s }}");
    let target = "channels: [z], moves: [{ at: 1 s, z: 10 mm }]";
    let run = closed_loop_with(&identified("m"), "kinetics: one_bladder, noise: 0.2 mm", target, &law, 40);
    let truth = truth(&run);
    let start = truth[0].1[0];
    let highest = truth.iter().map(|(_, at)| at[0] - start).fold(0.0, f64::max);
    assert!(highest < 0.0115, "{highest}");
    let late: Vec<f64> =
        truth.iter().filter(|(t, _)| *t > 15.0).map(|(_, at)| at[0] - start - 0.010).collect();
    let deviation = (late.iter().map(|e| e * e).sum::<f64>() / late.len() as f64).sqrt();
    println!("from 15 s on {:.3} mm off, overshoot {:.3} mm", deviation * 1e3, (highest - 0.010) * 1e3);
    assert!(deviation < 5e-4, "{deviation}");
}

fn with_network() -> MemoryFiles {
    let mut files = MemoryFiles::default();
    files.files.insert("net".into(), predictor().to_safetensors(&BTreeMap::new()));
    files.files.insert("junk".into(), b"no network".to_vec());
    files
}

#[test]
fn even_an_untrained_network_leaves_the_adaptive_loop_stable() {
    let law = "control.mrac, every: 10 ms, params: { features: lstm, model: net }";
    let run = closed_loop_with(&with_network(), "kinetics: rig", STEP, law, 70);
    let worst = worst_after(&run, 60.0);
    assert!(worst[0] < 0.5 && worst[1] < 0.2 && worst[2] < 0.2, "{worst:?}");
    let last = run.samples::<Diagnostics>("law.diagnostics").last().unwrap().elements.to_vec();
    let message = last.iter().find(|m| m.name() == "predicted_change_z_m").unwrap().value;
    assert!(message.is_finite());
    // The model is where the head is to be: 11.5 mm above where it was, in the frame of the state, after 70 s.
    let model = last.iter().find(|m| m.name() == "model_z_m").unwrap().value;
    let start = truth(&run)[0].1[0];
    assert!((model - start - 0.0115).abs() < 1e-4, "{model} from {start}");
}

#[test]
fn the_network_is_fed_as_it_was_trained() {
    let predictor = predictor();
    let mut features = Features::Learned(Box::new(Learned::new(predictor.clone(), predictor.scale())));
    let (mut phi, mut samples) = ([0.0; 8], Vec::new());
    // Ten looks a sample: the pose at its beginning counts, and the mean of the duties.
    for k in 0..80 {
        let pose = [0.01 * f64::from(k), -0.02 * f64::from(k), 0.3];
        let net = [0.01 * f64::from(k % 10), -0.05, 0.02];
        features.look(&pose, 0.01, &mut phi);
        features.acted(&net);
        if k % 10 == 0 {
            let mut sample = [0.0; 9];
            sample[..3].copy_from_slice(&pose);
            sample[3..].copy_from_slice(&[0.45, 0.0, 0.0, 0.5, 0.2, 0.0]);
            samples.push(sample);
        }
        if k < 60 {
            assert_eq!(phi, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], "at {k}");
        }
    }
    // At the last look seven samples were complete: the last six count.
    let mut memory = predictor.network().memory();
    for sample in &samples[1..7] {
        predictor.network().step(sample, &mut memory);
    }
    for (found, expected) in phi.iter().zip(memory.hidden()) {
        assert!((found - expected).abs() < 1e-12, "{phi:?}");
    }
}

#[test]
fn parameters_are_declared_rightly() {
    for stage in stillpoint_control::STAGES {
        stillpoint_operator::params::verify(stage).unwrap();
    }
}

#[test]
fn controllers_refuse_what_does_not_fit_with_the_place() {
    let mut files = with_network();
    files.files.extend(identified("m").files);
    files.files.insert("degrees.json".into(), identified("rad").files["model.json"].clone());
    for (law, words) in [
        ("control.mrac, every: 10 ms, params: { features: lstm }", "`features: lstm` needs a network"),
        ("control.mrac, every: 10 ms, params: { model: net }", "`features: tanh` needs no model"),
        (
            "control.mrac, every: 10 ms, params: { features: lstm, model: junk }",
            "`model`: junk: it is not a safetensors",
        ),
        ("control.mrac, every: 200 ms, params: { features: lstm, model: net }", "its sample time is 100 ms"),
        (
            "control.mrac, every: 10 ms, params: { features: lstm, model: net, plant: { channels: [z], bladders: [{ z: 1 mm/s }] } }",
            "trained for z, pitch, roll with 3 bladders, and `plant` is z with 1",
        ),
        ("control.mrac, every: 10 ms, params: { features: lstm, model: gone }", "gone"),
        ("control.lqg, every: 10 ms, params: { model: model.json }", "hold one channel with one bladder"),
        (
            "control.lqg, every: 10 ms, params: { plant: { channels: [z], bladders: [{ z: 13 mm/s }] }, model: model.json }",
            "its sample time is 100 ms and the timer ticks every 10 ms",
        ),
        (
            "control.lqg, every: 100 ms, params: { plant: { channels: [z], bladders: [{ z: 13 mm/s }] }, model: degrees.json }",
            "its output is in rad, and the channel in m",
        ),
        ("control.pi, every: 400 ms", "`stale` is 300 ms and the timer ticks every 400 ms"),
        (
            "control.pi, every: 10 ms, params: { plant: { channels: [] } }",
            "`plant.channels`: name at least one",
        ),
        (
            "control.pi, every: 10 ms, params: { plant: { channels: [x] } }",
            "`plant.bladders`: the bladders do not move",
        ),
        (
            "control.pi, every: 10 ms, params: { plant: { channels: [z], scale: { x: 1 mm } } }",
            "`plant.scale` lacks z",
        ),
        (
            "control.pi, every: 10 ms, params: { plant: { channels: [z], scale: { z: 0 mm } } }",
            "`plant.scale.z` is 0",
        ),
        (
            "control.pi, every: 10 ms, params: { plant: { bladders: [{ z: 1 mm/s }] } }",
            "1 bladders cannot hold 3 channels",
        ),
        ("control.pi", "every"),
        ("control.mrac, every: 10 ms, params: { rise: 20 }", "unit"),
        ("control.mrac, every: 10 ms, params: { feedback: 4.39 }", "unit"),
        (
            "control.mrac, every: 10 ms, params: { rise: 5 s, learning_features: 0.00879 }",
            "write `learn_features: 1.000`, which is the same rate",
        ),
        ("control.mrac, every: 10 ms, params: { weight: 100 }", "`weight` is not used any more"),
        ("control.mrac, every: 10 ms, params: { plant: { bladders: [{ z: 1 mm }] } }", "mm"),
    ] {
        let error = try_loop(&files, "", "", law, 1).map(|_| ()).unwrap_err();
        assert!(error.contains(words), "{law}: {error}");
    }
}
