//! Messages between named programs, through a router: what the planning pool speaks with.
//!
//! A message for `TO` from `FROM` is a publication at `PREFIX/pool/1/TO/FROM`; one for all at `PREFIX/pool/1/all/FROM`. Short
//! messages and long ones have a connection each. A message may be lost; whoever needs it asks again.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::lane::Lane;
use crate::{Endpoints, RemoteError, Tls};

/// The name that stands for all.
const ALL: &str = "all";
/// The longest message that is taken, bytes.
const LONGEST: usize = 8 << 20;
/// Bytes that wait to be taken, at most; the oldest message goes first.
const MOST_WAITING: usize = 64 << 20;
/// The longest name, bytes.
const LONGEST_NAME: usize = 64;

/// One program's place in the exchange.
pub struct Mailbox {
    prefix: String,
    name: String,
    small: Session,
    bulk: Session,
    inbox: Arc<Inbox>,
    _subscribers: Vec<Subscriber<()>>,
}

#[derive(Default)]
struct Inbox {
    waiting: Mutex<Waiting>,
    signal: Condvar,
}

#[derive(Default)]
struct Waiting {
    messages: VecDeque<(String, Vec<u8>)>,
    bytes: usize,
    lost: u64,
}

impl Inbox {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn offer(&self, from: String, bytes: Vec<u8>) {
        let mut waiting = self.waiting();
        waiting.bytes += bytes.len();
        waiting.messages.push_back((from, bytes));
        while waiting.bytes > MOST_WAITING {
            let Some((_, oldest)) = waiting.messages.pop_front() else { break };
            waiting.bytes -= oldest.len();
            waiting.lost += 1;
        }
        drop(waiting);
        self.signal.notify_one();
    }
}

impl Mailbox {
    /// Opens it under a name of letters, digits, `_`, `-` and `.`, through the router at this endpoint. It waits a second
    /// for the router, which may go and come again afterwards.
    ///
    /// # Errors
    /// The name or the endpoint is wrong, or the router is not there or refuses the certificate.
    pub fn open(prefix: &str, name: &str, router: &str, tls: Option<Arc<Tls>>) -> Result<Self, RemoteError> {
        if !is_name(name) || !is_name(prefix) || name == ALL {
            return Err(RemoteError::Name(name.to_owned()));
        }
        let endpoints = Endpoints { router: vec![router.to_owned()], tls, ..Endpoints::default() };
        endpoints.check()?;
        let open = |lane| endpoints.open(endpoints.mode(), lane, prefix);
        let (small, bulk) = (open(Lane::Small)?, open(Lane::Bulk)?);
        let inbox = Arc::new(Inbox::default());
        let mut subscribers = Vec::new();
        for session in [&small, &bulk] {
            for to in [ALL, name] {
                subscribers.push(subscribe(session, &format!("{prefix}/pool/1/{to}/*"), name, &inbox)?);
            }
        }
        let (prefix, name) = (prefix.to_owned(), name.to_owned());
        Ok(Self { prefix, name, small, bulk, inbox, _subscribers: subscribers })
    }

    /// Sends a message to the program of this name, or to all. It may be lost, and nobody tells.
    pub fn send(&self, to: Option<&str>, bytes: Vec<u8>) {
        let to = to.unwrap_or(ALL);
        if !is_name(to) {
            return;
        }
        let lane = Lane::of(bytes.len());
        let (session, priority) = match lane {
            Lane::Small => (&self.small, Priority::InteractiveHigh),
            Lane::Bulk => (&self.bulk, Priority::Data),
        };
        let key = format!("{}/pool/1/{to}/{}", self.prefix, self.name);
        let put = session.put(key, bytes).congestion_control(CongestionControl::Drop);
        // A message that is not sent is one that is lost.
        let _ = put.priority(priority).express(lane == Lane::Small).wait();
    }

    /// The next message and who sent it, waiting for one.
    pub fn receive(&self, wait: Duration) -> Option<(String, Vec<u8>)> {
        let until = Instant::now() + wait;
        let mut waiting = self.inbox.waiting();
        loop {
            if let Some((from, bytes)) = waiting.messages.pop_front() {
                waiting.bytes -= bytes.len();
                return Some((from, bytes));
            }
            let rest = until.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return None;
            }
            waiting = self.inbox.signal.wait_timeout(waiting, rest).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Mailbox {
    /// Messages that arrived and were pushed out before they were taken.
    pub fn lost(&self) -> u64 {
        self.inbox.waiting().lost
    }
}

impl Drop for Mailbox {
    fn drop(&mut self) {
        let _ = self.small.close().wait();
        let _ = self.bulk.close().wait();
    }
}

fn subscribe(
    session: &Session,
    key: &str,
    own: &str,
    inbox: &Arc<Inbox>,
) -> Result<Subscriber<()>, RemoteError> {
    let refused = |e: zenoh::Error| RemoteError::Declare { key: key.to_owned(), reason: e.to_string() };
    let expr: KeyExpr<'static> = KeyExpr::try_from(key.to_owned()).map_err(refused)?;
    let (inbox, own) = (inbox.clone(), own.to_owned());
    let take = move |sample: zenoh::sample::Sample| {
        let from = sample.key_expr().as_str().rsplit('/').next().unwrap_or_default();
        if from != own && is_name(from) && sample.payload().len() <= LONGEST {
            inbox.offer(from.to_owned(), sample.payload().to_bytes().into_owned());
        }
    };
    session.declare_subscriber(expr).callback(take).wait().map_err(refused)
}

/// Whether a text is a name: one chunk of a key.
fn is_name(text: &str) -> bool {
    (1..=LONGEST_NAME).contains(&text.len())
        && text.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-' | b'.'))
}
