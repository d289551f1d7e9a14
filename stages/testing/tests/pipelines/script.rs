//! A console that speaks for a person.

use stillpoint_samples::ConsoleCommand;
use stillpoint_testing::run;
use stillpoint_testing::run::START;

use crate::registry;

struct NoFiles;

impl stillpoint_operator::Files for NoFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        Err(format!("there is no {name}"))
    }
    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        Err(format!("there is no {name}"))
    }
}

const CONSOLE: &str = "stillpoint: 1
name: script
operators:
  console: { use: console, every: 20 ms, params: { script: [SCRIPT] } }
";

#[test]
fn a_script_is_said_once_at_its_times_in_the_order_of_its_times() {
    let script = "{ at: 110 ms, say: target, values: [0.01, -0.002] }, { at: 0 s, say: capture }, \
                  { at: 40 ms, say: arm }, { at: 41 ms, say: disarm }";
    let run = run(&CONSOLE.replace("SCRIPT", script), &registry(), &NoFiles, 500).unwrap();
    let said = |verb: &str| -> Vec<(u64, Vec<f64>)> {
        let samples = run.samples::<ConsoleCommand>(&format!("console.{verb}"));
        let at = |s: &stillpoint_samples::View<'_, ConsoleCommand>| (s.header.stamp - START) / 1_000_000;
        samples
            .iter()
            .map(|s| (at(s), s.first().map(|c| c.values[..c.given as usize].to_vec()).unwrap()))
            .collect()
    };
    assert_eq!(said("capture"), [(0, vec![])]);
    assert_eq!(said("arm"), [(40, vec![])]);
    assert_eq!(said("disarm"), [(60, vec![])]);
    assert_eq!(said("target"), [(120, vec![0.01, -0.002])]);
}

#[test]
fn a_command_with_too_many_values_is_refused() {
    let script = "{ at: 1 s, say: target, values: [1, 2, 3, 4, 5, 6, 7] }";
    let Err(said) = run(&CONSOLE.replace("SCRIPT", script), &registry(), &NoFiles, 500) else {
        panic!("it ran");
    };
    assert!(said.contains("up to 6"), "{said}");
}
