//! The certificate of a subcommand.

use std::sync::Arc;

use stillpoint_arguments::TlsArgs;
use stillpoint_remote::{Role, Tls, TlsFiles};

/// The certificate, read and checked; none if none is given.
pub fn load(arguments: &TlsArgs) -> Result<Option<Arc<Tls>>, String> {
    let TlsArgs { certificate: Some(certificate), key: Some(key), authority: Some(authority) } =
        arguments.clone()
    else {
        return Ok(None);
    };
    let tls = Tls::load(&TlsFiles { certificate, key, authority }).map_err(|e| e.to_string())?;
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
pub fn allow(tls: Option<&Tls>, what: &Use) -> Result<(), String> {
    let Some(role) = tls.map(Tls::role) else { return Ok(()) };
    let (roles, text): (&[Role], &str) = match what {
        Use::Ask => (&[Role::Bedside, Role::Cluster, Role::Router], "ask the planning pool"),
        Use::Compute => (&[Role::Worker, Role::Router], "compute calls of the planning pool"),
        Use::List => (&[Role::Bedside, Role::Cluster, Role::Viewer, Role::Router], "list workers"),
    };
    if roles.contains(&role) {
        return Ok(());
    }
    let names: Vec<String> = roles.iter().map(|role| format!("`{}`", role.name())).collect();
    let names = names.join(", ");
    Err(format!("the certificate has the role `{}`, which may not {text}: use one of {names}", role.name()))
}
