//! The server of figures.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use crate::{Figures, Request, respond};

/// The figures that clients read.
#[derive(Clone, Default)]
pub struct Metrics {
    text: Arc<Mutex<String>>,
}

/// Why figures are not served.
#[derive(Debug, thiserror::Error)]
pub enum MetricsError {
    /// The address cannot be used.
    #[error("--metrics {address}: {reason}; choose another address or port")]
    Address {
        /// The address.
        address: SocketAddr,
        /// Why.
        reason: std::io::Error,
    },
    /// No thread can be started.
    #[error("the thread that serves metrics cannot be started: {0}")]
    Thread(std::io::Error),
}

impl Metrics {
    /// Serves figures at an address from now on, as long as this process lives. Gives the address with its port.
    ///
    /// # Errors
    /// The address is not one of this machine, its port is taken, or no thread can be started.
    pub fn serve(address: SocketAddr) -> Result<(Self, SocketAddr), MetricsError> {
        let wrong = |reason| MetricsError::Address { address, reason };
        let listener = TcpListener::bind(address).map_err(wrong)?;
        let bound = listener.local_addr().map_err(wrong)?;
        let metrics = Self::default();
        let text = metrics.text.clone();
        // A thread of its own: a client that stalls never delays the program.
        let serve = move || {
            for client in listener.incoming().flatten() {
                let body = text.lock().map(|text| text.clone()).unwrap_or_default();
                // A client that is gone gets nothing.
                let _ = answer(client, &body);
            }
        };
        std::thread::Builder::new().spawn(serve).map_err(MetricsError::Thread)?;
        Ok((metrics, bound))
    }

    /// Takes the present figures.
    pub fn update(&self, figures: Figures) {
        if let Ok(mut text) = self.text.lock() {
            *text = figures.into_text();
        }
    }
}

fn answer(mut client: TcpStream, body: &str) -> std::io::Result<()> {
    let request = Request::read(&mut client)?;
    let (status, kind, body) = match (request.method.as_str(), request.path.as_str()) {
        ("GET", "/metrics" | "/") => ("200 OK", "text/plain; version=0.0.4; charset=utf-8", body),
        ("GET", _) => ("404 Not Found", "text/plain", "only /metrics is there\n"),
        _ => ("405 Method Not Allowed", "text/plain", "only GET is taken\n"),
    };
    respond(&mut client, status, kind, body.as_bytes())
}
