//! Misspelled names of kinds, parameters, ports and keys, all that the project has: the first suggestion is the right one.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Registry, Stage};
use stillpoint_pipeline::config::{check, schema};

use crate::registry;

/// What typing goes wrong by: a letter left out, doubled, another one, or swapped with the next.
fn misspellings(name: &str) -> Vec<String> {
    let chars: Vec<char> = name.chars().collect();
    let mut out = Vec::new();
    for i in 0..chars.len() {
        let mut left_out = chars.clone();
        left_out.remove(i);
        let mut doubled = chars.clone();
        doubled.insert(i, chars[i]);
        let mut other = chars.clone();
        other[i] = if chars[i] == 'r' { 't' } else { 'r' };
        let mut swapped = chars.clone();
        if i + 1 < chars.len() {
            swapped.swap(i, i + 1);
        }
        out.extend([left_out, doubled, other, swapped].map(String::from_iter));
    }
    // Without these a word is still a word, but YAML may read it as something else: `-x`, `y.`.
    out.retain(|wrong| wrong.starts_with(|c: char| c.is_ascii_lowercase()) && !wrong.ends_with('.'));
    out
}

/// Misspelled names, and to how many of them the checker suggests the right one.
#[derive(Default)]
struct Share {
    all: u32,
    right: u32,
}

impl Share {
    /// Misspells each name in turn in a text.
    fn count(&mut self, names: &[&str], registry: &Registry, text: impl Fn(&str) -> String) {
        for name in names {
            for wrong in misspellings(name).iter().filter(|wrong| !names.contains(&wrong.as_str())) {
                self.all += 1;
                let faults = check(&text(wrong), "any.yaml", &[], registry, &MemoryFiles::default()).err();
                let list = faults.as_ref().map_or(&[][..], |faults| faults.list());
                let output_text = list.iter().find(|fault| fault.message.contains(wrong.as_str()));
                self.right +=
                    u32::from(output_text.is_some_and(|f| f.help == format!("did you mean `{name}`?")));
            }
        }
    }

    fn is_good(&self, of: &str) {
        let share = f64::from(self.right) / f64::from(self.all);
        assert!(self.all > 100 && share >= 0.9, "{of}: {} of {} right", self.right, self.all);
    }
}

const HEAD: &str = "stillpoint: 1\nname: any\n";

/// A pipeline of one operator.
fn one(kind: &str, rest: &str) -> String {
    format!("{HEAD}operators:\n  one: {{ use: {kind}{rest} }}\n")
}

#[test]
fn of_kinds_and_keys() {
    let registry = registry();
    let kinds: Vec<&str> = registry.iter().map(|stage| stage.kind.name).collect();
    let mut share = Share::default();
    share.count(&kinds, &registry, |wrong| one(wrong, ""));
    share.is_good("kinds");

    let schema = schema::schema(&registry);
    let keys = |of: &str| -> Vec<String> {
        schema.pointer(of).unwrap().as_object().unwrap().keys().cloned().collect()
    };
    let mut share = Share::default();
    let top = keys("/properties");
    let top: Vec<&str> = top.iter().map(String::as_str).collect();
    share.count(&top, &registry, |wrong| format!("{}{wrong}: 1\n", one("console", "")));
    let operator = keys("/$defs/operator/properties");
    let operator: Vec<&str> = operator.iter().map(String::as_str).collect();
    share.count(&operator, &registry, |wrong| one("console", &format!(", {wrong}: 1")));
    share.is_good("keys");
}

#[test]
fn of_parameters() {
    let registry = registry();
    let mut share = Share::default();
    for Stage { kind, fields, .. } in registry.iter() {
        let names: Vec<&str> = fields.iter().map(|field| field.name).collect();
        share.count(&names, &registry, |wrong| one(kind.name, &format!(", params: {{ {wrong}: 1 }}")));
    }
    share.is_good("parameters");
}

#[test]
fn of_ports() {
    let registry = registry();
    let (mut inputs, mut outputs) = (Share::default(), Share::default());
    for Stage { kind, .. } in registry.iter() {
        let names: Vec<&str> = kind.inputs.iter().map(|input| input.name).collect();
        inputs.count(&names, &registry, |wrong| one(kind.name, &format!(", inputs: {{ {wrong}: a.b }}")));
        let names: Vec<&str> = kind.outputs.iter().map(|output| output.name).collect();
        outputs.count(&names, &registry, |wrong| {
            format!("{}record: {{ topics: [one.{wrong}] }}\n", one(kind.name, ""))
        });
    }
    inputs.is_good("inputs");
    outputs.is_good("outputs");
}
