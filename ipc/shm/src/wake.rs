//! Waking: a notifier and a listener per topic, and waiting on several listeners and a control pipe.

use std::os::fd::{AsRawFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::*;
use iceoryx2::service::ipc;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::error::{PortKind, ShmError, port_error};

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
    pub(crate) fn new(port: iceoryx2::port::listener::Listener<ipc::Service>, topic: &str) -> Self {
        Self { port, topic: topic.to_string() }
    }

    /// Takes all wake-ups that are pending.
    pub fn drain(&self) -> Result<(), ShmError> {
        self.port.try_wait(|_| {}).map(drop).map_err(|e| port_error(&self.topic, PortKind::Listener, e))
    }

    /// Waits until it is woken, or for `nanoseconds`. An interruption by a signal counts as a wake-up.
    pub fn wait(&self, nanoseconds: u64) -> Result<(), ShmError> {
        let wait = std::time::Duration::from_nanos(nanoseconds);
        match self.port.timed_wait(|_| {}, wait) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(e) => Err(port_error(&self.topic, PortKind::Listener, e)),
        }
    }
}

/// Waits on the listeners of one thread and on its control pipe at the same time.
pub struct Wake {
    /// The control pipe first, then a descriptor for each listener: made once, since a wait stands on the data path.
    fds: Vec<PollFd<'static>>,
    /// How many of them are the control pipe's: one, until it is forgotten.
    controls: usize,
    /// Dropped after the descriptors that name their sockets.
    listeners: Vec<Listener>,
    _control: OwnedFd,
    /// Other descriptors that end a wait, behind those of the listeners.
    others: Vec<OwnedFd>,
}

impl Wake {
    /// Waits on these listeners and on this end of the control pipe.
    pub fn new(control: OwnedFd, listeners: Vec<Listener>) -> Self {
        let raw = listeners.iter().map(|l| {
            // SAFETY: this is the number of the listener's open socket; the listener is kept beside it.
            unsafe { l.port.file_descriptor().native_handle() }
        });
        let fds = std::iter::once(control.as_raw_fd()).chain(raw);
        let fds = fds.map(|fd| {
            // SAFETY: the descriptor is only polled, and stays open for as long as this does: `listeners` and
            // `_control` own it.
            PollFd::from_borrowed_fd(unsafe { BorrowedFd::borrow_raw(fd) }, PollFlags::IN)
        });
        Self { fds: fds.collect(), controls: 1, listeners, _control: control, others: Vec::new() }
    }

    /// Lets another descriptor end a wait, too, when it can be read. Whoever rings it takes its wake-ups.
    #[must_use]
    pub fn watching(mut self, other: OwnedFd) -> Self {
        // SAFETY: the descriptor is only polled, and stays open for as long as this does: `others` owns it.
        let fd = unsafe { BorrowedFd::borrow_raw(other.as_raw_fd()) };
        self.fds.push(PollFd::from_borrowed_fd(fd, PollFlags::IN));
        self.others.push(other);
        self
    }

    /// Waits until a listener is woken, the control pipe can be read or its other end is gone, or `timeout` ns have
    /// passed (`None`: no limit). Whether it is the control pipe. Signals and spurious wake-ups end a wait too: look
    /// again at what is there. Wake-ups stay pending until [`drain`](Self::drain).
    pub fn wait(&mut self, timeout: Option<u64>) -> Result<bool, ShmError> {
        let timeout = timeout
            .map(|ns| Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as _ });
        match poll(&mut self.fds, timeout.as_ref()) {
            Ok(_) => Ok(self.fds[..self.controls].iter().any(|control| !control.revents().is_empty())),
            Err(Errno::INTR) => Ok(false),
            Err(e) => Err(ShmError::Wait(Arc::new(e.into()))),
        }
    }

    /// Waits no longer on the control pipe: one whose other end is gone would end every wait at once.
    pub fn forget_control(&mut self) {
        self.fds.drain(..std::mem::take(&mut self.controls));
    }

    /// Takes the wake-ups that the last wait saw, and says whether there were any. Look once more before the next wait:
    /// what was sent between the last look and this has no wake-up of its own any more.
    pub fn drain(&mut self) -> Result<bool, ShmError> {
        let mut any = false;
        for (fd, listener) in self.fds.iter_mut().skip(self.controls).zip(&self.listeners) {
            if !fd.revents().is_empty() {
                fd.clear_revents();
                listener.drain()?;
                any = true;
            }
        }
        Ok(any)
    }
}
