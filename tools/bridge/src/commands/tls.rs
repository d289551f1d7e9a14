//! The certificate of a subcommand.

use std::sync::Arc;

use stillpoint_arguments::TlsArgs;
use stillpoint_remote::{Role, Tls, TlsFiles};

use crate::error::BridgeError;

/// The certificate, read and checked; none if none is given.
pub fn load(arguments: &TlsArgs) -> Result<Option<Arc<Tls>>, BridgeError> {
    let TlsArgs { certificate: Some(certificate), key: Some(key), authority: Some(authority) } =
        arguments.clone()
    else {
        return Ok(None);
    };
    let tls = Tls::load(&TlsFiles { certificate, key, authority })?;
    Ok(Some(Arc::new(tls)))
}

/// What a program does in the planning pool.
pub enum Use {
    /// It asks for calls.
    Ask,
    /// It computes them.
    Compute,
    /// It lists workers.
    List,
}

/// Refuses a certificate whose role others would not let do this: their access lists discard without a message.
pub fn allow(tls: Option<&Tls>, what: &Use) -> Result<(), BridgeError> {
    let Some(role) = tls.map(Tls::role) else { return Ok(()) };
    let (roles, what): (&[Role], &'static str) = match what {
        Use::Ask => (&[Role::Bedside, Role::Cluster, Role::Router], "ask the planning pool"),
        Use::Compute => (&[Role::Worker, Role::Router], "compute calls of the planning pool"),
        Use::List => (&[Role::Bedside, Role::Cluster, Role::Viewer, Role::Router], "list workers"),
    };
    if roles.contains(&role) {
        return Ok(());
    }
    let names: Vec<String> = roles.iter().map(|role| format!("`{}`", role.name())).collect();
    Err(BridgeError::Role { role: role.name(), what, roles: names.join(", ") })
}
