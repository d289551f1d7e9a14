//! `pki`: a small private authority.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand, ValueEnum};
use stillpoint_remote::{Authority, Role, Tls, TlsFiles};

use super::exchange::ended;

/// Make the certificates by which hosts, workers and routers know each other.
#[derive(Args)]
pub struct Pki {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Make an authority in a new folder. Keep its key `authority.key` on a machine of its own.
    Authority {
        /// Folder.
        folder: PathBuf,
        /// Days for which the authority is valid.
        #[arg(long, default_value_t = 3650)]
        days: u32,
    },
    /// Make a certificate: NAME.pem and NAME.key in the folder of the authority.
    Certificate {
        /// Folder of the authority.
        folder: PathBuf,
        /// What its owner may do.
        role: RoleName,
        /// Name of its owner; the default is the role.
        #[arg(long)]
        name: Option<String>,
        /// Address or name under which others reach its owner; may be given several times. Needed if it listens.
        #[arg(long, value_name = "ADDRESS")]
        address: Vec<String>,
        /// Days for which the certificate is valid.
        #[arg(long, default_value_t = 365)]
        days: u32,
        /// Take the place of an older certificate of this name. Programs that listen take the new one within a second.
        #[arg(long)]
        replace: bool,
    },
    /// Print role, name and end of a certificate, and check that its files fit together.
    Show {
        /// Certificate, PEM.
        certificate: PathBuf,
        /// Its key; the default is the same name with `.key`.
        #[arg(long)]
        key: Option<PathBuf>,
        /// Certificate of the authority; the default is `authority.pem` beside it.
        #[arg(long)]
        authority: Option<PathBuf>,
    },
}

#[derive(Clone, Copy, ValueEnum)]
enum RoleName {
    /// A host at the patient: sends and takes samples, and asks the planning pool.
    Bedside,
    /// A host that computes for others: sends and takes samples, and asks the planning pool.
    Cluster,
    /// Computes calls of the planning pool.
    Worker,
    /// Takes samples and lists workers.
    Viewer,
    /// Passes on what others send.
    Router,
}

impl From<RoleName> for Role {
    fn from(name: RoleName) -> Self {
        match name {
            RoleName::Bedside => Self::Bedside,
            RoleName::Cluster => Self::Cluster,
            RoleName::Worker => Self::Worker,
            RoleName::Viewer => Self::Viewer,
            RoleName::Router => Self::Router,
        }
    }
}

impl Pki {
    /// Executes the subcommand.
    pub fn execute(self) -> ExitCode {
        ended(self.try_execute())
    }

    fn try_execute(self) -> Result<(), String> {
        let text = |e: stillpoint_remote::PkiError| e.to_string();
        match self.what {
            What::Authority { folder, days } => {
                Authority::create(&folder, days).map_err(text)?;
                println!("{}: valid for {days} days", folder.join("authority.pem").display());
            }
            What::Certificate { folder, role, name, address, days, replace } => {
                let role = Role::from(role);
                let name = name.unwrap_or_else(|| role.name().to_owned());
                let issued = Authority::open(&folder)
                    .map_err(text)?
                    .issue(role, &name, &address, days, replace)
                    .map_err(text)?;
                println!("{}: role {}, valid for {days} days", issued.certificate.display(), role.name());
                println!("{}: keep it on the machine of its owner", issued.key.display());
            }
            What::Show { certificate, key, authority } => {
                let key = key.unwrap_or_else(|| certificate.with_extension("key"));
                let authority = authority.unwrap_or_else(|| certificate.with_file_name("authority.pem"));
                let tls = Tls::load(&TlsFiles { certificate, key, authority }).map_err(|e| e.to_string())?;
                let (role, name) = (tls.role().name(), tls.name());
                println!(
                    "role {role}, name {name}, expires on {} (in {} days)",
                    tls.until(),
                    tls.days_left()
                );
            }
        }
        Ok(())
    }
}
