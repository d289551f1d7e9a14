//! The arguments of `pki`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

/// Make the certificates by which hosts, workers and routers know each other.
#[derive(Args, Debug)]
pub struct Pki {
    /// What is made or shown.
    #[command(subcommand)]
    pub task: PkiTask,
}

/// What is made or shown.
#[derive(Subcommand, Debug)]
pub enum PkiTask {
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
        /// Certificate of the authority; the default is `authority.pem` next to it.
        #[arg(long)]
        authority: Option<PathBuf>,
    },
}

/// What the owner of a certificate may do.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RoleName {
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
