//! The schema accepts the good files and knows each parameter; the reference has a row for each.

use regex_lite::Regex;
use serde_json::{Value as Json, json};
use stillpoint_operator::config::faults::Findings;
use stillpoint_operator::config::tree::{Node, Value};
use stillpoint_operator::config::yaml::parse;
use stillpoint_pipeline::config::reference::reference;
use stillpoint_pipeline::config::schema::schema;
use stillpoint_pipeline::config::{Code, check};

use crate::disk::Disk;
use crate::good::FILES;
use crate::kinds::registry;

/// A tree as an editor sees it.
fn as_json(node: &Node) -> Json {
    match &node.value {
        Value::Nothing | Value::Refused => Json::Null,
        Value::Switch(on) => json!(on),
        Value::Text(text) => {
            serde_json::from_str(text).ok().filter(|v: &Json| !v.is_string()).unwrap_or(json!(text))
        }
        Value::List(items) => items.iter().map(as_json).collect(),
        Value::Map(entries) => {
            Json::Object(entries.iter().map(|e| (e.key.value.clone(), as_json(&e.value))).collect())
        }
    }
}

/// The part of JSON Schema that the schema uses; the reasons why a value does not fit.
fn misfits(root: &Json, schema: &Json, value: &Json, at: &str) -> Vec<String> {
    let Some(schema) = schema.as_object() else {
        return if schema == &json!(false) {
            vec![format!("{at}: nothing may stand here")]
        } else {
            Vec::new()
        };
    };
    let mut out = Vec::new();
    for (key, rule) in schema {
        let fits = |s: &Json| misfits(root, s, value, at).is_empty();
        let rules = || rule.as_array().unwrap().iter();
        let is_type = |t: &Json| match t.as_str().unwrap() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "number" => value.is_number(),
            "integer" => value.is_i64() || value.is_u64(),
            "boolean" => value.is_boolean(),
            "null" => value.is_null(),
            other => panic!("unknown type {other}"),
        };
        let number = value.as_f64();
        let ok = match key.as_str() {
            "$schema" | "$defs" | "title" | "description" | "default" | "then" => true,
            "$ref" => {
                let target = root.pointer(rule.as_str().unwrap().trim_start_matches('#')).unwrap();
                out.extend(misfits(root, target, value, at));
                true
            }
            "type" => rule.as_array().map_or_else(|| is_type(rule), |types| types.iter().any(is_type)),
            "const" => value == rule,
            "enum" => rules().any(|v| v == value),
            "oneOf" => rules().filter(|s| fits(s)).count() == 1,
            "anyOf" => rules().any(fits),
            "not" => !fits(rule),
            "allOf" => {
                out.extend(rules().flat_map(|s| misfits(root, s, value, at)));
                true
            }
            "if" => {
                if fits(rule) {
                    out.extend(misfits(root, &schema["then"], value, at));
                }
                true
            }
            "pattern" => {
                let pattern = Regex::new(rule.as_str().unwrap()).unwrap();
                value.as_str().is_none_or(|v| pattern.is_match(v))
            }
            "minimum" => number.is_none_or(|n| n >= rule.as_f64().unwrap()),
            "exclusiveMinimum" => number.is_none_or(|n| n > rule.as_f64().unwrap()),
            "maximum" => number.is_none_or(|n| n <= rule.as_f64().unwrap()),
            "minItems" => value.as_array().is_none_or(|v| v.len() as u64 >= rule.as_u64().unwrap()),
            "maxItems" => value.as_array().is_none_or(|v| v.len() as u64 <= rule.as_u64().unwrap()),
            "items" => {
                for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                    out.extend(misfits(root, rule, item, &format!("{at}[{i}]")));
                }
                true
            }
            "required" => {
                value.as_object().is_none_or(|v| rules().all(|k| v.contains_key(k.as_str().unwrap())))
            }
            "propertyNames" => value
                .as_object()
                .into_iter()
                .flatten()
                .all(|(k, _)| misfits(root, rule, &json!(k), at).is_empty()),
            "properties" => {
                for (name, item) in value.as_object().into_iter().flatten() {
                    if let Some(rule) = rule.get(name) {
                        out.extend(misfits(root, rule, item, &format!("{at}.{name}")));
                    }
                }
                true
            }
            "additionalProperties" => {
                let known = schema.get("properties").and_then(Json::as_object);
                for (name, item) in value.as_object().into_iter().flatten() {
                    if !known.is_some_and(|k| k.contains_key(name)) {
                        out.extend(misfits(root, rule, item, &format!("{at}.{name}")));
                    }
                }
                true
            }
            other => panic!("unknown rule {other}"),
        };
        if !ok {
            out.push(format!("{at}: {key} {rule} does not hold for {value}"));
        }
    }
    out
}

fn tree(text: &str) -> Json {
    as_json(&parse(text, 0, 0, &Findings::default()).unwrap())
}

