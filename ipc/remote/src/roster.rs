//! Those who greet through a router: hosts by their beats, and workers of the planning pool.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

use crate::declare::subscriber;
use crate::shared::lock;
use crate::{Beat, RemoteError, names};

/// How the names of workers begin. Those who ask workers send to all, too, and are no members.
const WORKER: &str = "worker-";
/// The most members; of more, the one that was silent longest goes.
const MOST_MEMBERS: usize = 1024;
/// Time after which a silent member is forgotten.
const FORGOTTEN: Duration = Duration::from_secs(600);
/// Time of silence after which a member is taken as gone: several greetings.
const GONE: Duration = Duration::from_secs(2);

/// Those who greet through a router. Only greetings are taken, which are short: what flows between others is not.
#[derive(Debug, Default)]
pub struct Roster(Mutex<BTreeMap<String, Entry>>);

#[derive(Debug)]
struct Entry {
    last: Instant,
    greetings: u64,
    beat: Option<Beat>,
}

/// One of them.
#[derive(Clone, Debug)]
pub struct Member {
    /// Its name.
    pub name: String,
    /// Greetings since the router knows it.
    pub greetings: u64,
    /// Time since the last one.
    pub silent: Duration,
    /// The last beat of a host; none of a worker.
    pub beat: Option<Beat>,
}

impl Member {
    /// Whether it greeted a short time ago.
    pub fn is_there(&self) -> bool {
        self.silent < GONE
    }
}

impl Roster {
    /// The members by name.
    pub fn members(&self) -> Vec<Member> {
        let entries = lock(&self.0);
        let member = |(name, entry): (&String, &Entry)| Member {
            name: name.clone(),
            greetings: entry.greetings,
            silent: entry.last.elapsed(),
            beat: entry.beat.clone(),
        };
        entries.iter().map(member).collect()
    }

    fn enter(&self, name: &str, beat: Option<Beat>) {
        let mut entries = lock(&self.0);
        entries.retain(|_, entry| entry.last.elapsed() < FORGOTTEN);
        if !entries.contains_key(name) && entries.len() >= MOST_MEMBERS {
            let silent = entries.iter().min_by_key(|(_, entry)| entry.last).map(|(name, _)| name.clone());
            silent.into_iter().for_each(|name| drop(entries.remove(&name)));
        }
        let now = Instant::now();
        let entry = entries.entry(name.to_owned()).or_insert(Entry { last: now, greetings: 0, beat: None });
        entry.last = now;
        entry.greetings += 1;
        entry.beat = beat.or(entry.beat.take());
    }

    /// Subscribes to the greetings in the session for small samples of a router.
    pub(crate) fn subscribe(
        self: &std::sync::Arc<Self>,
        session: &Session,
        prefix: &str,
    ) -> Result<[Subscriber<()>; 2], RemoteError> {
        let (of_hosts, of_workers) = (self.clone(), self.clone());
        let host = move |sample: Sample| {
            let beat = Beat::read(&sample.payload().to_bytes());
            // Nobody greets under the name of another.
            let is_own = |beat: &Beat| {
                sample.key_expr().as_str().rsplit('/').next() == Some(&names::chunk(&beat.host))
            };
            if let Ok(beat) = beat
                && is_own(&beat)
            {
                of_hosts.enter(&beat.host.clone(), Some(beat));
            }
        };
        let worker = move |sample: Sample| {
            let name = sample.key_expr().as_str().rsplit('/').next();
            if let Some(name) = name.filter(|name| name.starts_with(WORKER)) {
                of_workers.enter(name, None);
            }
        };
        Ok([
            subscriber(session, &names::all_beats(prefix), host)?,
            subscriber(session, &names::pool_greetings(prefix), worker)?,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roster_counts_greetings_and_holds_a_limited_number_of_members() {
        let roster = Roster::default();
        for _ in 0..3 {
            roster.enter("worker-a", None);
        }
        let members = roster.members();
        assert_eq!((members[0].name.as_str(), members[0].greetings), ("worker-a", 3));
        assert!(members[0].is_there() && members[0].beat.is_none());
        (0..MOST_MEMBERS).for_each(|i| roster.enter(&format!("worker-{i:05}"), None));
        let members = roster.members();
        // The one that was silent longest has gone.
        assert_eq!(members.len(), MOST_MEMBERS);
        assert!(members.iter().all(|m| m.name != "worker-a"));
    }
}
