//! Who connects to whom, and how long that is waited for.
//!
//! What a process sent is safe from its death on with everyone who has connected to it: its memory is mapped then. So a
//! worker begins when the others have been told to connect to it, and its node is cleaned when they have.

use std::time::Duration;

use super::Supervisor;
use crate::live::barrier::connect;
use crate::live::children::Child;
use crate::live::control::ToRecorder;

/// How long a worker is waited for to connect: one that is in a long step connects when it comes back.
const CONNECT_PATIENCE: Duration = Duration::from_secs(2);
/// How long the recorder may leave an order undone: what it has not connected to is lost to the session.
pub(super) const RECORDER_PATIENCE: Duration = Duration::from_secs(10);
/// How often a recorder that owes nothing is told to connect again: one that hangs leaves that undone. Its answer never
/// waits for a disk, to which another thread of it writes.
const RECORDER_ASKED: Duration = Duration::from_secs(1);
/// How soon a signal is noticed.
pub(super) const GLANCE: Duration = Duration::from_millis(50);

impl Supervisor {
    /// Has every child connect to all publishers that are there, and waits for the workers, for those in a long step no
    /// longer than a moment. Gives the number of the order.
    pub(super) fn connect_all(&mut self) -> u64 {
        for journal in &self.journals {
            let _ = journal.connect();
        }
        self.connects += 1;
        let number = self.connects;
        if let Some(recorder) = self.recorder.as_mut().filter(|r| r.made) {
            recorder.order_connect(number, ToRecorder::Connect);
        }
        let workers = self.workers.iter_mut().filter_map(|w| w.child.as_mut());
        let mut workers: Vec<&mut Child> = workers.filter(|c| c.made).collect();
        // A worker in a long step connects when it comes back.
        let _ = connect(&mut workers, number, CONNECT_PATIENCE, &mut self.told);
        number
    }

    /// Asks a recorder that nobody has asked for a while, and ends one that leaves an order undone for too long.
    pub(super) fn prove_recorder(&mut self) {
        let Some(recorder) = self.recorder.as_mut().filter(|r| r.made) else { return };
        // It may have answered while others were waited for.
        recorder.listen(&mut self.told);
        if recorder.silence() > RECORDER_PATIENCE {
            recorder.give_up(recorder.silence());
        } else if recorder.is_unasked(RECORDER_ASKED) {
            recorder.order_connect(self.connects, ToRecorder::Connect);
        }
    }

    /// Whether the recorder has done an order to connect. One whose ports are not made has nothing to keep.
    pub(super) fn is_recorder_at(&self, number: u64) -> bool {
        self.recorder.as_ref().is_none_or(|r| !r.made || r.connected >= number)
    }

    /// Waits until the recorder has done an order to connect; whether it has. One that leaves undone what it was told for
    /// as long as it may is not waited for, nor is anyone once `hurried` says so.
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
            recorder
                .wait(GLANCE, &mut self.told, |c| c.connected >= number || (c.made && c.ordered < number));
        }
        recorder.connected >= number
    }
}
