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
    let mut rest = before_tests(text);
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

/// Name and text of every source file outside of tests.
fn every_source() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for folder in ["ipc", "pipeline", "recorder", "stages", "tests/src", "tools"] {
        sources(&root.join(folder), &mut files);
    }
    assert!(files.len() > 500, "{} files", files.len());
    let read = |file: PathBuf| {
        let shown = file.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
        (shown, std::fs::read_to_string(&file).unwrap())
    };
    files.into_iter().map(read).collect()
}

/// The part of a source file before its tests.
fn before_tests(text: &str) -> &str {
    text.split("\n#[cfg(test)]\nmod tests").next().unwrap_or_default()
}

#[test]
fn names_and_messages_use_the_words_of_the_table() {
    let (banned_names, banned_messages) = replaced();
    let mut wrong = BTreeSet::new();
    for (shown, text) in every_source() {
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

/// Whether a text of Rust names a result whose error is a text, or gives a text another name.
fn has_text_as_error(text: &str) -> bool {
    let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let results = code.match_indices("Result<").filter(|(at, _)| {
        let (mut depth, mut last) = (0, 0);
        let arguments = &code[at + "Result<".len()..];
        for (place, c) in arguments.char_indices() {
            match c {
                '<' | '(' | '[' => depth += 1,
                '>' if arguments[..place].ends_with('-') => {}
                '>' | ')' | ']' if depth > 0 => depth -= 1,
                '>' => return last > 0 && arguments[last..place].trim() == "String",
                ',' if depth == 0 => last = place + 1,
                ';' | '{' if depth == 0 => return false,
                _ => {}
            }
        }
        false
    });
    let renamed = code.match_indices("type ").any(|(at, _)| {
        let definition = code[at..].split(';').next().unwrap_or_default();
        definition.split_once('=').is_some_and(|(_, of)| of.trim() == "String")
    });
    renamed || results.count() > 0
}

#[test]
fn no_error_is_a_mere_text() {
    let sources = every_source().into_iter().filter(|(shown, _)| !shown.starts_with("stages/testing/"));
    let wrong: Vec<String> =
        sources.filter(|(_, text)| has_text_as_error(before_tests(text))).map(|(shown, _)| shown).collect();
    assert!(wrong.is_empty(), "`Result<_, String>`: make it an enum\n{}", wrong.join("\n"));
}

#[test]
fn an_error_that_is_a_text_is_found_and_a_typed_one_is_not() {
    for text in [
        "fn a() -> Result<(), String> {",
        "fn a() -> Result<Vec<(u8, [u8; 3])>, String>;",
        "type Item = Result<\n    Option<u8>,\n    String,\n>;",
        "fn a(f: impl Fn(u8) -> Result<u8, String>) {",
        "type Fault = String;",
    ] {
        // rustfmt puts a comma behind the last of several lines.
        assert!(has_text_as_error(&text.replace(",\n>", "\n>")), "{text}");
    }
    for text in [
        "fn a() -> Result<String, Fault> {",
        "fn a() -> io::Result<BTreeMap<String, String>> {",
        "fn a() -> Result<BTreeMap<u8, String>, Fault> {",
        "// Result<(), String>",
        "type Names = Vec<String>;",
    ] {
        assert!(!has_text_as_error(text), "{text}");
    }
}

/// The texts of `#[error("...")]`.
fn error_texts(text: &str) -> Vec<String> {
    let starts = text.match_indices("#[error(").map(|(at, start)| text[at + start.len()..].trim_start());
    let texts = starts.filter_map(|rest| rest.strip_prefix('"'));
    texts
        .map(|rest| {
            let mut ends = rest.match_indices('"').map(|(at, _)| at);
            let end = ends.find(|at| !rest[..*at].ends_with('\\')).unwrap_or(rest.len());
            rest[..end].replace("\\\n", "").replace("\\\"", "\"")
        })
        .collect()
}

/// Whether brackets of a message are closed in the order in which they open, and its quotes stand in pairs. Braces are
/// those of the values; an apostrophe is not a quote.
fn is_balanced(message: &str) -> bool {
    let (mut open, mut in_value) = (Vec::new(), false);
    for c in message.replace("{{", "").replace("}}", "").chars() {
        match c {
            '{' => in_value = true,
            '}' => in_value = false,
            _ if in_value => {}
            '(' => open.push(')'),
            '[' => open.push(']'),
            ')' | ']' if open.pop() != Some(c) => return false,
            _ => {}
        }
    }
    let pairs = |quote| message.matches(quote).count().is_multiple_of(2);
    open.is_empty() && !in_value && pairs('`') && pairs('"')
}

#[test]
fn brackets_and_quotes_of_error_messages_are_closed() {
    let (mut wrong, mut count) = (Vec::new(), 0);
    for (shown, text) in every_source() {
        for message in error_texts(before_tests(&text)) {
            count += 1;
            if !is_balanced(&message) {
                wrong.push(format!("{shown}: {message:?}"));
            }
        }
    }
    assert!(count > 500, "{count} messages");
    assert!(wrong.is_empty(), "{} messages:\n{}", wrong.len(), wrong.join("\n"));
    assert!(is_balanced("`a` is [{x:?}] (allowed: 0 to 1)") && is_balanced("the sensor's \"time\""));
    for message in ["(allowed: 1", "allowed: 1)", "the key `a is", "a \"text", "(a [b)]", "{a"] {
        assert!(!is_balanced(message), "{message}");
    }
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
