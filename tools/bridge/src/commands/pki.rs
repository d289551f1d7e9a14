//! `pki`: a small private authority.

use std::process::ExitCode;

use stillpoint_arguments::{Pki, PkiTask, RoleName};
use stillpoint_remote::{Authority, Role, Tls, TlsFiles};

use super::exchange::ended;
use crate::error::BridgeError;

fn role_of(name: RoleName) -> Role {
    match name {
        RoleName::Bedside => Role::Bedside,
        RoleName::Cluster => Role::Cluster,
        RoleName::Worker => Role::Worker,
        RoleName::Viewer => Role::Viewer,
        RoleName::Router => Role::Router,
    }
}

/// Executes the subcommand.
pub fn execute(arguments: Pki) -> ExitCode {
    ended(try_execute(arguments))
}

fn try_execute(arguments: Pki) -> Result<(), BridgeError> {
    match arguments.task {
        PkiTask::Authority { folder, days } => {
            Authority::create(&folder, days)?;
            println!("{}: valid for {days} days", folder.join("authority.pem").display());
        }
        PkiTask::Certificate { folder, role, name, address, days, replace } => {
            let role = role_of(role);
            let name = name.unwrap_or_else(|| role.name().to_owned());
            let issued = Authority::open(&folder)?.issue(role, &name, &address, days, replace)?;
            println!("{}: role {}, valid for {days} days", issued.certificate.display(), role.name());
            println!("{}: keep it on the machine of its owner", issued.key.display());
        }
        PkiTask::Show { certificate, key, authority } => {
            let key = key.unwrap_or_else(|| certificate.with_extension("key"));
            let authority = authority.unwrap_or_else(|| certificate.with_file_name("authority.pem"));
            let tls = Tls::load(&TlsFiles { certificate, key, authority })?;
            let (role, name) = (tls.role().name(), tls.name());
            println!("role {role}, name {name}, expires on {} (in {} days)", tls.until(), tls.days_left());
        }
    }
    Ok(())
}
