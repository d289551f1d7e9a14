//! A relay of TCP between two hosts, which can be cut, slow or late.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

/// A relay of both ports of a host.
pub struct Relay {
    /// It takes and gives nothing, and closes nothing.
    pub cut: Arc<AtomicBool>,
}

/// What the relay does to each connection, in each direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Line {
    /// Bytes a second, at most.
    pub rate: Option<f64>,
    /// Longest delay; each piece has its own, from 0 on. Pieces keep their order.
    pub jitter: Duration,
}

impl Relay {
    /// Passes on what comes at `from` and the next port, each connection with at most so many bytes a second in each
    /// direction.
    pub fn start(from: u16, to: u16, rate: Option<f64>) -> Self {
        Self::over(from, to, Line { rate, ..Line::default() })
    }

    /// Passes on what comes at `from` and the next port over such a line.
    pub fn over(from: u16, to: u16, line: Line) -> Self {
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
                        std::thread::spawn(move || pass_on(a, b, &is_cut, line));
                    }
                }
            });
        }
        Self { cut }
    }
}

fn pass_on(mut from: TcpStream, to: TcpStream, is_cut: &AtomicBool, line: Line) {
    let mut bytes = [0; 4096];
    let (mut free, mut number) = (Instant::now(), from.as_raw_fd() as u64);
    let (pieces, taken) = sync_channel(256);
    let writer = std::thread::spawn(move || write(to, &taken));
    while let Ok(length @ 1..) = from.read(&mut bytes) {
        while is_cut.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        if let Some(rate) = line.rate {
            std::thread::sleep(free.saturating_duration_since(Instant::now()));
            free = free.max(Instant::now()) + Duration::from_secs_f64(length as f64 / rate);
        }
        // Some delay between none and the longest.
        number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let due = Instant::now() + line.jitter.mul_f64((number >> 40) as f64 / f64::from(1 << 24));
        if pieces.send((due, bytes[..length].to_vec())).is_err() {
            break;
        }
    }
    drop(pieces);
    let _ = writer.join();
}

/// Writes each piece when it is due, in their order, and closes the connection at the end.
fn write(mut to: TcpStream, pieces: &Receiver<(Instant, Vec<u8>)>) {
    for (due, piece) in pieces {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        if to.write_all(&piece).is_err() {
            break;
        }
    }
    let _ = to.shutdown(std::net::Shutdown::Both);
}
