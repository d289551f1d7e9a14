//! What a pipeline asks of its machine.

use stillpoint_pipeline::config::{Code, Machine, check, check_for};

use crate::disk::Disk;
use crate::kinds::registry;

const TEXT: &str = "\
stillpoint: 1
name: seated
operators:
  rig: { use: rig.three_bladders, every: 33 ms }
processes:
  eye: { operators: [rig], core: 99 }
";

#[test]
fn a_core_that_the_machine_does_not_have_is_named_with_those_that_it_has() {
    let machine = Machine::with_cores([0, 1, 2, 3, 6]);
    let faults = check_for(&machine, TEXT, "seated.yaml", &[], &registry(), &Disk).err().unwrap();
    assert_eq!(faults.list().iter().map(|f| f.code).collect::<Vec<_>>(), [Code::CoreMissing]);
    assert_eq!(
        faults.to_string(),
        "seated.yaml:6:34: there is no core 99: a run on the machine that was asked may use the cores 0 to 3, 6\n \
         6 |   eye: { operators: [rig], core: 99 }\n   |                                  ^^\n  \
         help: write for example `core: 6`, or check the file on the machine that runs it\n"
    );
}

#[test]
fn a_core_that_is_there_is_taken_and_no_machine_asks_for_none() {
    assert!(check_for(&Machine::with_cores([99]), TEXT, "seated.yaml", &[], &registry(), &Disk).is_ok());
    assert!(check(TEXT, "seated.yaml", &[], &registry(), &Disk).is_ok());
}

#[test]
fn a_latency_above_the_deadline_is_a_fault_of_a_live_run_and_a_model_in_session_time() {
    let text = "stillpoint: 1\nname: late\noperators:\n  \
                rig: { use: rig.three_bladders, every: 33 ms, latency: 40 ms, deadline: 30 ms }\n";
    let on = |machine: &Machine| check_for(machine, text, "late.yaml", &[], &registry(), &Disk);
    let faults = on(&Machine::here()).err().unwrap();
    assert_eq!(
        faults.to_string(),
        "late.yaml:4:58: each step would last 40 ms and miss its deadline of 30 ms\n \
         4 |   rig: { use: rig.three_bladders, every: 33 ms, latency: 40 ms, deadline: 30 ms }\n   \
         |                                                          ^^^^^\n  \
         help: make `latency` at most as long as `deadline`\n"
    );
    assert!(on(&Machine::here().in_session_time()).is_ok());
    assert!(check(text, "late.yaml", &[], &registry(), &Disk).is_ok(), "a session of it can be replayed");
}
