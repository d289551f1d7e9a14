//! A relay of TCP between two hosts, which can be cut or slow.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A relay of both ports of a host.
pub struct Relay {
    /// It takes and gives nothing, and closes nothing.
    pub cut: Arc<AtomicBool>,
}

impl Relay {
    /// Passes on what comes at `from` and the next port, each connection with at most so many bytes a second in each
    /// direction.
    pub fn start(from: u16, to: u16, rate: Option<f64>) -> Self {
        let cut = Arc::new(AtomicBool::new(false));
        for offset in 0..2 {
            let listener = TcpListener::bind(("127.0.0.1", from + offset)).unwrap();
            let is_cut = cut.clone();
            std::thread::spawn(move || {
                for there in listener.incoming().flatten() {
                    let Ok(here) = TcpStream::connect(("127.0.0.1", to + offset)) else { continue };
                    let ways = [(there.try_clone().unwrap(), here.try_clone().unwrap()), (here, there)];
                    for (a, b) in ways {
                        let is_cut = is_cut.clone();
                        std::thread::spawn(move || pass_on(a, b, &is_cut, rate));
                    }
                }
            });
        }
        Self { cut }
    }
}

fn pass_on(mut from: TcpStream, mut to: TcpStream, is_cut: &AtomicBool, rate: Option<f64>) {
    let mut bytes = [0; 4096];
    let mut free = Instant::now();
    while let Ok(length @ 1..) = from.read(&mut bytes) {
        while is_cut.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        if let Some(rate) = rate {
            std::thread::sleep(free.saturating_duration_since(Instant::now()));
            free = free.max(Instant::now()) + Duration::from_secs_f64(length as f64 / rate);
        }
        if to.write_all(&bytes[..length]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(std::net::Shutdown::Both);
}
