//! Publishers and subscribers of a session.

use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::RemoteError;

fn declare<T>(key: &str, made: zenoh::Result<T>) -> Result<T, RemoteError> {
    made.map_err(|e| RemoteError::Declare { key: key.to_owned(), reason: e.to_string() })
}

/// A publisher that never waits for a slow peer.
pub fn publisher(
    session: &Session,
    key: String,
    priority: Priority,
) -> Result<Publisher<'static>, RemoteError> {
    let expr = declare(&key, KeyExpr::try_from(key.clone()))?;
    let builder = session
        .declare_publisher(expr)
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(priority == Priority::InteractiveHigh);
    declare(&key, builder.wait())
}

/// A subscriber whose callback runs on a thread of zenoh.
pub fn subscriber(
    session: &Session,
    key: &str,
    take: impl Fn(zenoh::sample::Sample) + Send + Sync + 'static,
) -> Result<Subscriber<()>, RemoteError> {
    let expr: KeyExpr<'static> = declare(key, KeyExpr::try_from(key.to_owned()))?;
    declare(key, session.declare_subscriber(expr).callback(take).wait())
}
