//! The safety case names tests that exist.

use std::collections::BTreeSet;
use std::path::Path;

const PAGE: &str = include_str!("../../docs/reference/safety.md");
/// Fewer rows than this mean that the page was not read as it is written.
const ROWS_AT_LEAST: usize = 15;
/// Where the column of tests is in a row, from 0.
const COLUMN: usize = 3;

/// The names of all functions that stand behind `#[test]` in the sources below a folder.
fn tests_below(folder: &Path, found: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            tests_below(&path, found);
        } else if name.ends_with(".rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let mut is_test = false;
            for line in text.lines().map(str::trim) {
                // A property test is declared by the same attribute inside of `proptest!`.
                is_test |= line == "#[test]";
                if let Some(rest) = line.strip_prefix("fn ").filter(|_| is_test) {
                    found.insert(rest.split('(').next().unwrap_or_default().to_owned());
                    is_test = false;
                }
            }
        }
    }
}

#[test]
fn every_row_of_the_safety_case_names_tests_that_exist() {
    let mut tests = BTreeSet::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for folder in ["ipc", "pipeline", "recorder", "stages", "tests", "tools"] {
        tests_below(&root.join(folder), &mut tests);
    }
    let rows = PAGE.lines().filter(|line| line.starts_with("| ") && !line.contains("---"));
    let rows: Vec<Vec<&str>> = rows.map(|row| row.trim_matches('|').split('|').collect()).collect();
    let rows: Vec<_> = rows.iter().filter(|row| row.first() != Some(&" hazard ")).collect();
    assert!(rows.len() >= ROWS_AT_LEAST, "{} rows", rows.len());
    for row in rows {
        let named: Vec<&str> = row[COLUMN].split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "the row of \"{}\" names no test", row[0].trim());
        for name in named {
            assert!(
                tests.contains(name),
                "the row of \"{}\" names `{name}`, which no test is called",
                row[0].trim()
            );
        }
    }
}
