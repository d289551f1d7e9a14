//! A pipeline in parts: the operators of one host, which run without the others.

use crate::graph::{Graph, Record};

/// The host of processes that name none.
pub const MAIN: &str = "main";

impl Graph {
    /// The part that runs on a host. What comes from another host comes over a wire, and what goes there leaves by one;
    /// the check has seen to it that every edge between hosts is a link.
    pub fn part(mut self, host: &str) -> Self {
        let homes: Vec<String> = self.processes.iter().map(|p| p.host.clone()).collect();
        self.cut(|from, far| homes[from.process] != homes[far.process]);
        let stays = |process: usize| homes[process] == host;
        let operators = renumbered(self.operators.iter().map(|o| stays(o.process)));
        let processes = renumbered((0..homes.len()).map(stays));
        self.operators.retain(|o| stays(o.process));
        for node in &mut self.operators {
            node.process = processes[node.process];
            for input in &mut node.inputs {
                input.edge = input.edge.map(|e| crate::graph::Edge { operator: operators[e.operator], ..e });
            }
        }
        self.processes.retain(|p| p.host == host);
        for process in &mut self.processes {
            for operator in &mut process.operators {
                *operator = operators[*operator];
            }
        }
        if let Record::Topics(topics) = &mut self.record {
            let here =
                |topic: &String| self.operators.iter().flat_map(|o| &o.outputs).any(|o| o.topic == *topic);
            topics.retain(here);
        }
        if host != MAIN {
            self.name = format!("{}-{host}", self.name);
        }
        self
    }
}

/// The new number of each operator that stays; the number of the others is not used.
fn renumbered(stays: impl Iterator<Item = bool>) -> Vec<usize> {
    stays
        .scan(0, |next, stays| {
            let number = *next;
            *next += usize::from(stays);
            Some(number)
        })
        .collect()
}
