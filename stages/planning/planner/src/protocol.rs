//! Protocols of a plan: those that come with stillpoint, and a file of one's own.

use stillpoint_operator::config::faults::{Code, Faults, Findings};
use stillpoint_operator::config::source::Sources;
use stillpoint_operator::config::tree::{Entry, Keys, Node, TEXT, Value};
use stillpoint_operator::config::{text, yaml};
use stillpoint_patient::case::{Case, name_fits};
use stillpoint_plan::protocol::{Limit, Of, Protocol};

const SHIPPED: [(&str, &str); 3] = [
    ("prostate.yaml", include_str!("../data/protocols/prostate.yaml")),
    ("head-and-neck.yaml", include_str!("../data/protocols/head-and-neck.yaml")),
    ("lung.yaml", include_str!("../data/protocols/lung.yaml")),
];
const KEYS: [&str; 4] = ["name", "site", "fraction", "limits"];
const KEYS_OF_LIMIT: [&str; 6] = ["structure", "match", "target", "plan", "limit", "source"];

/// The first protocol that comes with stillpoint and of whose site the case has a structure.
///
/// # Errors
/// A protocol that comes with stillpoint is damaged.
pub fn of_site(case: &Case) -> Result<Option<Protocol>, Faults> {
    for (name, yaml) in SHIPPED {
        let (protocol, site) = parse(name, yaml)?;
        let here = |pattern: &String| case.structures().iter().any(|s| name_fits(pattern, &s.name));
        if site.iter().any(here) {
            return Ok(Some(protocol));
        }
    }
    Ok(None)
}

/// The protocol in the bytes of a file of this name.
///
/// # Errors
/// The bytes are not a protocol; each fault has its line.
pub fn read(name: &str, bytes: Vec<u8>) -> Result<Protocol, Faults> {
    Ok(parse(name, &text(bytes, name)?)?.0)
}

/// A protocol and the structures of its site.
fn parse(file_name: &str, text: &str) -> Result<(Protocol, Vec<String>), Faults> {
    let findings = Findings::default();
    let read = yaml::parse(text, 0, 0, &findings).and_then(|root| protocol(&root, &findings));
    match read {
        Some(read) if findings.is_empty() => Ok(read),
        _ => Err(findings.into_faults(Sources::new(file_name, text, &[]))),
    }
}

fn protocol(root: &Node, findings: &Findings) -> Option<(Protocol, Vec<String>)> {
    let keys = Keys::of(root.map("the protocol", "a mapping", findings)?, &KEYS, "a protocol", findings);
    let expected = |key: &str| {
        if keys.get(key).is_none() {
            let help = "write `name: NAME` and `limits: [...]`";
            findings.say(root.span.first(1), Code::MissingKey, format!("the protocol has no `{key}`"), help);
        }
        keys.get(key).map(|entry| &entry.value)
    };
    let name = expected("name").and_then(|node| node.scalar("the name", TEXT, findings));
    let limits = expected("limits").and_then(|node| node.list("`limits`", "a list", findings));
    let site = keys.get("site").map_or(Some(Vec::new()), |entry| texts(entry, findings));
    let limits: Vec<Option<Limit>> = limits?.iter().map(|node| limit(node, findings)).collect();
    let limits: Option<Vec<Limit>> = limits.into_iter().collect();
    let fraction_gy = match keys.get("fraction") {
        Some(entry) => Some(fraction(entry, findings)?),
        None => None,
    };
    Some((Protocol { name: name?.to_owned(), fraction_gy, limits: limits? }, site?))
}

/// A range of doses of a fraction, `1.7 to 2.3 Gy`.
fn fraction(entry: &Entry, findings: &Findings) -> Option<[f64; 2]> {
    let text = entry.value.scalar("`fraction`", TEXT, findings)?;
    let number = |part: &str| part.trim().parse::<f64>().ok().filter(|gray| gray.is_finite() && *gray > 0.0);
    let range = text.trim().strip_suffix("Gy").and_then(|range| range.split_once("to"));
    let range = range.and_then(|(least, most)| Some([number(least)?, number(most)?]));
    let range = range.filter(|[least, most]| least <= most);
    if range.is_none() {
        entry.value.refuse("`fraction`", "a range such as `1.7 to 2.3 Gy`", findings);
    }
    range
}

