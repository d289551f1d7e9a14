//! The documents: how long they may be, that their links resolve, and that the architecture names every crate.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use crate::from_root;

const GUIDE_LINES: usize = 300;
const README_WORDS: usize = 700;
const SENTENCE_WORDS: usize = 30;
const CHANGELOG_LINES: usize = 60; // 30 for 0.1.0, and room for what is not released yet

/// All Markdown files below a folder.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') && name != "target" {
            pages(&path, found);
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
    found.sort();
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The lines of a page that are outside of blocks of code.
fn prose(text: &str) -> Vec<&str> {
    let mut is_code = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if !is_code {
            lines.push(line);
        }
    }
    lines
}

/// A line whose pieces of code are one word each, and whose links are their texts.
fn spoken(line: &str) -> String {
    let without_code: Vec<&str> =
        line.split('`').enumerate().map(|(i, part)| if i % 2 == 1 { "code" } else { part }).collect();
    let mut rest = without_code.concat();
    while let Some(start) = rest.find("](") {
        let Some(length) = rest[start..].find(')') else { break };
        rest.replace_range(start..=start + length, "");
    }
    rest
}

/// The sentences of a line: a full stop, a colon, a question or exclamation mark ends one.
fn sentences(line: &str) -> Vec<Vec<String>> {
    let mut all = vec![Vec::new()];
    for word in spoken(line).split_whitespace() {
        if let Some(last) = all.last_mut() {
            last.push(word.to_owned());
        }
        if word.trim_end_matches(['*', ')', '"']).ends_with(['.', ':', '?', '!']) {
            all.push(Vec::new());
        }
    }
    all
}

/// The targets of the links of a page.
fn links(text: &str) -> Vec<String> {
    let mut all = Vec::new();
    for line in prose(text) {
        let parts: Vec<&str> = line.split('`').collect();
        let no_code: String = parts.iter().step_by(2).copied().collect();
        for after in no_code.split("](").skip(1) {
            all.extend(after.split(')').next().map(str::to_owned));
        }
    }
    all
}

/// The names by which the headings of a page are linked.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).into_iter().filter(|line| line.starts_with('#'));
    let anchor = |line: &str| -> String {
        let heading = line.trim_start_matches('#').trim().replace('`', "");
        let heading = spoken(&heading).replace('[', "").to_lowercase();
        let letters = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_' | ' '));
        letters.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            Component::CurDir => {}
            other => plain.push(other),
        }
    }
    plain
}

#[test]
fn every_relative_link_of_the_documents_resolves_to_a_file_and_a_heading() {
    let root = from_root("").canonicalize().unwrap();
    let mut files = Vec::new();
    for folder in ["docs", "examples", "tests", "tools", ".github"] {
        pages(&root.join(folder), &mut files);
    }
    files.extend(["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"].map(|name| root.join(name)));
    let (mut broken, mut count) = (Vec::new(), 0);
    for page in &files {
        for link in links(&read(page)) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, heading) = link.split_once('#').unwrap_or((&link, ""));
            let target = match file {
                "" => page.clone(),
                file => plain(&page.parent().unwrap().join(file)),
            };
            let is_there = target.exists()
                && (heading.is_empty()
                    || target.extension().is_none_or(|e| e != "md")
                    || anchors(&read(&target)).contains(heading));
            if !is_there {
                broken.push(format!("{}: {link}", page.strip_prefix(&root).unwrap().display()));
            }
        }
    }
    assert!(broken.is_empty(), "links that do not resolve:\n{}", broken.join("\n"));
    assert!(count > 150, "only {count} links were found: the pages were not read as they are written");
}

#[test]
fn guides_are_short_and_so_are_their_sentences() {
    let mut guides = Vec::new();
    pages(&from_root("docs/guide"), &mut guides);
    assert!(guides.len() > 8, "{guides:?}");
    let mut long = Vec::new();
    for page in guides {
        let text = read(&page);
        let name = page.file_name().unwrap().to_string_lossy().into_owned();
        let lines = text.lines().count();
        if lines > GUIDE_LINES {
            long.push(format!("{name}: {lines} lines (allowed: {GUIDE_LINES}): split it by task"));
        }
        let lines = prose(&text).into_iter().filter(|line| !line.starts_with(['|', '#', '!']));
        for sentence in lines.flat_map(sentences).filter(|words| words.len() > SENTENCE_WORDS) {
            let (words, text) = (sentence.len(), sentence.join(" "));
            long.push(format!("{name}: {words} words (allowed: {SENTENCE_WORDS}): {text}"));
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn the_readme_and_the_changelog_are_short() {
    let words = read(&from_root("README.md")).split_whitespace().count();
    assert!(words <= README_WORDS, "README.md has {words} words (allowed: {README_WORDS})");
    let lines = read(&from_root("CHANGELOG.md")).lines().count();
    assert!(lines <= CHANGELOG_LINES, "CHANGELOG.md has {lines} lines (allowed: {CHANGELOG_LINES})");
}

#[test]
fn the_architecture_names_every_crate_and_no_other() {
    let page = read(&from_root("docs/architecture.md"));
    let (_, table) = page.split_once("## Where things are").unwrap();
    let table = table.split("\n## ").next().unwrap();
    let workspaces = [
        "Cargo.toml",
        "ipc/remote/Cargo.toml",
        "python/Cargo.toml",
        "tools/bridge/Cargo.toml",
        "tools/research/Cargo.toml",
    ];
    let mut folders = BTreeSet::new();
    for file in workspaces {
        let folder = Path::new(file).parent().unwrap();
        let text = read(&from_root(file));
        let members = text.split_once("members = [").and_then(|(_, rest)| rest.split_once(']'));
        for member in members.map_or("", |(members, _)| members).split('"').skip(1).step_by(2) {
            folders.insert(plain(&folder.join(member)));
        }
        if text.contains("[package]") {
            folders.insert(folder.to_owned());
        }
    }
    folders.remove(Path::new(""));
    assert!(folders.len() > 30, "{folders:?}");
    let missing: Vec<_> = folders.iter().filter(|f| !table.contains(&format!("`{}`", f.display()))).collect();
    assert!(missing.is_empty(), "the table of docs/architecture.md lacks {missing:?}");
    // And each folder that it names is there.
    for row in table.lines().filter(|line| line.starts_with("| `")) {
        for folder in row.split('|').nth(1).unwrap().split('`').skip(1).step_by(2) {
            assert!(from_root(folder).join("Cargo.toml").exists(), "{folder} is no crate");
        }
    }
}
