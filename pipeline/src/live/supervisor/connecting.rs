//! The order to connect, and the waits for it.
//!
//! A sample of a process that dies is safe with every other process that has connected to it, because its memory is
//! mapped there. So a worker begins when the others have been told to connect to it, and its node is cleaned when they
//! have connected.

use std::time::Duration;

use super::Supervisor;
use crate::live::barrier::connect;
use crate::live::children::Child;
use crate::live::control::ToRecorder;

/// Time that a worker has to connect: a worker in a long step connects when the step ends.
const CONNECT_PATIENCE: Duration = Duration::from_secs(2);
/// How long the recorder may take to answer an order: samples of publishers that it has not connected to are lost to the
/// session.
pub(super) const RECORDER_PATIENCE: Duration = Duration::from_secs(10);
/// Period at which a recorder without open orders is told to connect again: a recorder that hangs does not answer. The
/// answer never waits for a disk, because another thread of the recorder writes.
const RECORDER_ASKED: Duration = Duration::from_secs(1);
/// How soon a signal is noticed.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(50);

impl Supervisor {
    /// Has every child connect to all publishers that are there, and waits for the workers, for those in a long step no
    /// longer than a moment. Gives the number of the order.
    pub(super) fn connect_all(&mut self) -> u64 {
        for journal in &self.journals {
            let _ = journal.connect();
        }
        let _ = self.requests.connect();
        self.connects += 1;
        let number = self.connects;
        if let Some(recorder) = self.recorder.as_mut().filter(|r| r.made) {
            recorder.order_connect(number, ToRecorder::Connect);
        }
        let workers = self.workers.iter_mut().filter_map(|w| w.child.as_mut());
        let mut workers: Vec<&mut Child> = workers.filter(|c| c.made).collect();
        // A worker in a long step connects when it comes back.
        let _ = connect(&mut workers, number, CONNECT_PATIENCE, &mut self.reported);
        number
    }

    /// Tells a recorder to connect that was not told for a while, and ends a recorder that leaves an order open for too
    /// long.
    pub(super) fn check_recorder(&mut self) {
        let Some(recorder) = self.recorder.as_mut().filter(|r| r.made) else { return };
        // It may have answered while others were waited for.
        recorder.listen(&mut self.reported);
        if recorder.silence() > RECORDER_PATIENCE {
            recorder.kill_unresponsive(recorder.silence());
        } else if recorder.is_idle_for(RECORDER_ASKED) {
            recorder.order_connect(self.connects, ToRecorder::Connect);
        }
    }

    /// Whether the recorder has done an order to connect. A recorder without ports has no samples to keep.
    pub(super) fn is_recorder_at(&self, number: u64) -> bool {
        self.recorder.as_ref().is_none_or(|r| !r.made || r.connected >= number)
    }

    /// Waits until the recorder has made its ports. The wait ends early as that of [`Supervisor::wait_for_recorder`] does.
    pub(super) fn wait_for_recorder_ports(&mut self, mut hurried: impl FnMut() -> bool) {
        let Some(recorder) = &mut self.recorder else { return };
        while !recorder.made && !recorder.is_gone() && recorder.silence() < RECORDER_PATIENCE && !hurried() {
            recorder.wait(POLL_INTERVAL, &mut self.reported, |c| c.made);
        }
    }

    /// Waits until the recorder has done an order to connect, and returns whether it has. The wait ends early if the
    /// recorder leaves the order open for too long, or if `hurried` is set.
    pub(super) fn wait_for_recorder(&mut self, number: u64, mut hurried: impl FnMut() -> bool) -> bool {
        let Some(recorder) = &mut self.recorder else { return false };
        while recorder.connected < number
            && !recorder.is_gone()
            && recorder.silence() < RECORDER_PATIENCE
            && !hurried()
        {
            if recorder.made && recorder.ordered < number {
                recorder.order_connect(number, ToRecorder::Connect);
            }
            recorder.wait(POLL_INTERVAL, &mut self.reported, |c| {
                c.connected >= number || (c.made && c.ordered < number)
            });
        }
        recorder.connected >= number
    }
}
