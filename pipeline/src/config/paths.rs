//! The values of a pipeline that are paths: parameters that name files, sources of operators in Python, programs of operators, certificates of hosts.

use super::host_section::TLS_KEYS;
use super::tree::{Node, Value};
use super::wiring::IN_PYTHON;
use crate::operator::{Files, Registry};
use crate::params::{Names, ParamField, ParamType};
use crate::programs::name_of;

/// Calls `visit` for each value that is a path, in the order of the file. A kind is looked up after its own path was
/// visited. Returns whether all kinds are known: of another, nobody knows which parameters are paths.
pub fn each(
    root: &mut Node,
    registry: &Registry,
    files: &dyn Files,
    visit: &mut dyn FnMut(&mut Node),
) -> bool {
    let mut is_whole = true;
    for operator in values(root.get_mut("operators")) {
        let Some(kind) = operator.get_mut("use") else { continue };
        if matches!(&kind.value, Value::Text(text) if text.contains(IN_PYTHON)) {
            visit(kind);
        }
        if let Some(program) = kind.get_mut("program") {
            visit(program);
        }
        let name = match (&kind.value, kind.get("program"), kind.get("kind")) {
            (Value::Text(name), ..) => name.clone(),
            (
                _,
                Some(Node { value: Value::Text(program), .. }),
                Some(Node { value: Value::Text(kind), .. }),
            ) => name_of(program, kind),
            _ => continue,
        };
        let Some(Ok(stage)) = registry.find(&name, files) else {
            is_whole = false;
            continue;
        };
        if let Some(params) = operator.get_mut("params") {
            fields(params, stage.fields, visit);
        }
    }
    for host in values(root.get_mut("hosts")) {
        let Some(tls) = host.get_mut("tls") else { continue };
        tls.entries_mut()
            .iter_mut()
            .filter(|e| TLS_KEYS.contains(&e.key.value.as_str()))
            .for_each(|e| visit(&mut e.value));
    }
    is_whole
}

fn fields(group: &mut Node, fields_of: &[ParamField], visit: &mut dyn FnMut(&mut Node)) {
    for entry in group.entries_mut() {
        if let Some(field) = fields_of.iter().find(|f| f.name == entry.key.value) {
            value(&mut entry.value, field.ty, field.names, visit);
        }
    }
}

fn value(node: &mut Node, ty: ParamType, names: Names, visit: &mut dyn FnMut(&mut Node)) {
    match (ty, &mut node.value) {
        (ParamType::Text, Value::Text(_)) if names != Names::Nothing => visit(node),
        (ParamType::List { of, .. }, Value::List(items)) => {
            items.iter_mut().for_each(|item| value(item, *of, names, visit));
        }
        (ParamType::Group(inner), _) => fields(node, inner, visit),
        _ => {}
    }
}

fn values(node: Option<&mut Node>) -> impl Iterator<Item = &mut Node> {
    node.map(Node::entries_mut).unwrap_or_default().iter_mut().map(|e| &mut e.value)
}
