//! What a pipeline asks of its machine.

use stillpoint_pipeline::spec::{Code, Machine, check, check_for};

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
