//! Paths with a star: which of a folder's files are meant.

/// Whether `name` fits `pattern`: `*` stands for any number of any characters, but not for the dot at the start of a hidden
/// name; every other character stands for itself. The
/// extension behind a `*` is the same in upper and lower case.
///
/// ```
/// use stillpoint_operator::pattern::matches;
/// assert!(matches("n35_*_depth.png", "n35_004_depth.png"));
/// assert!(!matches("n35_*_depth.png", "n35_004_label.png"));
/// ```
#[must_use]
pub fn matches(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else { return false };
    if first.is_empty() && pattern.starts_with('*') && name.starts_with('.') {
        return false;
    }
    let Some(last) = parts.next_back() else { return rest.is_empty() };
    for part in parts {
        // The earliest place leaves the most for the parts behind it.
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    let end = rest.len().checked_sub(last.len()).and_then(|at| rest.get(at..));
    // Cameras write `.PNG`, too.
    let is_extension = last.starts_with('.') && !last[1..].contains('.');
    end.is_some_and(|end| end == last || is_extension && end.eq_ignore_ascii_case(last))
}

/// Whether a path is a pattern: its last part has a star.
#[must_use]
pub fn is_one(path: &str) -> bool {
    parts(path).1.contains('*')
}

/// The pattern of those files of a folder that fit `pattern`.
#[must_use]
pub fn inside(folder: &str, pattern: &str) -> String {
    format!("{}/{pattern}", folder.trim_end_matches('/'))
}

/// The folder of a path, and the part behind it.
#[must_use]
pub fn parts(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn stars_stand_for_any_characters_and_for_none() {
        for (pattern, name) in
            [("*", ""), ("*", "a.png"), ("a*", "a"), ("*_depth.png", "1_depth.png"), ("a*b*c", "a_b_b_c"), ("*.png", "0.PNG")]
        {
            assert!(matches(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn what_the_pattern_does_not_say_does_not_match() {
        let hidden = [("*", ".a"), ("*.png", "._0.png")];
        for (pattern, name) in
            [("", "a"), ("a", "ab"), ("a*a", "a"), ("*b", "a"), ("a*b*c", "a_c_b")].into_iter().chain(hidden)
        {
            assert!(!matches(pattern, name), "{pattern} {name}");
        }
    }
}
