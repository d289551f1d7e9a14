//! A pipeline as a picture: operators in their processes and hosts, edges with their topics, and what was measured on them.
//!
//! - `layout`: places boxes and lines, so that no line passes a box or a name
//! - `svg`, `text`: the picture as SVG; as DOT and Mermaid

mod layout;
mod svg;
mod text;

use serde::Serialize;
use stillpoint_pipeline::graph::Graph;

use crate::trace::{EdgeFigures, Journals, edges};
use crate::wiring::is_activation;

pub use svg::{svg, svg_in_page};
pub use text::{dot, mermaid};

/// What is drawn.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Drawing {
    /// The operators, upstream first.
    pub operators: Vec<Node>,
    /// The edges.
    pub edges: Vec<Edge>,
}

/// An operator.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Node {
    /// Its name.
    pub name: String,
    /// Its kind; empty where it is not known.
    pub kind: String,
    /// Its process.
    pub process: String,
    /// The host of its process; empty where the pipeline has one host.
    pub host: String,
    /// Names of its inputs.
    pub inputs: Vec<String>,
    /// Topics of its outputs.
    pub outputs: Vec<String>,
    /// Activations a second, where they were measured.
    pub rate_hz: Option<f64>,
    /// Median of its step, where it was measured.
    pub step_ms: Option<f64>,
}

/// A topic into an input.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Edge {
    /// The topic.
    pub topic: String,
    /// Number of the producing operator, and of its output.
    #[serde(skip)]
    pub from: (usize, usize),
    /// Number of the consuming operator, and of its input.
    #[serde(skip)]
    pub into: (usize, usize),
    /// The input, `operator.input`.
    pub to: String,
    /// Declared delay.
    pub delay_ms: f64,
    /// It closes a loop: it leads to an operator that stands upstream of its producer.
    pub closes_loop: bool,
    /// It is a link, which leaves the machine's memory.
    pub is_link: bool,
    /// What was measured.
    pub measured: Option<EdgeFigures>,
}

impl Edge {
    /// What is said of the edge at its input: delay, latency, loss.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        if self.closes_loop {
            words.push("loop".to_owned());
        }
        if self.is_link {
            words.push("link".to_owned());
        }
        if self.delay_ms > 0.0 {
            words.push(format!("delay {} ms", self.delay_ms));
        }
        if let Some(measured) = &self.measured {
            if let Some(rate) = measured.rate_hz {
                words.push(format!("{rate:.1} Hz"));
            }
            if let Some(latency) = measured.latency_ms.p50 {
                words.push(format!("{latency:.2} ms"));
            }
            if measured.lost > 0 {
                words.push(format!("{} lost", measured.lost));
            }
        }
        words
    }
}

impl Drawing {
    /// The picture of a pipeline before it runs. `graph` has all edges, those of links included.
    pub fn of_graph(graph: &Graph) -> Self {
        let none: Vec<Vec<stillpoint_samples::Entry>> = vec![Vec::new(); graph.operators.len()];
        Self::of(&Journals::of_run(graph, &none), Some(graph))
    }

    /// The picture of what the journals say. The graph, with all its edges, names kinds, hosts and links.
    pub fn of(journals: &Journals<'_>, graph: Option<&Graph>) -> Self {
        let mut operators: Vec<Node> = journals.operators.iter().map(|o| node(o, graph)).collect();
        let measured = edges(journals);
        let number = |name: &str| operators.iter().position(|o| o.name == name);
        let mut found: Vec<Edge> = Vec::new();
        for figures in measured {
            let Some(to) = number(&figures.to) else { continue };
            let Some(from) = journals.producer(to, figures.input) else { continue };
            let delay = journals.operators[to].delays.get(figures.input).copied().unwrap_or(0);
            found.push(Edge {
                topic: figures.topic.clone(),
                from,
                into: (to, figures.input),
                delay_ms: delay as f64 * 1e-6,
                measured: Some(figures).filter(|f| f.taken > 0),
                ..Edge::default()
            });
        }
        // The edges of links are cut in a live run.
        for node in graph.into_iter().flat_map(|g| &g.operators) {
            for (input, edge) in node.fed() {
                let (Some(graph), Some(to)) = (graph, number(&node.name)) else {
                    continue;
                };
                let producer = &graph.operators[edge.operator];
                let Some(from) = number(&producer.name) else { continue };
                let into = (to, input);
                if !found.iter().any(|e| e.into == into) {
                    found.push(Edge {
                        topic: producer.outputs[edge.output].topic.clone(),
                        from: (from, edge.output),
                        into,
                        delay_ms: edge.delay as f64 * 1e-6,
                        ..Edge::default()
                    });
                }
                if let Some(known) = found.iter_mut().find(|e| e.into == into) {
                    known.is_link = node.far_end.is_some();
                }
            }
        }
        let inputs: Vec<(usize, usize)> = found.iter().map(|e| e.into).collect();
        for (operator, input) in inputs {
            let names = &mut operators[operator].inputs;
            while names.len() <= input {
                names.push(format!("input {}", names.len()));
            }
        }
        for edge in &mut found {
            let node = &operators[edge.into.0];
            edge.to = format!("{}.{}", node.name, node.inputs[edge.into.1]);
            edge.closes_loop = edge.from.0 >= edge.into.0;
        }
        found.sort_by_key(|e| (e.from, e.into));
        Self { operators, edges: found }
    }
}

fn node(operator: &crate::trace::Operator<'_>, graph: Option<&Graph>) -> Node {
    let stage = &operator.stage;
    let known = graph.and_then(|g| Some((g, &g.operators[g.operator(&stage.name)?])));
    let process = known.and_then(|(g, n)| g.processes.get(n.process));
    let times: Vec<u64> =
        operator.entries.iter().filter(|e| is_activation(e)).map(|e| e.header.stamp).collect();
    let seconds = match (times.first(), times.last()) {
        (Some(first), Some(last)) if last > first => Some((last - first) as f64 * 1e-9),
        _ => None,
    };
    Node {
        name: stage.name.clone(),
        kind: known.map(|(_, n)| n.stage.kind.name.to_owned()).unwrap_or_default(),
        process: process.map_or_else(|| operator.process.clone(), |p| p.name.clone()),
        host: process
            .filter(|_| known.is_some_and(|(g, _)| g.processes.iter().any(|p| p.host != g.processes[0].host)))
            .map(|p| p.host.clone())
            .unwrap_or_default(),
        inputs: known
            .map(|(_, n)| n.stage.kind.inputs.iter().map(|i| i.name.to_owned()).collect())
            .unwrap_or_default(),
        outputs: stage.outputs.clone(),
        rate_hz: seconds.map(|s| times.len().saturating_sub(1) as f64 / s),
        step_ms: operator.step_ms().p50,
    }
}

#[cfg(test)]
mod tests;
