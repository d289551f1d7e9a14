//! The hashes of all types that are read or written are those of the Python package `rosbags`, which `STILLPOINT_PYTHON`
//! has.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test stops at the first surprise")]

use std::process::Command;

use stillpoint_cdr::schema;
use stillpoint_ros2::rihs01;

/// Prints one line per distribution and type: name and hash.
const PRINT: &str = "
import sys
from rosbags.typesys import Stores, get_typestore
for name in ['ROS2_IRON', 'ROS2_JAZZY', 'ROS2_KILTED', 'LATEST']:
    if name in Stores.__members__:
        store = get_typestore(Stores[name])
        for of in sys.argv[1:]:
            print(of, store.hash_rihs01(of))
";

#[test]
fn hashes_of_types_are_those_of_rosbags() {
    let Some(python) = std::env::var_os("STILLPOINT_PYTHON") else {
        eprintln!("skipped: STILLPOINT_PYTHON names no Python that has the package `rosbags`");
        return;
    };
    let names = schema::ALL.map(|(name, _)| name);
    let said = Command::new(python).args(["-c", PRINT]).args(names).output().unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let said = String::from_utf8(said.stdout).unwrap();
    for (name, text) in schema::ALL {
        let own = rihs01(name, text).unwrap();
        let theirs: Vec<&str> = said
            .lines()
            .filter_map(|line| line.split_once(' '))
            .filter(|l| l.0 == name)
            .map(|l| l.1)
            .collect();
        assert!(theirs.len() >= 2 && theirs.iter().all(|hash| *hash == own), "{name}: {own}, not {theirs:?}");
    }
}
