//! The arguments of `worker`, `pool`, `router` and `pki`. `stillpoint` reads them, for its help, completions and man
//! pages, and hands them to `stillpoint-bridge`, which reads them again and executes them.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod pki;

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;

pub use pki::{Pki, PkiTask, RoleName};

/// The files of a certificate; `stillpoint pki` makes them.
#[derive(Args, Clone, Debug)]
pub struct TlsArgs {
    /// Certificate of this program, PEM. With it, endpoints are `tls/ADDRESS:PORT`.
    #[arg(long, value_name = "FILE", requires_all = ["key", "authority"], env = "STILLPOINT_CERTIFICATE")]
    pub certificate: Option<PathBuf>,
    /// Key of the certificate, PEM; only its owner may read it.
    #[arg(long, value_name = "FILE", requires = "certificate", env = "STILLPOINT_KEY")]
    pub key: Option<PathBuf>,
    /// Certificate of the authority that signs all certificates, PEM.
    #[arg(long, value_name = "FILE", requires = "certificate", env = "STILLPOINT_AUTHORITY")]
    pub authority: Option<PathBuf>,
}

/// Pass on samples between hosts that cannot reach each other. Such hosts name its endpoint as `router` in the pipeline.
/// It holds no state and runs until Ctrl-C.
#[derive(Args, Debug)]
pub struct Router {
    /// Endpoint at which hosts reach it, as `tcp/ADDRESS:PORT`, or `tls/ADDRESS:PORT` with a certificate; the next port is used, too.
    #[arg(long, value_name = "ENDPOINT", required = true)]
    pub listen: Vec<String>,
    /// The certificate.
    #[command(flatten)]
    pub tls: TlsArgs,
    /// Serve figures of the hosts and workers that greet through it as Prometheus text at this address, such as
    /// `127.0.0.1:9464`; port 0 takes any.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
}

/// List the workers of a pool: load, calls a second, cache, and whether they are of this build.
#[derive(Args, Debug)]
pub struct Pool {
    /// Endpoint of a router or of a listening worker.
    #[arg(value_name = "ENDPOINT")]
    pub connect: String,
    /// The certificate.
    #[command(flatten)]
    pub tls: TlsArgs,
    /// Seconds for which it listens.
    #[arg(long, default_value_t = 2.0)]
    pub seconds: f64,
    /// Print how many workers would be useful now: calls without an answer, for the slots of a worker.
    #[arg(long = "wanted")]
    pub counts_useful: bool,
    /// Slots of the workers that would be started. Default: those of the smallest worker that is there, else 1.
    #[arg(long, requires = "counts_useful")]
    pub slots: Option<NonZeroUsize>,
    /// Print it as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Compute calls for those who plan. A worker holds nothing that matters: it may be ended at any time.
#[derive(Args, Debug)]
pub struct Worker {
    /// Endpoint of a router or of a listening worker, such as `tcp/10.0.0.7:7447`. Default: that of the environment variable
    /// `STILLPOINT_POOL`, unless `--listen` is given.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Option<String>,
    /// Endpoint at which this worker is a router, too; it uses this port and the next one. Its certificate must be
    /// that of a router.
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "connect")]
    pub listen: Option<String>,
    /// The certificate.
    #[command(flatten)]
    pub tls: TlsArgs,
    /// Name of the worker behind `worker-`; the default is made of its process number and the time.
    #[arg(long)]
    pub name: Option<String>,
    /// Seconds for which the calls that it computes are finished after the first SIGTERM or SIGINT. Those that wait go
    /// back to those who asked. A second signal ends it at once.
    #[arg(long, value_name = "SECONDS", default_value_t = 25.0)]
    pub grace: f64,
    /// Calls that are computed at the same time. Default: as many as there are cores.
    #[arg(long)]
    pub slots: Option<NonZeroUsize>,
    /// Folder in which arguments and answers are kept. Each worker needs one of its own.
    #[arg(long, value_name = "DIR", default_value = "pool-cache", env = "STILLPOINT_POOL_CACHE")]
    pub cache: PathBuf,
    /// The most megabytes of that folder.
    #[arg(long, value_name = "MB", default_value_t = 8000)]
    pub cache_mb: u64,
    /// The most megabytes of arguments that are kept open in memory.
    #[arg(long, value_name = "MB", default_value_t = 2000)]
    pub memory_mb: u64,
    /// Serve the figures of this worker as Prometheus text at this address, such as `127.0.0.1:9464`; port 0 takes any.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
    /// Answers from this one on are wrong: a test of those who ask.
    #[arg(long, hide = true)]
    pub wrong_from: Option<u64>,
}
