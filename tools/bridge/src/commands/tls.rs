//! The certificate of a subcommand.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use stillpoint_remote::{Role, Tls, TlsFiles};

/// The files of a certificate; `stillpoint pki` makes them.
#[derive(Args, Clone)]
pub struct TlsArgs {
    /// Certificate of this program, PEM. With it, endpoints are `tls/ADDRESS:PORT`.
    #[arg(long, value_name = "FILE", requires_all = ["key", "authority"])]
    certificate: Option<PathBuf>,
    /// Key of the certificate, PEM; only its owner may read it.
    #[arg(long, value_name = "FILE", requires = "certificate")]
    key: Option<PathBuf>,
    /// Certificate of the authority that signs all certificates, PEM.
    #[arg(long, value_name = "FILE", requires = "certificate")]
    authority: Option<PathBuf>,
}

impl TlsArgs {
    /// The certificate, read and checked; none if none is given.
    pub fn load(&self) -> Result<Option<Arc<Tls>>, String> {
        let (Some(certificate), Some(key), Some(authority)) =
            (self.certificate.clone(), self.key.clone(), self.authority.clone())
        else {
            return Ok(None);
        };
        let tls = Tls::load(&TlsFiles { certificate, key, authority }).map_err(|e| e.to_string())?;
        Ok(Some(Arc::new(tls)))
    }
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
