//! Waking: a notifier and a listener per topic, and waiting on several listeners and a control pipe.

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::*;
use iceoryx2::service::ipc;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::{Contract, ShmError};

/// Wakes the listeners of a topic.
pub struct Notifier {
    port: iceoryx2::port::notifier::Notifier<ipc::Service>,
}

impl Notifier {
    pub(crate) fn new(port: iceoryx2::port::notifier::Notifier<ipc::Service>) -> Self {
        Self { port }
    }

    /// Wakes the listeners; it never blocks. A listener that cannot be woken finds the sample when it next looks.
    pub fn notify(&self) {
        let _ = self.port.notify();
    }
}

/// Is woken by the notifier of a topic.
pub struct Listener {
    port: iceoryx2::port::listener::Listener<ipc::Service>,
    topic: String,
}

impl Listener {
    pub(crate) fn new(port: iceoryx2::port::listener::Listener<ipc::Service>, contract: &Contract) -> Self {
        Self { port, topic: contract.topic.clone() }
    }

    /// Takes all wake-ups that are pending.
    pub fn drain(&self) -> Result<(), ShmError> {
        self.port.try_wait(|_| {}).map(drop).map_err(|e| ShmError::Port {
            topic: self.topic.clone(),
            port: "listener",
            reason: format!("{e:?}"),
        })
    }

    /// Waits until it is woken, or for `nanoseconds`. An interruption by a signal counts as a wake-up.
    pub fn wait(&self, nanoseconds: u64) -> Result<(), ShmError> {
        let wait = std::time::Duration::from_nanos(nanoseconds);
        match self.port.timed_wait(|_| {}, wait) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(e) => {
                Err(ShmError::Port { topic: self.topic.clone(), port: "listener", reason: format!("{e:?}") })
            }
        }
    }
}

/// What ended a wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WakeReason {
    /// The control pipe can be read, or its other end is gone.
    pub control: bool,
    /// At least one listener was woken.
    pub listeners: bool,
}

/// Waits on the listeners of one thread and on its control pipe at the same time.
#[derive(Default)]
pub struct Wake {
    listeners: Vec<Listener>,
}

impl Wake {
    /// Waits on these listeners.
    pub fn new(listeners: Vec<Listener>) -> Self {
        Self { listeners }
    }

    /// Waits until a listener is woken, the control pipe can be read, or `timeout` ns have passed (`None`: no limit).
    /// Signals and spurious wake-ups end a wait too: look again at what is there.
    pub fn wait(&self, control: BorrowedFd<'_>, timeout: Option<u64>) -> Result<WakeReason, ShmError> {
        let mut fds = Vec::with_capacity(self.listeners.len() + 1);
        fds.push(PollFd::from_borrowed_fd(control, PollFlags::IN));
        for listener in &self.listeners {
            // SAFETY: the descriptor is only polled, and only while its listener is borrowed by this function.
            let fd = unsafe { BorrowedFd::borrow_raw(listener.port.file_descriptor().native_handle()) };
            fds.push(PollFd::from_borrowed_fd(fd, PollFlags::IN));
        }
        let timeout = timeout
            .map(|ns| Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as _ });
        match poll(&mut fds, timeout.as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(e) => {
                return Err(ShmError::Port { topic: "*".into(), port: "listener", reason: e.to_string() });
            }
        }
        let woken = |fd: &PollFd<'_>| !fd.revents().is_empty();
        let control = woken(&fds[0]);
        let mut any = false;
        for (fd, listener) in fds[1..].iter().zip(&self.listeners) {
            if woken(fd) {
                any = true;
                listener.drain()?;
            }
        }
        Ok(WakeReason { control, listeners: any })
    }
}
