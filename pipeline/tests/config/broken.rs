//! The corpus of broken files: each is refused, and what is said about it is pinned in the `.txt` beside it.
//!
//! `BLESS=1 cargo test -p stillpoint-pipeline --test config broken` writes the `.txt` files anew: read their difference.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use stillpoint_pipeline::config::{Code, Faults, check, text};

use crate::disk::Disk;
use crate::kinds::registry;

fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/broken");
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "yaml")).collect();
    files.sort();
    files
}

fn faults_of(path: &Path) -> Option<Faults> {
    let name = path.file_name().unwrap().to_string_lossy();
    match text(fs::read(path).unwrap(), &name) {
        Ok(text) => check(&text, &name, &[], &registry(), &Disk).err(),
        Err(faults) => Some(faults),
    }
}

#[test]
fn broken_files_are_refused_with_line_reason_and_suggestion() {
    let bless = std::env::var_os("BLESS").is_some();
    let files = files();
    assert!(files.len() >= 60, "{} files", files.len());
    let mut differences = Vec::new();
    for path in &files {
        let message = faults_of(path).map_or("nothing: it was accepted\n".to_owned(), |f| f.to_string());
        let pinned = path.with_extension("txt");
        if bless {
            fs::write(&pinned, &message).unwrap();
        } else if fs::read_to_string(&pinned).ok().as_ref() != Some(&message) {
            differences.push(format!("{}:\n{message}", path.display()));
        }
    }
    assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
}

#[test]
fn no_broken_file_is_accepted() {
    for path in files() {
        assert!(faults_of(&path).is_some(), "{} was accepted", path.display());
    }
}

#[test]
fn the_corpus_has_each_kind_of_fault() {
    let mut seen: BTreeSet<Code> = files()
        .iter()
        .filter_map(|p| faults_of(p))
        .flat_map(|f| f.list().iter().map(|f| f.code).collect::<Vec<_>>())
        .collect();
    // Faults of `--set` arguments are in `sets`, those that depend on the machine in `machine` and `variables`, those of several
    // files in `includes`.
    seen.extend([Code::Set, Code::CoreMissing, Code::Variable, Code::Include]);
    let missing: Vec<_> = Code::ALL.iter().filter(|c| !seen.contains(c)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn faults_for_programs_have_place_code_message_and_help() {
    let path = files().into_iter().find(|p| p.ends_with("unknown_operator.yaml")).unwrap();
    let json = faults_of(&path).unwrap().to_json();
    let fault = &json[0];
    assert_eq!(fault["file"], "unknown_operator.yaml");
    assert_eq!((fault["line"].as_u64(), fault["column"].as_u64()), (Some(9), Some(47)));
    assert_eq!(fault["code"], "unknown-operator");
    assert_eq!(fault["message"], "there is no operator `clod`");
    assert_eq!(fault["help"], "did you mean `cloud`?");
}
