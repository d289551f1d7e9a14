//! Names: which are allowed, which is nearest to a misspelled one, and how a text is quoted in a message.

use super::faults::Findings;
pub use super::quote::shown;

/// Most characters of a name.
pub const LONGEST_NAME: usize = 40;
/// Names that a message lists when none is near.
const LISTED: usize = 12;

/// Whether a text may name an operator, a process or a frame: it becomes part of topics and service names.
pub fn is_name(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes.next().is_some_and(|b| b.is_ascii_lowercase())
        && bytes.all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        && text.len() <= LONGEST_NAME
}

/// The allowed name that is nearest to a text, if it differs from it.
pub fn as_name(text: &str) -> Option<String> {
    let mut name = String::new();
    for c in text.chars().take(LONGEST_NAME) {
        match c {
            'A'..='Z' => name.push(c.to_ascii_lowercase()),
            'a'..='z' => name.push(c),
            '0'..='9' | '_' if !name.is_empty() => name.push(c),
            '-' | ' ' | '.' if !name.is_empty() => name.push('_'),
            _ => {}
        }
    }
    (is_name(&name) && name != text).then_some(name)
}

/// The candidate that is most likely meant by `text`.
pub fn nearest<'c>(text: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let requested = folded(text);
    let length = requested.chars().count();
    if length == 0 || length > 2 * LONGEST_NAME {
        return None;
    }
    let mut best: Option<(f64, &str)> = None;
    for candidate in candidates {
        let name = folded(candidate);
        let other = name.chars().count();
        let shared_start =
            length >= 3 && (name.starts_with(&requested) || (other >= 3 && requested.starts_with(&name)));
        let last_part = length >= 3 && name.rsplit('.').next() == Some(requested.as_str());
        let tolerated = (length.max(other) / 3).max(1);
        if length.abs_diff(other) > tolerated && !shared_start && !last_part {
            continue;
        }
        let edits = strsim::osa_distance(&requested, &name);
        if edits > tolerated && !shared_start && !last_part {
            continue;
        }
        let mut distance =
            edits as f64 / length.max(other) as f64 + 0.5 * (1.0 - strsim::jaro_winkler(&requested, &name));
        if shared_start || last_part {
            distance *= 0.6;
        }
        if best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, name)| name)
}

/// "did you mean", or what there is.
pub fn suggestion<'c>(
    text: &str,
    candidates: impl IntoIterator<Item = &'c str> + Clone,
    what: &str,
    findings: &Findings,
) -> String {
    if !findings.is_full()
        && let Some(name) = nearest(text, candidates.clone())
    {
        return format!("did you mean `{name}`?");
    }
    listed(candidates, what)
}

/// What there is: `what: a, b, c`.
pub fn listed<'c>(candidates: impl IntoIterator<Item = &'c str>, what: &str) -> String {
    let mut names = candidates.into_iter();
    let first: Vec<&str> = names.by_ref().take(LISTED).collect();
    if first.is_empty() {
        return format!("there are no {what}: remove it");
    }
    let more = names.count();
    let tail = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{what}: {}{tail}", first.join(", "))
}

fn folded(text: &str) -> String {
    text.chars().map(|c| if c == '-' || c == ' ' { '_' } else { c.to_ascii_lowercase() }).collect()
}
