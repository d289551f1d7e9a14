//! The journals of a running pipeline, read without being a part of it.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use stillpoint_pipeline::live::contracts;
use stillpoint_pipeline::live::run_folder::is_going_on;
use stillpoint_samples::{Entry, Journal, Pieces};
use stillpoint_shm::{Subscriber, Topic};

use crate::attach::Attached;
use crate::exit::Failure;
use crate::signals::stop_flag;

/// Interval at which journals are read: a listener would cost the publisher time.
pub const LOOK: Duration = Duration::from_millis(10);

/// Subscriptions to the journals of operators, by number of the operator.
pub struct JournalTaps {
    // Ports are dropped before their topics.
    taps: Vec<(usize, Subscriber, Topic)>,
}

impl JournalTaps {
    /// Opens the journals of the operators for which `which` holds.
    pub fn open(attached: &Attached, which: impl Fn(&str) -> bool) -> Result<Self, Failure> {
        let graph = &attached.graph;
        let mut taps = Vec::new();
        for (number, _) in graph.operators.iter().enumerate().filter(|(_, o)| which(&o.name)) {
            let contract = contracts::journal(graph, number);
            let topic = Topic::open(&attached.domain, &contract).map_err(Failure::failed)?;
            let subscriber = topic.subscriber(contracts::JOURNAL_DEPTH).map_err(Failure::failed)?;
            subscriber.connect().map_err(Failure::failed)?;
            taps.push((number, subscriber, topic));
        }
        Ok(Self { taps })
    }

    /// Gives the entries that came since the last look, with the number of their operator.
    pub fn look(&self, take: &mut dyn FnMut(usize, Entry)) -> Result<(), Failure> {
        for (operator, journal, _) in &self.taps {
            while let Some(sample) = journal.receive().map_err(Failure::failed)? {
                if let Some(entry) = entry_of(sample.pieces()) {
                    take(*operator, entry);
                }
            }
        }
        Ok(())
    }

    /// Gives all entries of a time, or until a signal or the end of the run.
    pub fn watch(
        &self,
        attached: &Attached,
        time: Duration,
        take: &mut dyn FnMut(usize, Entry),
    ) -> Result<(), Failure> {
        self.watch_with(attached, time, take, &mut || Ok(()))
    }

    /// The same, with something else that is looked at each time.
    pub fn watch_with(
        &self,
        attached: &Attached,
        time: Duration,
        take: &mut dyn FnMut(usize, Entry),
        also: &mut dyn FnMut() -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let (begun, stop) = (Instant::now(), stop_flag()?);
        while begun.elapsed() < time && !stop.load(Ordering::Relaxed) && is_going_on(&attached.folder()) {
            self.look(take)?;
            also()?;
            std::thread::sleep(LOOK.min(time.saturating_sub(begun.elapsed())));
        }
        self.look(take)?;
        also()
    }
}

fn entry_of(pieces: Pieces<'_>) -> Option<Entry> {
    let view = pieces.view::<Journal>().ok()?;
    Some(Entry { header: view.header, body: *view.body, refs: view.elements.to_vec() })
}
