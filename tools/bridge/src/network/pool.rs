//! The edge between an operator of a run and a planning pool: messages as samples on one side, the exchange of messages
//! on the other.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use stillpoint_pipeline::graph::{HostTls, PoolNode};
use stillpoint_pipeline::live::bridge::{NetworkEvent, SentCounts, TakenCounts};
use stillpoint_pool::{Message, To, topic};
use stillpoint_remote::{Mailbox, Tls, TlsFiles};
use stillpoint_samples::{Header, LONGEST_POOL_MESSAGE, Pieces};
use stillpoint_transport::{
    Carries, Channel, LinkState, Origin, Receiver, Sender, Transport, TransportError,
};
use zerocopy::IntoBytes;

use crate::commands::exchange::PREFIX;
use crate::commands::tls::{Use, allow};
use crate::error::BridgeError;

/// Messages that wait to be handed over; one more costs the oldest.
const MOST_WAITING: usize = 256;
/// Time between two greetings of a worker that are handed over: a session keeps each of them.
const GREETING: Duration = Duration::from_millis(500);
/// Time between two attempts to reach the router.
const RETRY: Duration = Duration::from_millis(200);
/// How often the end of the run is looked for.
const LOOK: Duration = Duration::from_millis(200);

/// The two ends of the edge, and the thread that takes what arrives.
pub struct PoolEdge(Arc<Shared>);

struct Shared {
    mailbox: OnceLock<Mailbox>,
    state: Mutex<State>,
    ended: AtomicBool,
    arrived: Arc<dyn Fn() + Send + Sync>,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Vec<u8>>,
    sent: SentCounts,
    taken: TakenCounts,
    number: u64,
    greeted: BTreeMap<String, (u64, Instant)>,
    events: Vec<NetworkEvent>,
}

impl PoolEdge {
    /// To this pool. The router may come later.
    ///
    /// # Errors
    /// The certificate cannot be used.
    pub fn open(pool: &PoolNode, arrived: Arc<dyn Fn() + Send + Sync>) -> Result<Self, BridgeError> {
        let tls = pool.tls.clone().map(|HostTls { certificate, key, authority }| {
            Tls::load(&TlsFiles { certificate, key, authority }).map(Arc::new)
        });
        let tls = tls.transpose()?;
        allow(tls.as_deref(), &Use::Ask)?;
        let born = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos();
        let name = format!("plan-{}-{born:x}", std::process::id());
        let shared = Arc::new(Shared {
            mailbox: OnceLock::new(),
            state: Mutex::default(),
            ended: AtomicBool::new(false),
            arrived,
        });
        let (of_thread, endpoint) = (shared.clone(), pool.connect.clone());
        std::thread::Builder::new()
            .name("pool".to_owned())
            .spawn(move || of_thread.carry(&name, &endpoint, tls.as_ref()))?;
        Ok(Self(shared))
    }

    /// Both ends, for those who open them.
    pub fn transport(&self) -> Box<dyn Transport> {
        Box::new(Ends(self.0.clone()))
    }

    /// What happened since the last call.
    pub fn take_events(&self) -> Vec<NetworkEvent> {
        std::mem::take(&mut self.0.state().events)
    }

    /// Messages to workers. Those that the network has taken count as received: it tells nothing of their fate, and what
    /// is lost is asked for again.
    pub fn sent(&self) -> SentCounts {
        self.0.state().sent
    }

    /// Messages of workers.
    pub fn taken(&self) -> TakenCounts {
        self.0.state().taken
    }
}

impl Drop for PoolEdge {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Opens the place in the exchange and hands on what arrives, until the run ends.
    fn carry(&self, name: &str, endpoint: &str, tls: Option<&Arc<Tls>>) {
        let mut reported = None;
        while !self.ended.load(Ordering::Relaxed) {
            if let Some(mailbox) = self.mailbox.get() {
                if let Some((from, bytes)) = mailbox.receive(LOOK) {
                    self.take(&from, &bytes);
                }
                continue;
            }
            match Mailbox::open(PREFIX, name, endpoint, tls.cloned()) {
                Ok(mailbox) => {
                    drop(self.mailbox.set(mailbox));
                    self.report(format!("the planning pool at {endpoint} can be reached"), false);
                }
                Err(e) => {
                    let reason = format!("the planning pool at {endpoint} cannot be reached: {e}");
                    if reported.as_ref() != Some(&reason) {
                        self.report(reason.clone(), true);
                    }
                    reported = Some(reason);
                    std::thread::sleep(RETRY);
                }
            }
        }
    }

    fn report(&self, text: String, is_fault: bool) {
        self.state().events.push(NetworkEvent { text, is_fault });
    }

    fn take(&self, from: &str, bytes: &[u8]) {
        let mut state = self.state();
        let message = Message::from_bytes(bytes).ok();
        let Some(message) = message.filter(|_| bytes.len() + from.len() < LONGEST_POOL_MESSAGE) else {
            state.taken.refused += 1;
            return;
        };
        if let Message::Hello(hello) = &message {
            let now = Instant::now();
            let known = state.greeted.insert(from.to_owned(), (hello.incarnation, now));
            if let Some((incarnation, at)) = known
                && incarnation == hello.incarnation
                && now.duration_since(at) < GREETING
            {
                state.greeted.insert(from.to_owned(), (incarnation, at));
                return;
            }
            state.greeted.retain(|_, (_, at)| now.duration_since(*at) < 20 * GREETING);
        }
        let (body, elements) = topic::sample(&To::one(from), &message);
        let header = Header { sequence: state.number, count: elements.len() as u32, ..Header::default() };
        state.number += 1;
        state.waiting.push_back([header.as_bytes(), body.as_bytes(), &elements].concat());
        if state.waiting.len() > MOST_WAITING {
            state.waiting.pop_front();
            state.taken.lost += 1;
        }
        drop(state);
        (self.arrived)();
    }
}

/// Opens the ends.
struct Ends(Arc<Shared>);

impl Transport for Ends {
    fn carries(&self) -> Carries {
        Carries::Samples
    }

    fn open_sender(&self, _: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        Ok(Box::new(End(self.0.clone())))
    }

    fn open_receiver(&self, _: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        Ok(Box::new(End(self.0.clone())))
    }
}

/// One end of the edge.
struct End(Arc<Shared>);

impl End {
    fn link_state(&self) -> LinkState {
        if self.0.mailbox.get().is_some() { LinkState::Open } else { LinkState::Waiting }
    }
}

impl Sender for End {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let mut state = self.0.state();
        state.sent.offered += 1;
        let Some((to, message)) = topic::split(sample.payload) else {
            state.sent.put += 1;
            state.sent.refused += 1;
            return Ok(());
        };
        let Some(mailbox) = self.0.mailbox.get() else {
            state.sent.unheard += 1;
            return Ok(());
        };
        state.sent.put += 1;
        state.sent.received += 1;
        drop(state);
        mailbox.send(Some(to).filter(|to| !to.is_empty()), message.to_vec());
        Ok(())
    }

    fn state(&self) -> LinkState {
        self.link_state()
    }

    fn close(&mut self) {}
}

impl Receiver for End {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let mut state = self.0.state();
        let Some(message) = state.waiting.pop_front() else { return Ok(None) };
        state.taken.received += 1;
        *bytes = message;
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        0
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        self.link_state()
    }

    fn close(&mut self) {}
}
