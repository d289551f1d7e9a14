//! Real-time scheduling of this process: SCHED_FIFO and locked memory.

use std::io;

use rustix::mm::{MlockAllFlags, mlockall, munlockall};

/// Why this process cannot be scheduled in real time.
#[derive(Debug, thiserror::Error)]
pub enum RealTimeError {
    /// Its memory cannot be locked.
    #[error("the memory of the process cannot be locked: {0}; raise `ulimit -l`, or remove `priority`")]
    Memory(io::Error),
    /// Its scheduling class cannot be set.
    #[error(
        "SCHED_FIFO {level} is refused: {cause}; raise `ulimit -r` or give CAP_SYS_NICE, or remove `priority`"
    )]
    Priority {
        /// The level that was asked for.
        level: u8,
        /// What the operating system answered.
        cause: io::Error,
    },
}

/// Sets SCHED_FIFO with `level` (1 to 99) for who can go on without. The memory is locked only where there is no limit to it:
/// beyond a limit, memory that is mapped later would be refused.
///
/// # Errors
/// The limit that forbids it; then nothing has changed.
pub fn real_time_if_allowed(level: u8) -> Result<(), RealTimeError> {
    fifo(level)?;
    if rustix::process::getrlimit(rustix::process::Resource::Memlock).current.is_none() {
        let _ = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE);
    }
    Ok(())
}

/// Locks the memory of this process and sets SCHED_FIFO with `level` (1 to 99).
///
/// # Errors
/// The limit that forbids it; then nothing has changed.
pub fn real_time(level: u8) -> Result<(), RealTimeError> {
    if let Err(refused) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        let _ = munlockall();
        return Err(RealTimeError::Memory(refused.into()));
    }
    fifo(level).inspect_err(|_| {
        // Nothing of it stays: who goes on without may need more memory than can be locked.
        let _ = munlockall();
    })
}

fn fifo(level: u8) -> Result<(), RealTimeError> {
    let parameter = libc::sched_param { sched_priority: i32::from(level) };
    // SAFETY: the call reads a struct that lives on this stack frame.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) } != 0 {
        return Err(RealTimeError::Priority { level, cause: io::Error::last_os_error() });
    }
    Ok(())
}