#[test]
fn good_files_fit_the_schema() {
    let schema = schema(&registry());
    for (name, text) in FILES {
        let misfits = misfits(&schema, &schema, &tree(text), name);
        assert!(misfits.is_empty(), "{}", misfits.join("\n"));
    }
}

#[test]
fn wrong_keys_units_and_kinds_do_not_fit_the_schema() {
    let schema = schema(&registry());
    let good = FILES[0].1;
    for (from, to) in [
        ("leaf: 4 mm", "leaf: 4 ms"),
        ("leaf: 4 mm", "laef: 4 mm"),
        ("gain: 0.5", "gain: 50"),
        ("motion: slow_sweep", "motion: fast"),
        ("use: track.head", "use: track.haed"),
        ("every: 100 ms, frame", "frame"),
        ("image: rig.depth", "imag: rig.depth"),
        ("fifo 50", "fifo 500"),
        ("by: [11.5 mm, 0 mm, 10 mm]", "by: [11.5 mm, 0 mm]"),
        ("stillpoint: 1", "stillpoint: 2"),
    ] {
        let broken = good.replacen(from, to, 1);
        assert_ne!(broken, good, "{from}");
        assert!(!misfits(&schema, &schema, &tree(&broken), "").is_empty(), "{to}");
    }
}

#[test]
fn schema_and_reference_know_each_parameter() {
    let registry = registry();
    let schema = schema(&registry);
    let page = reference(&registry);
    let rules = schema["$defs"]["operator"]["allOf"].as_array().unwrap();
    for (stage, rule) in registry.iter().zip(rules) {
        assert_eq!(rule["if"]["properties"]["use"]["const"], stage.kind.name);
        for field in stage.fields {
            let param = &rule["then"]["properties"]["params"]["properties"][field.name];
            assert!(param["description"].as_str().unwrap().starts_with(field.about), "{}", field.name);
            assert!(page.contains(&format!("| `{}` |", field.name)));
        }
    }
    assert!(
        page.contains("| `step.by` | 3 times a length (m) | required |  | By how much the target moves. |")
    );
    assert!(page.contains("| `leaf` | a length (m) | `4 mm` | from 0.5 mm to 50 mm | Edge of a voxel. |"));
}

#[test]
fn defaults_and_ranges_stand_in_the_schema() {
    let schema = schema(&registry());
    let rules = schema["$defs"]["operator"]["allOf"].as_array().unwrap();
    let face = rules.iter().find(|r| r["if"]["properties"]["use"]["const"] == "segment.face").unwrap();
    let params = &face["then"]["properties"]["params"]["properties"];
    assert_eq!(params["leaf"]["default"], "4 mm");
    assert_eq!(params["iterations"]["default"], 500);
    assert_eq!(params["iterations"]["maximum"], 100_000);
    assert_eq!(params["crop"]["default"], true);
}

/// Files whose fault of such a code a schema cannot see, with the reason.
const BEYOND_THE_SCHEMA: &[(&str, &str)] = &[
    ("hosts_none_connects", "which host reaches which"),
    ("hosts_nothing", "one of several keys is needed"),
    ("link_without_address", "the section `hosts` decides whether a link needs an address"),
    ("name_missing", "a file that others include has no name"),
    ("operators_empty", "an empty mapping is a mapping"),
    ("process_reserved", "names that a run gives to its own processes"),
    ("ros2_missing", "an operator needs another section"),
    ("ros2_nothing", "an operator or a publication gives the section a use"),
    ("ros2_tf", "a name that `frames` has already"),
    ("start_within", "the kind decides whether it has a timer"),
];

#[test]
fn the_schema_refuses_broken_files_whose_fault_is_in_one_place() {
    let schema = schema(&registry());
    let seen_by_editors = [
        Code::UnknownKey,
        Code::MissingKey,
        Code::WrongShape,
        Code::MissingUnit,
        Code::WrongUnit,
        Code::UnknownUnit,
        Code::UnknownKind,
        Code::UnknownChoice,
        Code::NotANumber,
        Code::BadName,
        Code::TimerMissing,
        Code::TimerForbidden,
        Code::MissingParam,
    ];
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/broken");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "yaml"));
    files.sort();
    let (mut refused, mut accepted) = (0, Vec::new());
    for path in files {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        let Some(faults) = check(&text, &name, &[], &registry(), &Disk).err() else { continue };
        let findings = Findings::default();
        let Some(root) = parse(&text, 0, 0, &findings).filter(|_| findings.is_empty()) else { continue };
        if !faults.list().iter().any(|fault| seen_by_editors.contains(&fault.code)) {
            continue;
        }
        match misfits(&schema, &schema, &as_json(&root), &name).is_empty() {
            true => accepted.push(name),
            false => refused += 1,
        }
    }
    let expected: Vec<&str> = BEYOND_THE_SCHEMA.iter().map(|(name, _)| *name).collect();
    assert_eq!(accepted, expected);
    assert!(refused >= 60, "{refused}");
}
