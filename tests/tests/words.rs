//! Names, messages and help use the words of the table in `CONTRIBUTING.md`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const TABLE: &str = include_str!("../../CONTRIBUTING.md");
const HELP: &str = include_str!("../../docs/reference/cli.md");
/// Fewer rows than this mean that the table was not read as it is written.
const ROWS_AT_LEAST: usize = 15;
/// Names of others, and a field of recorded samples, whose name is in every session.
const EXCEPT: [&str; 3] = ["PoisonError", "Errno::AGAIN", "kept"];
/// The file that declares the field, and those that read or write it by its name.
const FIELD: [&str; 3] =
    ["ipc/samples/src/plane.rs", "stages/head/segment/src/findings.rs", "tools/report/src/overlay.rs"];

/// The words that the table replaces: in names, and in messages.
fn replaced() -> (BTreeSet<&'static str>, BTreeSet<&'static str>) {
    let (mut names, mut messages) = (BTreeSet::new(), BTreeSet::new());
    let table = TABLE.split("| not | but | in |").nth(1).unwrap();
    let rows = table.lines().skip(2).take_while(|line| line.starts_with("| "));
    let mut count = 0;
    for row in rows {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        for word in cells[0].split(", ") {
            if cells[2].contains("names") {
                names.insert(word);
            }
            if cells[2].contains("messages") {
                messages.insert(word);
            }
        }
        count += 1;
    }
    assert!(count >= ROWS_AT_LEAST, "{count} rows");
    (names, messages)
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !["target", "tests", "benches", "examples"].contains(&name.as_str()) {
            sources(&path, found);
        } else if name.ends_with(".rs") {
            found.push(path);
        }
    }
}

/// The names of a text of Rust and its messages: texts of more than one word, without what stands in quotes or
/// backticks in them, which is a key or a value.
fn split(text: &str) -> (Vec<String>, Vec<String>) {
    let (mut names, mut messages) = (Vec::new(), Vec::new());
    let mut rest = text.split("\n#[cfg(test)]\nmod tests").next().unwrap_or_default();
    while let Some(first) = rest.chars().next() {
        if rest.starts_with("//") {
            rest = &rest[rest.find('\n').unwrap_or(rest.len())..];
        } else if rest.starts_with("r#\"") {
            rest = &rest[rest.find("\"#").map_or(rest.len(), |end| end + 2)..];
        } else if first == '"' {
            let mut end = 1;
            while let Some(next) = rest[end..].chars().next() {
                end += next.len_utf8();
                match next {
                    '\\' => end += rest[end..].chars().next().map_or(0, char::len_utf8),
                    '"' => break,
                    _ => {}
                }
            }
            // A text with lines of its own is a file, not a message.
            let message = rest[1..end - 1].replace("\\\n", "").replace("\\\"", "`");
            if message.contains(' ') && !message.contains('\n') && !message.contains(": {") {
                messages.push(message.split('`').step_by(2).collect());
            }
            rest = &rest[end..];
        } else if rest.starts_with("'\\") || (first == '\'' && rest.chars().nth(2) == Some('\'')) {
            let skipped = if rest.starts_with("'\\") { 3 } else { 2 };
            let long: usize = rest.chars().take(skipped).map(char::len_utf8).sum();
            rest = &rest[long + rest[long..].find('\'').map_or(0, |end| end + 1)..];
        } else if first.is_alphabetic() || first == '_' {
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            names.push(rest[..end].to_owned());
            rest = &rest[end..];
        } else {
            rest = &rest[first.len_utf8()..];
        }
    }
    (names, messages)
}

/// The words of a name in small letters, with a space before, between and after them.
fn words(name: &str) -> String {
    let mut text = String::from(" ");
    let mut before = '_';
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && before.is_lowercase()) {
            text.push(' ');
        }
        if c != '_' {
            text.extend(c.to_lowercase());
        }
        before = c;
    }
    text.push(' ');
    text
}

fn prose(message: &str) -> String {
    let words =
        message.split(|c: char| !c.is_alphanumeric() && c != '-').filter(|word| !word.starts_with("--"));
    format!(" {} ", words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ").to_lowercase())
}

#[test]
fn names_and_messages_use_the_words_of_the_table() {
    let (banned_names, banned_messages) = replaced();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for folder in ["ipc", "pipeline", "recorder", "stages", "tests/src", "tools"] {
        sources(&root.join(folder), &mut files);
    }
    assert!(files.len() > 500, "{} files", files.len());
    let mut wrong = BTreeSet::new();
    for file in files {
        let shown = file.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&file).unwrap();
        let (names, messages) = split(&text);
        for name in names {
            let is_exempt = EXCEPT.iter().any(|e| e.rsplit("::").next() == Some(&name))
                && (name != "kept" || FIELD.contains(&shown.as_str()))
                && (name != "AGAIN" || text.contains("Errno::AGAIN"));
            let split = words(&name);
            if let Some(word) =
                banned_names.iter().find(|word| !is_exempt && split.contains(&format!(" {word} ")))
            {
                wrong.insert(format!("{shown}: the name `{name}` has \"{word}\""));
            }
        }
        for message in messages {
            let split = prose(&message);
            if let Some(word) = banned_messages.iter().find(|word| is_in(&split, word)) {
                wrong.insert(format!("{shown}: the message {message:?} has \"{word}\""));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} places:\n{}",
        wrong.len(),
        wrong.into_iter().collect::<Vec<_>>().join("\n")
    );
}

/// "There is no run" is the field's way to say it.
fn is_in(prose: &str, phrase: &str) -> bool {
    prose
        .replace("there is no ", "")
        .replace("there are no ", "")
        .replace("is no longer", "")
        .contains(&format!(" {phrase} "))
}

#[test]
fn help_uses_the_words_of_the_table() {
    let (_, banned) = replaced();
    let wrong: Vec<String> = HELP
        .lines()
        .filter_map(|line| {
            let prose = prose(&line.split('`').step_by(2).collect::<String>());
            banned.iter().find(|word| is_in(&prose, word)).map(|word| format!("\"{word}\": {line}"))
        })
        .collect();
    assert!(wrong.is_empty(), "{} lines of docs/reference/cli.md:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn words_are_found_in_names_and_messages() {
    let (names, messages) =
        split("let kept_bytes = InTheWay::new(\"it was told `so`\", 'w', \"way\"); // beside");
    assert_eq!(names, ["let", "kept_bytes", "InTheWay", "new"]);
    assert_eq!(messages, ["it was told "]);
    assert!(words("kept_bytes").contains(" kept ") && words("InTheWay").contains(" way "));
    assert!(is_in(&prose("this is no file"), "is no") && !is_in(&prose("there is no file"), "is no"));
}
