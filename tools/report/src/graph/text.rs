//! The picture as text for Graphviz (DOT) and Mermaid.

use std::fmt::Write;

use super::{Drawing, Edge, Node};

/// A process with the numbers of its operators.
type Group<'d> = (&'d str, Vec<usize>);

/// The operators of each process by host, in the order of the operators.
fn groups(drawing: &Drawing) -> Vec<(&str, Vec<Group<'_>>)> {
    let mut hosts: Vec<(&str, Vec<Group<'_>>)> = Vec::new();
    for (number, node) in drawing.operators.iter().enumerate() {
        let at = hosts.iter().position(|(h, _)| *h == node.host).unwrap_or_else(|| {
            hosts.push((&node.host, Vec::new()));
            hosts.len() - 1
        });
        let processes = &mut hosts[at].1;
        match processes.iter_mut().find(|(p, _)| *p == node.process) {
            Some((_, members)) => members.push(number),
            None => processes.push((&node.process, vec![number])),
        }
    }
    hosts
}

/// What a box says below its name.
fn about(node: &Node) -> Vec<String> {
    let mut sentence = Vec::new();
    if !node.kind.is_empty() {
        sentence.push(node.kind.clone());
    }
    if let Some(rate) = node.rate_hz {
        sentence.push(format!("{rate:.1} Hz"));
    }
    if let Some(step) = node.step_ms {
        sentence.push(format!("step {step:.2} ms"));
    }
    sentence
}

/// What an edge says: its topic, its input, and what was measured.
fn label(edge: &Edge, line: &str) -> String {
    let input = edge.to.split_once('.').map_or(edge.to.as_str(), |(_, input)| input);
    [&[format!("{} > {input}", edge.topic)][..], &edge.words()].concat().join(line)
}

/// A text in quotes, for both languages.
fn quoted(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"")
}

/// The picture in DOT, the language of Graphviz.
pub fn dot(drawing: &Drawing) -> String {
    let mut out =
        String::from("digraph pipeline {\n  rankdir=LR;\n  node [shape=box, fontname=\"monospace\"];\n");
    out.push_str("  edge [fontname=\"monospace\", fontsize=10];\n");
    for (h, (host, processes)) in groups(drawing).into_iter().enumerate() {
        if !host.is_empty() {
            let _ = writeln!(out, "  subgraph cluster_host_{h} {{\n  label=\"host {}\";", quoted(host));
        }
        for (p, (process, members)) in processes.into_iter().enumerate() {
            let _ = writeln!(out, "  subgraph cluster_{h}_{p} {{\n    label=\"{}\";", quoted(process));
            for number in members {
                let node = &drawing.operators[number];
                let text = [&[node.name.clone()][..], &about(node)].concat();
                let text: Vec<String> = text.iter().map(|t| quoted(t)).collect();
                let _ = writeln!(out, "    o{number} [label=\"{}\"];", text.join("\\n"));
            }
            out.push_str("  }\n");
        }
        if !host.is_empty() {
            out.push_str("  }\n");
        }
    }
    for edge in &drawing.edges {
        let style = match (edge.is_link, edge.closes_loop) {
            (_, true) => ", style=dashed, constraint=false",
            (true, _) => ", style=dotted",
            _ => "",
        };
        let text: Vec<String> = label(edge, "\n").lines().map(quoted).collect();
        let _ =
            writeln!(out, "  o{} -> o{} [label=\"{}\"{style}];", edge.from.0, edge.into.0, text.join("\\n"));
    }
    out.push_str("}\n");
    out
}

/// A text of Mermaid: quotes and angle brackets are entities.
fn entities(text: &str) -> String {
    text.replace('&', "#amp;").replace('"', "#quot;").replace('<', "#lt;").replace('>', "#gt;")
}

/// The picture in Mermaid.
pub fn mermaid(drawing: &Drawing) -> String {
    let mut out = String::from("flowchart LR\n");
    for (h, (host, processes)) in groups(drawing).into_iter().enumerate() {
        if !host.is_empty() {
            let _ = writeln!(out, "  subgraph h{h}[\"host {}\"]", entities(host));
        }
        for (p, (process, members)) in processes.into_iter().enumerate() {
            let _ = writeln!(out, "  subgraph p{h}_{p}[\"{}\"]", entities(process));
            for number in members {
                let node = &drawing.operators[number];
                let text = [&[node.name.clone()][..], &about(node)].concat();
                let text: Vec<String> = text.iter().map(|t| entities(t)).collect();
                let _ = writeln!(out, "    o{number}[\"{}\"]", text.join("<br/>"));
            }
            out.push_str("  end\n");
        }
        if !host.is_empty() {
            out.push_str("  end\n");
        }
    }
    for edge in &drawing.edges {
        let arrow = if edge.closes_loop || edge.is_link { "-.->" } else { "-->" };
        let text: Vec<String> = label(edge, "\n").lines().map(entities).collect();
        let _ = writeln!(out, "  o{} {arrow}|\"{}\"| o{}", edge.from.0, text.join("<br/>"), edge.into.0);
    }
    out
}
