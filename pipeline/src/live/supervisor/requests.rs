//! Requests of people to restart an operator, and the changes of parameters that operators took: a process that is started
//! again begins with them.

use stillpoint_samples::{Setting, SettingAnswer, SettingElement};
use stillpoint_shm::{ShmError, Subscriber, Topic};

use super::Supervisor;
use crate::graph::{Graph, Restart};
use crate::live::contracts;
use crate::live::control::ToWorker;
use crate::live::error::LiveError;
use crate::live::log::Level;
use crate::settings::TakenChange;

/// The begin of a line of the log about a request that is refused; `stillpoint restart` prints what follows.
pub const REFUSED: &str = "not restarted: ";

/// What people and operators say to the supervisor.
pub(super) struct Requests {
    restarts: Subscriber,
    /// By operator with live parameters: its answers to changes.
    answers: Vec<(usize, Subscriber)>,
    /// By operator: the changes that it took.
    changes: Vec<Vec<TakenChange>>,
}

/// Why an operator is not restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum RefusedRestart {
    #[error("there is no such operator in this part of the pipeline")]
    Unknown,
    #[error("its restart policy is never")]
    Never,
    #[error("it has finished")]
    Finished,
    #[error("its process does not run")]
    Down,
}

impl Requests {
    /// Opens the topics among those of the run.
    pub(super) fn open(graph: &Graph, topics: &[Topic]) -> Result<Self, LiveError> {
        let open = |name: &str, depth: usize| {
            let topic = topics.iter().find(|t| t.contract().topic == name);
            let topic = topic.ok_or_else(|| LiveError::NoTopic(name.to_owned()))?;
            Ok::<_, LiveError>(topic.subscriber(depth)?)
        };
        let mut answers = Vec::new();
        for (operator, node) in graph.operators.iter().enumerate() {
            if let Some(output) = node.stage.settings_output() {
                answers.push((operator, open(&node.outputs[output].topic, contracts::SETTINGS_HELD)?));
            }
        }
        let inbox = contracts::restart_inbox(graph);
        let restarts = open(&inbox.topic, inbox.buffer)?;
        Ok(Self { restarts, answers, changes: vec![Vec::new(); graph.operators.len()] })
    }

    /// Connects to all publishers that are there.
    pub(super) fn connect(&self) -> Result<(), ShmError> {
        for subscriber in self.answers.iter().map(|(_, answers)| answers).chain([&self.restarts]) {
            subscriber.connect()?;
        }
        Ok(())
    }

    /// Reads which changes operators took. Whether there are new ones.
    fn read_answers(&mut self) -> bool {
        let mut has_news = false;
        for (operator, answers) in &self.answers {
            while let Ok(Some(sample)) = answers.receive() {
                let view = sample.pieces().view::<SettingAnswer>();
                let taken = view.ok().and_then(|view| TakenChange::of(view.first()?));
                has_news |= taken.is_some();
                self.changes[*operator].extend(taken);
            }
        }
        has_news
    }

    /// The changes that an operator took.
    pub(super) fn changes(&self, operator: usize) -> Vec<TakenChange> {
        self.changes[operator].clone()
    }

    /// The requests since the last call.
    fn restarts(&self) -> Vec<SettingElement> {
        // Who asks joins at any time.
        let _ = self.restarts.connect();
        let mut found = Vec::new();
        while let Ok(Some(sample)) = self.restarts.receive() {
            found.extend(sample.pieces().view::<Setting>().ok().and_then(|view| view.first().copied()));
        }
        found
    }
}

impl Supervisor {
    /// Reads which changes operators took, and notes them for those who join: with a process go the answers that it keeps.
    pub(super) fn read_answers(&mut self) {
        if self.requests.read_answers() {
            let names = self.graph.operators.iter().map(|node| node.name.as_str());
            self.folder.note_changes(&names.zip(&self.requests.changes).collect());
        }
    }

    /// Orders the restarts that people ask for, or logs why not.
    pub(super) fn attend_requests(&mut self) {
        for request in self.requests.restarts() {
            let (name, by) = (request.path().to_owned(), request.by().to_owned());
            let by = if by.is_empty() { "somebody".to_owned() } else { by };
            match self.restart_on_request(&name) {
                Ok(()) => self.say(Level::Warn, &name, format!("restarts on request of {by}")),
                Err(why) => self.say(Level::Warn, &name, format!("{REFUSED}{why}")),
            }
        }
    }

    fn restart_on_request(&mut self, name: &str) -> Result<(), RefusedRestart> {
        let operator = self.graph.operator(name).ok_or(RefusedRestart::Unknown)?;
        let process = self.graph.operators[operator].process;
        if self.graph.processes[process].restart == Restart::Never {
            return Err(RefusedRestart::Never);
        }
        if self.finished.has(operator) {
            return Err(RefusedRestart::Finished);
        }
        let worker = self.workers.iter_mut().find(|w| w.process == process && w.went);
        let child = worker.and_then(|w| w.child.as_mut()).filter(|child| !child.is_gone());
        child.ok_or(RefusedRestart::Down)?.send_message(&ToWorker::Restart { operator });
        Ok(())
    }
}
