//! The thread of a node: it opens the session, declares what is there, and puts.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::json;
use stillpoint_ros2::{
    Attachment, EndKind, NodePlace, Qos, any_type, end_token, gid, key, node_token, tokens, type_of_key,
};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::Priority;
use zenoh::sample::SampleKind;
use zenoh::{Config, Session, Wait};

use super::outbox::Outbox;
use super::{Ros2Message, Ros2Settings, Shared, Taking, TypedTopic};
use crate::declare::{publisher, subscriber};
use crate::shared::lock;
use crate::{RemoteError, endpoints};

/// How long the router is waited for at each try, ms.
const PATIENCE_MS: u64 = 500;
/// Between two tries, two looks at the router, and two puts of a message that is repeated.
const EACH: Duration = Duration::from_secs(1);
/// How long others have to show what they publish before it is told that nobody does.
const SHOWING: Duration = Duration::from_secs(3);
/// The longest message that the session takes from the network, whatever is asked for, bytes.
const LONGEST: usize = 64 << 20;

/// The configuration of the session.
pub fn config(settings: &Ros2Settings) -> Result<Config, RemoteError> {
    endpoints::check_plain(&settings.connect)?;
    let config = json!({
        "mode": "client",
        "connect": {
            "endpoints": [settings.connect],
            "timeout_ms": PATIENCE_MS,
            "exit_on_failure": true,
            "retry": { "period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2 },
        },
        "scouting": { "delay": 0, "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": { "link": {
            "protocols": ["tcp"],
            "rx": { "max_message_size": LONGEST.max(2 * settings.longest) },
        } },
    });
    Config::from_json5(&config.to_string()).map_err(|e| refused(settings, &e.to_string()))
}

fn refused(settings: &Ros2Settings, reason: &str) -> RemoteError {
    // zenoh names the line of its source, which says nothing to those who read this.
    let reason = reason.split(" at /").next().unwrap_or(reason).trim_end_matches(['.', '!']);
    RemoteError::Session {
        place: format!("connects to ROS 2 at {}", settings.connect),
        reason: reason.to_owned(),
        check: "the router of ROS 2 runs there and that no firewall is between",
    }
}

/// The body of the thread.
pub fn run(shared: &Arc<Shared>) {
    while !shared.is_closed.load(Ordering::Relaxed) {
        let opened = config(&shared.settings)
            .and_then(|c| zenoh::open(c).wait().map_err(|e| refused(&shared.settings, &e.to_string())));
        match opened {
            Ok(session) => {
                let ended = Node::new(shared, session).and_then(|node| node.serve());
                if let Err(error) = ended {
                    lock(&shared.graph).note(format!("ROS 2: {error}"), true);
                }
            }
            Err(_) => {
                let text = format!(
                    "ROS 2: no router is at {}, which is tried again each second: start `ros2 run rmw_zenoh_cpp rmw_zenohd`",
                    shared.settings.connect
                );
                lock(&shared.graph).note(text, true);
            }
        }
        wait(shared, EACH);
    }
}

/// Waits until there is news, at most so long.
fn wait(shared: &Shared, most: Duration) {
    let news = lock(&shared.news);
    let is_idle = |news: &mut bool| !*news && !shared.is_closed.load(Ordering::Relaxed);
    if let Ok((mut news, _)) = shared.signal.wait_timeout_while(news, most, is_idle) {
        *news = false;
    }
}

/// A topic that is published.
struct Gives {
    outbox: Arc<Outbox>,
    publisher: Publisher<'static>,
    gid: [u8; 16],
    /// Number of the last message.
    sequence: u64,
    _token: LivelinessToken,
}

impl Gives {
    fn put(&mut self, message: &[u8]) {
        self.sequence += 1;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let time = u64::try_from(now.as_nanos()).unwrap_or(u64::MAX);
        let attachment = Attachment { sequence: self.sequence, time, gid: self.gid };
        // A session that is closed takes nothing.
        let _ = self.publisher.put(message).attachment(&attachment.to_bytes()[..]).wait();
    }

    fn has_listener(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }
}

/// The node in an open session.
struct Node<'s> {
    shared: &'s Arc<Shared>,
    place: NodePlace,
    gives: Vec<Gives>,
    takes: Vec<(Arc<Taking>, Subscriber<()>, LivelinessToken)>,
    repeats: Vec<(Gives, Vec<u8>)>,
    /// Number of the last end.
    ends: u32,
    _node: LivelinessToken,
    _tokens: Subscriber<()>,
    // Closed after what it declares.
    session: Session,
}

impl<'s> Node<'s> {
    fn new(shared: &'s Arc<Shared>, session: Session) -> Result<Self, RemoteError> {
        let Ros2Settings { connect, domain, node, .. } = &shared.settings;
        let place = NodePlace { domain: *domain, session: session.zid().to_string(), name: node.clone() };
        let text = format!("ROS 2: the node /{node} is connected to {connect}, domain {domain}");
        lock(&shared.graph).note(text, false);
        shared.is_connected.store(true, Ordering::Relaxed);
        let others = {
            let (shared, own) = (shared.clone(), place.session.clone());
            move |sample: zenoh::sample::Sample| {
                let key = sample.key_expr().as_str();
                if key.split('/').nth(2) != Some(&own) {
                    lock(&shared.graph).token(key, sample.kind() == SampleKind::Put);
                }
            }
        };
        let of_domain = tokens(*domain);
        let subscriber =
            session.liveliness().declare_subscriber(of_domain.clone()).history(true).callback(others).wait();
        let tokens =
            subscriber.map_err(|e| RemoteError::Declare { key: of_domain, reason: e.to_string() })?;
        Ok(Self {
            _node: token(&session, node_token(&place))?,
            _tokens: tokens,
            shared,
            place,
            gives: Vec::new(),
            takes: Vec::new(),
            repeats: Vec::new(),
            ends: 0,
            session,
        })
    }

    /// Puts what waits until the node is closed.
    fn serve(mut self) -> Result<(), RemoteError> {
        let opened = Instant::now();
        let (mut looked, mut has_shown) = (Instant::now(), false);
        while !self.shared.is_closed.load(Ordering::Relaxed) {
            self.declare()?;
            let mut worked = false;
            for gives in &mut self.gives {
                gives.outbox.set_has_listener(gives.has_listener());
                if let Some(message) = gives.outbox.next() {
                    gives.put(&message);
                    worked = true;
                }
            }
            if looked.elapsed() >= EACH {
                looked = Instant::now();
                self.look();
                self.repeats.iter_mut().for_each(|(gives, message)| gives.put(message));
            }
            if !has_shown && opened.elapsed() >= SHOWING {
                has_shown = true;
                lock(&self.shared.graph).report_missing(self.place.domain);
            }
            if !worked {
                wait(self.shared, EACH / 10);
            }
        }
        Ok(())
    }

    /// Tells whether the router went or came back: the session connects again by itself.
    fn look(&self) {
        let is_here = self.session.info().routers_zid().wait().next().is_some();
        if self.shared.is_connected.swap(is_here, Ordering::Relaxed) != is_here {
            let connect = &self.shared.settings.connect;
            let text = match is_here {
                true => format!("ROS 2: the router at {connect} is back"),
                false => format!("ROS 2: the router at {connect} is gone"),
            };
            lock(&self.shared.graph).note(text, !is_here);
        }
    }

    /// Declares the topics that came since the last call.
    fn declare(&mut self) -> Result<(), RemoteError> {
        let outboxes: Vec<Arc<Outbox>> =
            lock(&self.shared.outboxes).iter().skip(self.gives.len()).map(|(_, o)| o.clone()).collect();
        for outbox in outboxes {
            let gives = self.give(outbox, Qos::USUAL)?;
            self.gives.push(gives);
        }
        let repeated: Vec<(Arc<Outbox>, Vec<u8>)> =
            lock(&self.shared.repeated).iter().skip(self.repeats.len()).cloned().collect();
        for (outbox, message) in repeated {
            let mut gives = self.give(outbox, Qos::LATCHED)?;
            gives.put(&message);
            self.repeats.push((gives, message));
        }
        let takings: Vec<Arc<Taking>> =
            lock(&self.shared.takings).iter().skip(self.takes.len()).cloned().collect();
        for taking in takings {
            let (taken, shared) = (taking.clone(), self.shared.clone());
            let is_reported = AtomicBool::new(false);
            let take = move |sample: zenoh::sample::Sample| {
                let key = sample.key_expr().as_str();
                let is_of_type = taken.topic.is_of(key);
                if !is_of_type && !is_reported.swap(true, Ordering::Relaxed) {
                    lock(&shared.graph).note(other_type(&taken.topic, key), true);
                }
                let attachment = sample.attachment().map(|a| a.to_bytes());
                (taken.take)(&Ros2Message {
                    is_of_type,
                    attachment: attachment.as_deref().unwrap_or_default(),
                    payload: sample.payload(),
                });
            };
            let subscriber =
                subscriber(&self.session, &any_type(self.place.domain, &taking.topic.name), take)?;
            let token = self.end(EndKind::Subscription, &taking.topic, Qos::SENSOR);
            self.takes.push((taking, subscriber, crate::ros2::session::token(&self.session, token)?));
        }
        Ok(())
    }

    fn give(&mut self, outbox: Arc<Outbox>, qos: Qos) -> Result<Gives, RemoteError> {
        let topic = &outbox.topic;
        let key = key(self.place.domain, &topic.name, &topic.type_name, &topic.hash);
        let publisher = publisher(&self.session, key, Priority::Data)?;
        let of = self.end(EndKind::Publisher, topic, qos);
        let gid = gid(&of);
        Ok(Gives { publisher, gid, sequence: 0, _token: token(&self.session, of)?, outbox })
    }

    /// The token of the next end.
    fn end(&mut self, kind: EndKind, topic: &TypedTopic, qos: Qos) -> String {
        self.ends += 1;
        end_token(&self.place, self.ends, kind, &topic.name, (&topic.type_name, &topic.hash), qos)
    }
}

impl Drop for Node<'_> {
    fn drop(&mut self) {
        self.shared.is_connected.store(false, Ordering::Relaxed);
        self.gives.iter().for_each(|gives| gives.outbox.set_has_listener(false));
        let _ = self.session.close().wait();
    }
}

/// What is told of the first message of another type.
fn other_type(topic: &TypedTopic, key: &str) -> String {
    let TypedTopic { name, type_name, .. } = topic;
    let name = name.as_str();
    match type_of_key(key) {
        Some((found, _)) if found == *type_name => {
            format!("ROS 2: messages on {name} are {type_name} of another layout, and are not taken")
        }
        Some((found, _)) => format!("ROS 2: messages on {name} are {found}, and {type_name} is taken"),
        None => format!("ROS 2: messages on {name} have no type"),
    }
}

fn token(session: &Session, key: String) -> Result<LivelinessToken, RemoteError> {
    let made = session.liveliness().declare_token(key.clone()).wait();
    made.map_err(|e| RemoteError::Declare { key, reason: e.to_string() })
}
