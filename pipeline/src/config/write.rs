//! From the marked tree back to YAML.

use super::tree::{Entry, Node, Value};

/// A comment behind a value, from the value and the mapping or list that it is in.
pub type Note<'a> = &'a dyn Fn(&Node, &Node) -> Option<String>;

/// The text of a mapping.
pub fn tree(root: &Node, note: Note<'_>) -> String {
    let mut out = String::new();
    block(root, 0, note, &mut out);
    out
}

/// The entries of a mapping or the items of a list, each on lines of its own.
fn block(node: &Node, indent: usize, note: Note<'_>, out: &mut String) {
    let comment = |value: &Node| {
        note(value, node).map_or_else(String::new, |text| format!("  # {}", text.replace(['\n', '\r'], " ")))
    };
    let lead = " ".repeat(indent);
    match &node.value {
        Value::Map(entries) => {
            for Entry { key, value } in entries {
                let (key, comment) = (scalar(&key.value), comment(value));
                match flow(value) {
                    Some(text) if text.is_empty() => out.push_str(&format!("{lead}{key}:{comment}\n")),
                    Some(text) => out.push_str(&format!("{lead}{key}: {text}{comment}\n")),
                    None => {
                        out.push_str(&format!("{lead}{key}:{comment}\n"));
                        block(value, indent + 2, note, out);
                    }
                }
            }
        }
        Value::List(items) => {
            for item in items {
                let comment = comment(item);
                match flow(item) {
                    Some(text) => out.push_str(&format!("{lead}- {text}{comment}\n")),
                    None => {
                        let from = out.len();
                        block(item, indent + 2, note, out);
                        out.replace_range(from + indent..from + indent + 1, "-");
                    }
                }
            }
        }
        _ => {}
    }
}

/// A value in one line; none where it needs lines of its own.
fn flow(node: &Node) -> Option<String> {
    match &node.value {
        Value::Nothing | Value::Refused => Some(String::new()),
        Value::Switch(on) => Some(on.to_string()),
        Value::Text(text) => Some(scalar(text)),
        Value::List(items) => {
            let in_line = |item: &Node| match item.value {
                Value::Map(_) | Value::Nothing => None,
                _ => flow(item),
            };
            items
                .iter()
                .map(in_line)
                .collect::<Option<Vec<_>>>()
                .map(|items| format!("[{}]", items.join(", ")))
        }
        Value::Map(entries) => entries.is_empty().then(|| "{}".to_owned()),
    }
}

/// A text as YAML reads it: as it is where that is safe in every place, else in quotes.
pub fn scalar(text: &str) -> String {
    let is_safe = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.' | '/' | '+' | '-');
    let is_read_otherwise = matches!(text, "true" | "false" | "null" | "Null" | "NULL" | "~");
    let unsigned =
        text.strip_prefix(['-', '+']).filter(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
    let starts =
        unsigned.is_some() || text.starts_with(|c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/'));
    let is_number_with_unit = text.split(' ').all(|part| !part.is_empty() && part.chars().all(is_safe));
    if starts && is_number_with_unit && !is_read_otherwise {
        return text.to_owned();
    }
    quoted(text)
}

/// A text in double quotes.
fn quoted(text: &str) -> String {
    let mut out = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            c if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}') => {
                out.push_str(&format!("\\u{:04x}", c as u32));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::faults::Findings;
    use crate::config::tree::Value;
    use crate::config::yaml;

    #[test]
    fn a_written_text_is_read_as_it_was() {
        let texts = [
            "",
            " ",
            "4 mm",
            "-3",
            "- x",
            "a: b",
            "a #b",
            "#",
            "~",
            "null",
            "true",
            "x,y",
            "[a]",
            "{a}",
            "*.tif",
            "&a",
            "!a",
            "a\"b\\c",
            "two\nlines\t",
            "/päth/\u{85}\u{2028}\u{feff}x",
            "'",
            "%",
            "@",
            "`",
            "a  b",
            "99 %",
            "1.5e3",
            "\u{7f}",
            "🙂",
            "? a",
            ": a",
            "rig.depth -> valves.datagram",
            "| a",
            "> a",
            "${A}",
            "--- a",
            "...",
        ];
        for text in texts {
            for (yaml, place) in
                [(format!("k: {}", scalar(text)), "block"), (format!("{{ k: {} }}", scalar(text)), "flow")]
            {
                let findings = Findings::default();
                let root = yaml::parse(&yaml, 0, 0, &findings).unwrap();
                assert!(findings.is_empty(), "{place}: {yaml}");
                let read = root.get("k").map(|node| &node.value);
                assert!(matches!(read, Some(Value::Text(t)) if t == text), "{place}: {yaml}: {read:?}");
            }
        }
    }
}
