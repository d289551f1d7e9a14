//! Real-time scheduling of this process: SCHED_FIFO and locked memory.

/// Locks the memory of this process and sets SCHED_FIFO with `level` (1 to 99), or says which limit forbids it.
pub fn real_time(level: u8) -> Result<(), String> {
    use rustix::mm::{MlockAllFlags, mlockall};
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|e| format!("memory cannot be locked: {e}; raise `ulimit -l`, or remove `priority`"))?;
    let parameter = libc::sched_param { sched_priority: i32::from(level) };
    // SAFETY: the call reads a struct that lives on this stack frame.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) } != 0 {
        let reason = std::io::Error::last_os_error();
        return Err(format!(
            "SCHED_FIFO {level} is refused: {reason}; raise `ulimit -r` or give CAP_SYS_NICE, or remove `priority`"
        ));
    }
    Ok(())
}
