//! What the checker knows of the machine that a pipeline is to run on.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;

use super::document::Document;
use super::faults::{Code, Findings};

/// The machine that a pipeline is to run on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Machine {
    cores: BTreeSet<usize>,
    /// A run on it is live: a step that misses its deadline is a fault of the machine, not part of the model.
    is_live: bool,
    /// The pipeline is to run on it, and is not a session's that is replayed.
    is_to_run: bool,
    /// Variables of the environment, which paths of the file may name.
    variables: BTreeMap<String, String>,
}

impl Machine {
    /// This machine, for a live run: the cores that this process may use.
    pub fn here() -> Self {
        let set = rustix::thread::sched_getaffinity(None);
        let all = 0..rustix::thread::CpuSet::MAX_CPU;
        let cores = set.map(|set| all.filter(|core| set.is_set(*core)).collect()).unwrap_or_default();
        Self { cores, is_live: true, is_to_run: true, ..Self::any() }
    }

    /// A machine of which only the variables of this process are known.
    pub fn any() -> Self {
        let text =
            |(name, value): (OsString, OsString)| Some((name.into_string().ok()?, value.into_string().ok()?));
        Self { variables: std::env::vars_os().filter_map(text).collect(), ..Self::default() }
    }

    /// The same with these variables of the environment alone.
    #[must_use]
    pub fn with_variables<'t>(self, variables: impl IntoIterator<Item = (&'t str, &'t str)>) -> Self {
        let text = |(name, value): (&str, &str)| (name.to_owned(), value.to_owned());
        Self { variables: variables.into_iter().map(text).collect(), ..self }
    }

    /// Variables of the environment by name.
    pub(super) fn variables(&self) -> &BTreeMap<String, String> {
        &self.variables
    }

    /// The same for a run in session time: there, a `latency` above the `deadline` models a step that comes too late.
    #[must_use]
    pub fn in_session_time(self) -> Self {
        Self { is_live: false, ..self }
    }

    /// A machine with these cores.
    pub fn with_cores(cores: impl IntoIterator<Item = usize>) -> Self {
        Self { cores: cores.into_iter().collect(), is_live: true, is_to_run: true, ..Self::default() }
    }

    /// Whether a pipeline is to run on it.
    pub(super) fn is_to_run(&self) -> bool {
        self.is_to_run
    }

    /// Finds what a pipeline, or the part of it that runs on `host`, asks for and this machine does not have.
    pub(super) fn check(&self, document: &Document<'_>, host: Option<&str>, findings: &Findings) {
        if self.is_live {
            check_deadlines(document, findings);
        }
        // Where the system does not say which cores there are, the run will.
        let Some(nearest) = self.cores.last() else { return };
        let here = document.processes.iter().filter(|p| host.is_none_or(|host| p.host.value == host));
        for core in here.filter_map(|p| p.core.as_ref()) {
            if !self.cores.contains(&core.value) {
                findings.say(
                    core.span,
                    Code::CoreMissing,
                    format!(
                        "there is no core {}: a run on the machine that was asked may use {}",
                        core.value,
                        self.names()
                    ),
                    format!(
                        "write for example `core: {nearest}`, or check the file on the machine that runs it"
                    ),
                );
            }
        }
    }

    /// The cores in words: `core 0`, `the cores 0 to 3, 6`.
    fn names(&self) -> String {
        let mut ranges: Vec<(usize, usize)> = Vec::new();
        for core in &self.cores {
            match ranges.last_mut() {
                Some((_, last)) if *last + 1 == *core => *last = *core,
                _ => ranges.push((*core, *core)),
            }
        }
        let one = |(first, last): &(usize, usize)| match first == last {
            true => first.to_string(),
            false => format!("{first} to {last}"),
        };
        let list = ranges.iter().map(one).collect::<Vec<_>>().join(", ");
        if self.cores.len() == 1 { format!("core {list}") } else { format!("the cores {list}") }
    }
}

/// Finds operators whose steps are declared to miss their deadline.
fn check_deadlines(document: &Document<'_>, findings: &Findings) {
    for operator in &document.operators {
        if let (Some(place), Some(deadline)) = (operator.has_latency, operator.deadline)
            && operator.latency > deadline
        {
            findings.say(
                place,
                Code::OutOfRange,
                format!(
                    "each step would last {} ms and miss its deadline of {} ms",
                    operator.latency as f64 * 1e-6,
                    deadline as f64 * 1e-6
                ),
                "make `latency` at most as long as `deadline`",
            );
        }
    }
}
