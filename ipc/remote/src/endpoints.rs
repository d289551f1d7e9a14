//! Where a host listens and connects, and the zenoh session for it.

use serde_json::{Value, json};
use zenoh::{Config, Session, Wait};

use crate::RemoteError;
use crate::lane::Lane;

/// Where a host listens and where it connects, as `tcp/ADDRESS:PORT`. Each endpoint stands for two ports: the port
/// itself for small samples and beats, and the next one for bulk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Endpoints {
    /// Endpoints at which others reach this host.
    pub listen: Vec<String>,
    /// Endpoints of others.
    pub connect: Vec<String>,
    /// Endpoints of a router, through which all others are reached, in place of the other two. A host cannot be opened
    /// before its router; afterwards the router may go and come again.
    pub router: Vec<String>,
}

/// How a session takes part in the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// It is connected to the others directly.
    Peer,
    /// It reaches the others through a router.
    Client,
    /// It passes on what its clients send.
    Router,
}

impl Mode {
    fn name(self) -> &'static str {
        match self {
            Self::Peer => "peer",
            Self::Client => "client",
            Self::Router => "router",
        }
    }
}

/// How long the router is waited for, ms.
const ROUTER_PATIENCE_MS: i64 = 1_000;

impl Endpoints {
    /// Checks every endpoint.
    ///
    /// # Errors
    /// An endpoint is not written as one.
    pub fn check(&self) -> Result<(), RemoteError> {
        if let (Some(endpoint), true) =
            (self.router.first(), !self.listen.is_empty() || !self.connect.is_empty())
        {
            return Err(RemoteError::RouterAndMore(endpoint.clone()));
        }
        let all = self.listen.iter().chain(&self.connect).chain(&self.router);
        all.clone().try_for_each(|e| port_of(e, Lane::Bulk).map(|_| ()))
    }

    /// How a host with these endpoints takes part. zenoh's routers pass nothing on between its peers, only to its clients.
    pub(crate) fn mode(&self) -> Mode {
        if self.router.is_empty() { Mode::Peer } else { Mode::Client }
    }

    /// The zenoh configuration of one of the two sessions.
    fn config(&self, mode: Mode, which: Lane) -> Result<Config, RemoteError> {
        let of = |list: &[String]| list.iter().map(|e| port_of(e, which)).collect::<Result<Vec<_>, _>>();
        let config = json!({
            "mode": mode.name(),
            "listen": { "endpoints": of(&self.listen)? },
            "connect": {
                "endpoints": of(if mode == Mode::Client { &self.router } else { &self.connect })?,
                // Only a client waits for the other end, as zenoh cannot open it otherwise.
                "timeout_ms": if mode == Mode::Client { ROUTER_PATIENCE_MS } else { -1 },
                "exit_on_failure": mode == Mode::Client,
                "retry": { "period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2 },
            },
            "scouting": { "delay": 0, "multicast": { "enabled": false }, "gossip": { "enabled": false } },
            "transport": { "link": { "protocols": ["tcp"] } },
        });
        self.parsed(&config)
    }

    fn parsed(&self, config: &Value) -> Result<Config, RemoteError> {
        Config::from_json5(&config.to_string()).map_err(|e| self.refused(&e.to_string()))
    }

    /// Opens one of the two sessions.
    pub(crate) fn open(&self, mode: Mode, which: Lane) -> Result<Session, RemoteError> {
        let config = self.config(mode, which)?;
        zenoh::open(config).wait().map_err(|e| self.refused(&e.to_string()))
    }

    fn refused(&self, reason: &str) -> RemoteError {
        let place =
            format!("listens at [{}], connects to [{}]", self.listen.join(", "), self.connect.join(", "));
        RemoteError::Session { place, reason: reason.to_owned() }
    }
}

/// The endpoint of one of the two sessions.
fn port_of(endpoint: &str, which: Lane) -> Result<String, RemoteError> {
    let wrong = || RemoteError::Endpoint(endpoint.to_owned());
    let address = endpoint.strip_prefix("tcp/").ok_or_else(wrong)?;
    let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
    let port: u16 = port.parse().map_err(|_| wrong())?;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
    if host.is_empty() || port == 0 || port == u16::MAX || !host.chars().all(is_plain) {
        return Err(wrong());
    }
    let port = port + u16::from(which == Lane::Bulk);
    Ok(format!("tcp/{host}:{port}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_stands_for_two_ports() {
        assert_eq!(port_of("tcp/10.0.0.7:7447", Lane::Small).as_deref(), Ok("tcp/10.0.0.7:7447"));
        assert_eq!(port_of("tcp/[::1]:7447", Lane::Bulk).as_deref(), Ok("tcp/[::1]:7448"));
        for wrong in
            ["", "tcp/", "tcp/a", "udp/a:1", "tcp/:7", "tcp/a:0", "tcp/a:65535", "tcp/a:7#x", "tcp/a b:7"]
        {
            assert_eq!(port_of(wrong, Lane::Small), Err(RemoteError::Endpoint(wrong.to_owned())));
        }
    }
}
