//! Long work without the interpreter's lock, which Ctrl-C ends.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;

/// Interval at which signals are looked for.
const LOOK: Duration = Duration::from_millis(50);

/// Does work in a thread of its own. A signal whose Python handler raises (Ctrl-C) sets the flag that the work looks at;
/// the exception of the handler is raised when the work has ended.
pub fn interruptible<T: Send>(py: Python<'_>, work: impl FnOnce(Arc<AtomicBool>) -> T + Send) -> PyResult<T> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let (result, raised) = py.detach(|| {
        let (sender, ended) = channel();
        std::thread::scope(|scope| {
            let worker = scope.spawn(move || {
                let result = work(flag);
                // The receiver waits until the work has ended.
                let _ = sender.send(());
                result
            });
            let mut raised = None;
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(LOOK) {
                if raised.is_none()
                    && let Err(error) = Python::attach(|py| py.check_signals())
                {
                    stop.store(true, Ordering::Relaxed);
                    raised = Some(error);
                }
            }
            (worker.join(), raised)
        })
    });
    match (result, raised) {
        (_, Some(error)) => Err(error),
        (Ok(value), None) => Ok(value),
        (Err(panic), None) => std::panic::resume_unwind(panic),
    }
}
