//! Why the bridge, or a subcommand, cannot go on.

use stillpoint_http::MetricsError;
use stillpoint_pool::{BuildError, StoreError};
use stillpoint_remote::{PkiError, RemoteError, TlsError};

/// Why the bridge, or a subcommand, cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The network.
    #[error(transparent)]
    Remote(#[from] RemoteError),
    /// A certificate cannot be used.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// A certificate cannot be issued.
    #[error(transparent)]
    Pki(#[from] PkiError),
    /// The certificate is that of another part.
    #[error("the certificate has the role `{role}`, which may not {what}: use one of {roles}")]
    Role {
        /// Its role.
        role: &'static str,
        /// What others would not let it do.
        what: &'static str,
        /// The roles that may.
        roles: String,
    },
    /// The build cannot be named.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The cache cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Figures cannot be served.
    #[error(transparent)]
    Metrics(#[from] MetricsError),
    /// The system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The clock of the machine is before 1970.
    #[error(transparent)]
    Clock(#[from] std::time::SystemTimeError),
    /// A time to wait that is not one.
    #[error("--seconds {0}: give 0.5 to 3600")]
    Seconds(f64),
    /// Viewers cannot be served.
    #[error("viewers cannot be served at {address}: {reason}; choose another port with --port")]
    Viewers {
        /// Where.
        address: String,
        /// Why.
        reason: foxglove::FoxgloveError,
    },
    /// A topic for viewers cannot be made.
    #[error("a topic for viewers cannot be offered: {0}")]
    Channel(#[from] foxglove::FoxgloveError),
    /// What is shown breaks off.
    #[error(transparent)]
    Pipe(#[from] stillpoint_viewer::PipeError),
    /// It was not started by `stillpoint view`.
    #[error("nothing is shown: start `stillpoint view --foxglove`, which starts this command")]
    NoBegin,
    /// A topic of ROS 2 that is not written as one.
    #[error(
        "invalid topic: {0} (allowed: NAME=TYPE, with a type of images, clouds or cameras); write /depth/image_raw=sensor_msgs/msg/Image"
    )]
    Topic(String),
    /// There is no worker.
    #[error("no worker greeted within {seconds} s at {endpoint}")]
    NoWorker {
        /// How long it waited.
        seconds: f64,
        /// Where.
        endpoint: String,
    },
    /// The time of grace is wrong.
    #[error("invalid time of grace: {0} s (allowed: 0 to 86400)")]
    Grace(f64),
    /// A worker without a router.
    #[error("give --connect or --listen, or set STILLPOINT_POOL to the endpoint of a router")]
    NoEndpoint,
}
