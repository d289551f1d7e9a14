//! The options of subcommands that compute on a pool of workers, and the way there.

use std::ffi::OsStr;
use std::path::PathBuf;

use clap::Args;
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool};

use crate::commands::bridge;
use crate::exit::Failure;
use crate::quantity::quantity;

/// Where the pool is, and how this program shows who it is.
#[derive(Args)]
pub struct PoolArgs {
    /// Compute on the workers of the pool at this endpoint, such as `tcp/10.0.0.7:7447`. The result is the same to the
    /// byte. Needs `stillpoint-bridge`; see docs/guide/remote.md.
    #[arg(long, value_name = "ENDPOINT")]
    pool: Option<String>,
    /// Certificate of this program, PEM, for a pool at `tls/ADDRESS:PORT`.
    #[arg(long, value_name = "FILE", requires_all = ["pool", "key", "authority"])]
    certificate: Option<PathBuf>,
    /// Key of the certificate, PEM; only its owner may read it.
    #[arg(long, value_name = "FILE", requires = "certificate")]
    key: Option<PathBuf>,
    /// Certificate of the authority that signs all certificates, PEM.
    #[arg(long, value_name = "FILE", requires = "certificate")]
    authority: Option<PathBuf>,
    /// Time without a sign of work of any worker after which this process computes a call itself.
    #[arg(long, value_name = "TIME", default_value = "60s", requires = "pool")]
    patience: String,
}

impl PoolArgs {
    /// Whether a pool was named.
    pub fn is_given(&self) -> bool {
        self.pool.is_some()
    }

    /// The pool, if one was named. A child process carries the messages, with the certificate that was named.
    ///
    /// # Errors
    /// The child cannot be started, or the patience is no time.
    pub fn open(&self) -> Result<Option<Pool<ChildCourier>>, Failure> {
        let Some(endpoint) = &self.pool else { return Ok(None) };
        let patience_s = self.patience_s()?;
        let mut command = bridge::command()?;
        command.args(["plan-client", "--connect", endpoint]).args(self.tls_arguments());
        let courier = ChildCourier::start(command)
            .map_err(|e| Failure::failed(format!("stillpoint-bridge cannot be started: {e}")))?;
        let mut settings = ClientSettings::new(Build::here().map_err(Failure::failed)?);
        settings.patience = (patience_s * 1e9) as u64;
        settings.tells_demand = true;
        Ok(Some(Pool::new(courier, settings)))
    }

    /// The arguments by which the child process gets the certificate: names of files, and nothing of their content.
    fn tls_arguments(&self) -> Vec<&OsStr> {
        let files =
            [("--certificate", &self.certificate), ("--key", &self.key), ("--authority", &self.authority)];
        let given =
            files.iter().filter_map(|(name, file)| Some([OsStr::new(*name), file.as_ref()?.as_os_str()]));
        given.flatten().collect()
    }

    fn patience_s(&self) -> Result<f64, Failure> {
        let what = format!("--patience {}", self.patience);
        let seconds = quantity(&self.patience, "s", &what)?;
        if !(0.0..=86_400.0).contains(&seconds) {
            return Err(Failure::wrong(format!("{what}: give 0 s to one day")));
        }
        Ok(seconds)
    }
}

/// Tells who computed.
pub fn print_shares(pool: &Pool<ChildCourier>) {
    let tally = pool.tally();
    outln!(
        "pool: {} calls by {} workers, {} by this process; {} answers compared, {} calls asked twice because they were late",
        tally.remote,
        pool.workers().values().filter(|worker| worker.answered > 0).count(),
        tally.local,
        tally.compared,
        tally.hedged
    );
}
