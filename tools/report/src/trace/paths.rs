//! The paths from sources to sinks.

use super::journals::Journals;

/// Paths that are followed at most: a graph of many branches has more than anyone reads.
const MOST: usize = 500;

/// A path: the operators that a sample passes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Path {
    /// From the source to the sink.
    pub hops: Vec<Hop>,
}

/// An operator of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hop {
    /// Number of the operator.
    pub operator: usize,
    /// The input by which the sample comes; none at the source.
    pub input: Option<usize>,
    /// The output by which it goes on; none where the path ends with the step.
    pub output: Option<usize>,
}

impl Path {
    /// The topic at the start.
    pub fn from(&self, journals: &Journals<'_>) -> String {
        self.hops.first().map(|hop| name(journals, hop)).unwrap_or_default()
    }

    /// The topic that leaves at the end, or the last operator.
    pub fn to(&self, journals: &Journals<'_>) -> String {
        self.hops.last().map(|hop| name(journals, hop)).unwrap_or_default()
    }

    /// The topics from start to end.
    pub fn text(&self, journals: &Journals<'_>) -> String {
        self.hops.iter().map(|hop| name(journals, hop)).collect::<Vec<_>>().join(" -> ")
    }
}

fn name(journals: &Journals<'_>, hop: &Hop) -> String {
    let stage = &journals.operators[hop.operator].stage;
    hop.output.and_then(|o| stage.outputs.get(o)).unwrap_or(&stage.name).clone()
}

/// All paths, and whether there are more than were listed.
pub fn of(journals: &Journals<'_>) -> (Vec<Path>, bool) {
    let mut found = Vec::new();
    for (number, operator) in journals.operators.iter().enumerate() {
        if !operator.is_source && !operator.acquires {
            continue;
        }
        for output in 0..operator.stage.outputs.len() {
            let mut hops = vec![Hop { operator: number, input: None, output: Some(output) }];
            extend(journals, &mut hops, &mut found);
        }
    }
    let more = found.len() > MOST;
    found.truncate(MOST);
    (found, more)
}

/// All paths from one topic to another, as far as they are followed; `None` if a topic is not there.
pub fn between(journals: &Journals<'_>, from: &str, to: &str) -> Option<Vec<Path>> {
    let place = |topic: &str| {
        let mut all = journals.operators.iter().enumerate();
        all.find_map(|(i, o)| Some((i, o.stage.outputs.iter().position(|t| t == topic)?)))
    };
    let ((operator, output), goal) = (place(from)?, place(to)?);
    let mut found = Vec::new();
    let mut hops = vec![Hop { operator, input: None, output: Some(output) }];
    if (operator, output) == goal {
        return Some(vec![Path { hops }]);
    }
    extend_to(journals, goal, &mut hops, &mut found);
    Some(found)
}

/// Adds all paths that begin with these hops and end with an output.
fn extend_to(journals: &Journals<'_>, goal: (usize, usize), hops: &mut Vec<Hop>, found: &mut Vec<Path>) {
    let Some(Hop { operator, output: Some(output), .. }) = hops.last().copied() else { return };
    for (consumer, input) in journals.consumers(operator, output) {
        if found.len() > MOST || hops.iter().any(|h| h.operator == consumer) {
            continue;
        }
        for output in 0..journals.operators[consumer].stage.outputs.len() {
            hops.push(Hop { operator: consumer, input: Some(input), output: Some(output) });
            if (consumer, output) == goal {
                found.push(Path { hops: hops.clone() });
            } else {
                extend_to(journals, goal, hops, found);
            }
            hops.pop();
        }
    }
}

/// Adds all paths that begin with these hops.
fn extend(journals: &Journals<'_>, hops: &mut Vec<Hop>, found: &mut Vec<Path>) {
    let Some(Hop { operator, output: Some(output), .. }) = hops.last().copied() else { return };
    for (consumer, input) in journals.consumers(operator, output) {
        if found.len() > MOST {
            return;
        }
        let next = &journals.operators[consumer];
        let hop = |output: Option<usize>| Hop { operator: consumer, input: Some(input), output };
        if next.acquires && !next.is_source {
            // What it sends is a new acquisition.
            hops.push(hop(None));
            found.push(Path { hops: hops.clone() });
            hops.pop();
            continue;
        }
        // A loop ends where it comes back to; a source only reads what comes back.
        if next.is_source || hops.iter().any(|h| h.operator == consumer) {
            continue;
        }
        let is_used = |o: usize| !journals.consumers(consumer, o).is_empty();
        let outputs = 0..next.stage.outputs.len();
        if !outputs.clone().any(|o| is_used(o) || next.links[o]) {
            hops.push(hop(None));
            found.push(Path { hops: hops.clone() });
            hops.pop();
            continue;
        }
        for output in outputs {
            hops.push(hop(Some(output)));
            if next.links[output] {
                found.push(Path { hops: hops.clone() });
            } else {
                extend(journals, hops, found);
            }
            hops.pop();
        }
    }
}