fn limit(node: &Node, findings: &Findings) -> Option<Limit> {
    let keys = Keys::of(node.map("a limit", "a mapping", findings)?, &KEYS_OF_LIMIT, "a limit", findings);
    let scalar = |key: &str| keys.get(key)?.value.scalar(&format!("`{key}`"), TEXT, findings);
    let of = match (keys.get("structure"), keys.get("target"), keys.get("plan")) {
        (Some(_), None, None) => Of::Structure {
            name: scalar("structure")?.to_owned(),
            patterns: keys.get("match").map_or(Some(Vec::new()), |entry| texts(entry, findings))?,
        },
        (None, Some(entry), None) => match scalar("target")? {
            "each" => Of::EachTarget,
            "highest" => Of::HighestTarget,
            _ => {
                entry.value.refuse("`target`", "`each` or `highest`", findings);
                return None;
            }
        },
        (None, None, Some(Entry { value: Node { value: Value::Switch(true), .. }, .. })) => Of::Plan,
        _ => {
            let help = "write one of `structure: NAME`, `target: each`, `target: highest` and `plan: true`";
            let message = "a limit must say what it is on, once";
            findings.say(node.span, Code::MissingKey, message, help);
            return None;
        }
    };
    let Some(written) = keys.get("limit") else {
        let help = "write `limit: \"V75Gy[%] <= 15\"`";
        findings.say(node.span, Code::MissingKey, "a limit has no `limit`", help);
        return None;
    };
    let source = scalar("source").unwrap_or_default();
    match Limit::new(of, scalar("limit")?, source) {
        Ok(limit) => Some(limit),
        Err(fault) => {
            let help = "quantities are named as by AAPM TG-263; see docs/guide/planning.md";
            findings.say(written.value.span, Code::OutOfRange, fault.to_string(), help);
            None
        }
    }
}

fn texts(entry: &Entry, findings: &Findings) -> Option<Vec<String>> {
    let what = format!("`{}`", entry.key.value);
    let items = entry.value.list(&what, "a list of names", findings)?;
    items.iter().map(|item| item.scalar(&what, TEXT, findings).map(str::to_owned)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::{lung, neck, phantom};
    use stillpoint_plan::dose::DoseParams;
    use stillpoint_plan::objectives::ObjectiveTable;

    #[test]
    fn the_shipped_protocols_are_read_and_a_pelvis_gets_that_of_the_prostate() {
        for (name, text) in SHIPPED {
            let (protocol, site) = parse(name, text).unwrap();
            assert!(protocol.limits.len() > 10 && !site.is_empty(), "{name}");
            assert_eq!(protocol.fraction_gy, Some([1.7, 2.3]), "{name}");
        }
        let found = of_site(&phantom(0).unwrap()).unwrap().unwrap();
        assert_eq!(found.name, "prostate");
    }

    /// What is wanted of a whole plan follows from the outline, and conformity from the fall-off.
    #[test]
    fn every_shipped_limit_is_served_by_a_shipped_objective() {
        let table = ObjectiveTable::shipped().unwrap();
        for case in [phantom(0).unwrap(), neck(0).unwrap(), lung(0).unwrap()] {
            let grid = DoseParams::over(case.grid(), 8.0).grid;
            let mut set = table.for_case(&case, &grid).unwrap();
            let served = of_site(&case).unwrap().unwrap().serve(&case, &mut set.structures);
            assert!(served.len() > 5);
            for served in served {
                assert!(served.by.is_some() && !served.is_derived, "{served:?}");
            }
        }
    }

    #[test]
    fn a_fault_of_a_protocol_has_its_line() {
        let refused = |text: &str| parse("own.yaml", text).unwrap_err().to_string();
        let limit = |limit: &str| refused(&format!("name: own\nlimits:\n  - {{ {limit} }}\n"));
        assert!(refused("limits: []").contains("no `name`"));
        assert!(refused("name: own\nlimit: []\n").contains("did you mean `limits`?"));
        let unknown = limit("structure: Rectum, limit: \"V75[%] <= 15\"");
        assert!(unknown.contains("own.yaml:3") && unknown.contains("is not a quantity"), "{unknown}");
        assert!(limit("structure: Rectum, target: each, limit: \"Mean[Gy] <= 1\"").contains("once"));
        assert!(limit("plan: false, limit: \"R50 <= 5\"").contains("once"));
        assert!(limit("target: all, limit: \"D98%[%] >= 95\"").contains("`highest`"));
        assert!(limit("structure: Rectum").contains("no `limit`"));
        for wrong in ["20 Gy", "3 to 2 Gy", "-1 to 2 Gy", "1 to 2"] {
            let text = format!("name: own\nfraction: \"{wrong}\"\nlimits: []\n");
            assert!(refused(&text).contains("1.7 to 2.3 Gy"), "{wrong}");
        }
    }
}
