//! Doc comments as text.

use syn::{Attribute, Expr, ExprLit, Lit, Meta};

/// The first paragraph of a doc comment, in one line, without links.
pub fn text(attributes: &[Attribute]) -> String {
    let mut words: Vec<String> = Vec::new();
    for attribute in attributes.iter().filter(|a| a.path().is_ident("doc")) {
        let Meta::NameValue(pair) = &attribute.meta else { continue };
        let Expr::Lit(ExprLit { lit: Lit::Str(line), .. }) = &pair.value else { continue };
        let line = line.value();
        if line.trim().is_empty() && !words.is_empty() {
            break;
        }
        words.extend(line.split_whitespace().map(str::to_owned));
    }
    unlinked(&words.join(" "))
}

/// Text without the brackets and targets of links: "[`Verb`](crate::Verb)" is "`Verb`".
fn unlinked(text: &str) -> String {
    let (mut plain, mut rest) = (String::new(), text);
    while let Some(start) = rest.find("[`") {
        let Some(length) = rest[start..].find("`]") else { break };
        let end = start + length;
        plain += &rest[..start];
        plain += &rest[start + 1..=end];
        rest = &rest[end + 2..];
        if rest.starts_with('(')
            && let Some(close) = rest.find(')')
        {
            rest = &rest[close + 1..];
        }
    }
    plain + rest
}

#[cfg(test)]
mod tests {
    use super::unlinked;

    #[test]
    fn links_lose_their_brackets_and_targets() {
        for (text, plain) in [
            ("a [`Verb`] here", "a `Verb` here"),
            ("a [`RigFault`](crate::RigFault), the part (0)", "a `RigFault`, the part (0)"),
            ("bits of [`A`] and [`B`](c::B).", "bits of `A` and `B`."),
            ("[0, 1] stays", "[0, 1] stays"),
            ("[`open", "[`open"),
        ] {
            assert_eq!(unlinked(text), plain);
        }
    }
}
