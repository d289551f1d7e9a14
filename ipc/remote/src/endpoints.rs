//! Where a host listens and connects, and the zenoh session for it.

use std::sync::Arc;

use serde_json::{Value, json};
use zenoh::{Config, Session, Wait};

use crate::lane::Lane;
use crate::probe::{Answer, probe};
use crate::{RemoteError, Tls, access, names};

/// Where a host listens and where it connects, as `tcp/ADDRESS:PORT`, or as `tls/ADDRESS:PORT` with a certificate. Each endpoint stands for two ports: the port
/// itself for small samples and beats, and the next one for bulk.
#[derive(Clone, Debug, Default)]
pub struct Endpoints {
    /// Endpoints at which others reach this host.
    pub listen: Vec<String>,
    /// Endpoints of others.
    pub connect: Vec<String>,
    /// Endpoints of a router, through which all others are reached, in place of the other two. A host cannot be opened
    /// before its router; afterwards the router may go and come again.
    pub router: Vec<String>,
    /// The certificate of the host. With one, all endpoints are `tls/...`, and without one none is.
    pub tls: Option<Arc<Tls>>,
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
        for endpoint in all {
            let (scheme, _) = parts(endpoint, Lane::Bulk)?;
            match (scheme, self.tls.is_some()) {
                (Scheme::Tls, false) => return Err(RemoteError::NoCertificate(endpoint.clone())),
                (Scheme::Tcp, true) => return Err(RemoteError::NotEncrypted(endpoint.clone())),
                _ => {}
            }
        }
        Ok(())
    }

    /// What the ends to which this host connects do with it: the first that refuses it.
    pub(crate) fn refusal(&self) -> Option<String> {
        let ends = self.connect.iter().chain(&self.router);
        let mut answers = ends.filter_map(|e| {
            let (_, address) = parts(e, Lane::Small).ok()?;
            Some(probe(&address, self.tls.as_deref()))
        });
        answers.find_map(|answer| match answer {
            Answer::Refused(reason) => Some(reason),
            Answer::Taken | Answer::Absent(_) => None,
        })
    }

    /// How a host with these endpoints takes part. zenoh's routers pass nothing on between its peers, only to its clients.
    pub(crate) fn mode(&self) -> Mode {
        if self.router.is_empty() { Mode::Peer } else { Mode::Client }
    }

    /// The zenoh configuration of one of the two sessions.
    fn config(&self, mode: Mode, which: Lane, prefix: &str) -> Result<Config, RemoteError> {
        let of = |list: &[String]| list.iter().map(|e| port_of(e, which)).collect::<Result<Vec<_>, _>>();
        let mut config = json!({
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
        if let Some(tls) = &self.tls {
            let files = tls.files();
            config["transport"]["link"] = json!({
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate": files.authority,
                    "listen_certificate": files.certificate,
                    "listen_private_key": files.key,
                    "connect_certificate": files.certificate,
                    "connect_private_key": files.key,
                    "enable_mtls": true,
                    "verify_name_on_connect": true,
                    "close_link_on_expiration": true,
                },
            });
            config["access_control"] = access::control(&names::chunk(prefix));
        }
        self.parsed(&config)
    }

    fn parsed(&self, config: &Value) -> Result<Config, RemoteError> {
        Config::from_json5(&config.to_string()).map_err(|e| self.refused(&e.to_string()))
    }

    /// Opens one of the two sessions.
    pub(crate) fn open(&self, mode: Mode, which: Lane, prefix: &str) -> Result<Session, RemoteError> {
        let config = self.config(mode, which, prefix)?;
        zenoh::open(config).wait().map_err(|e| match self.refusal() {
            Some(reason) => RemoteError::Refused(reason),
            None => self.refused(&e.to_string()),
        })
    }

    fn refused(&self, reason: &str) -> RemoteError {
        let place = format!("listens at [{}], connects to [{}]", self.listen.join(", "), {
            let ends: Vec<&str> = self.connect.iter().chain(&self.router).map(String::as_str).collect();
            ends.join(", ")
        });
        // zenoh names the line of its source, which says nothing to those who read this.
        let reason = reason.split(" at /").next().unwrap_or(reason).trim_end_matches(['.', '!']);
        let check = match self.listen.is_empty() {
            true => "a program of stillpoint listens there and that no firewall is between",
            false => "the ports are free and that the address is one of this machine",
        };
        RemoteError::Session { place, reason: reason.to_owned(), check }
    }
}

/// Checks an endpoint of another program, which takes no certificate.
///
/// # Errors
/// It is not written as one.
pub(crate) fn check_plain(endpoint: &str) -> Result<(), RemoteError> {
    match parts(endpoint, Lane::Small)? {
        (Scheme::Tcp, _) => Ok(()),
        (Scheme::Tls, _) => Err(RemoteError::NoCertificate(endpoint.to_owned())),
    }
}

/// What an endpoint speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scheme {
    Tcp,
    Tls,
}

/// The parts of the endpoint of one of the two sessions: what it speaks, and `ADDRESS:PORT`.
fn parts(endpoint: &str, which: Lane) -> Result<(Scheme, String), RemoteError> {
    let wrong = || RemoteError::Endpoint(endpoint.to_owned());
    let (scheme, address) = endpoint.split_once('/').ok_or_else(wrong)?;
    let scheme = match scheme {
        "tcp" => Scheme::Tcp,
        "tls" => Scheme::Tls,
        _ => return Err(wrong()),
    };
    let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
    let port: u16 = port.parse().map_err(|_| wrong())?;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
    if host.is_empty() || port == 0 || port == u16::MAX || !host.chars().all(is_plain) {
        return Err(wrong());
    }
    let port = port + u16::from(which == Lane::Bulk);
    Ok((scheme, format!("{host}:{port}")))
}

/// The endpoint of one of the two sessions.
fn port_of(endpoint: &str, which: Lane) -> Result<String, RemoteError> {
    let (scheme, address) = parts(endpoint, which)?;
    let scheme = if scheme == Scheme::Tls { "tls" } else { "tcp" };
    Ok(format!("{scheme}/{address}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_stands_for_two_ports() {
        assert_eq!(port_of("tcp/10.0.0.7:7447", Lane::Small).as_deref(), Ok("tcp/10.0.0.7:7447"));
        assert_eq!(port_of("tls/a:7447", Lane::Bulk).as_deref(), Ok("tls/a:7448"));
        assert_eq!(port_of("tcp/[::1]:7447", Lane::Bulk).as_deref(), Ok("tcp/[::1]:7448"));
        for wrong in
            ["", "tcp/", "tcp/a", "udp/a:1", "tcp/:7", "tcp/a:0", "tcp/a:65535", "tcp/a:7#x", "tcp/a b:7"]
        {
            assert_eq!(port_of(wrong, Lane::Small), Err(RemoteError::Endpoint(wrong.to_owned())));
        }
    }

    #[test]
    fn an_encrypted_endpoint_needs_a_certificate() {
        let endpoint = "tls/10.0.0.7:7447".to_owned();
        let endpoints = Endpoints { connect: vec![endpoint.clone()], ..Endpoints::default() };
        assert_eq!(endpoints.check(), Err(RemoteError::NoCertificate(endpoint)));
    }
}
