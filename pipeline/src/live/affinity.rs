//! Where a process runs: its core and scheduling class.

use crate::graph::Priority;

/// Keeps this process off some cores, where it may use others. A process that cannot runs where it was.
pub fn keep_off(cores: &[usize]) {
    let Ok(mut set) = rustix::thread::sched_getaffinity(None) else { return };
    cores.iter().filter(|core| **core < rustix::thread::CpuSet::MAX_CPU).for_each(|core| set.unset(*core));
    if set.count() > 0 {
        let _ = rustix::thread::sched_setaffinity(None, &set);
    }
}

/// Binds this thread to a core and sets its scheduling class, or says what forbids it.
pub fn place(core: Option<usize>, priority: Priority) -> Result<(), String> {
    if let Some(core) = core {
        let mut set = rustix::thread::CpuSet::new();
        if core >= rustix::thread::CpuSet::MAX_CPU {
            return Err(format!("there is no core {core}"));
        }
        set.set(core);
        rustix::thread::sched_setaffinity(None, &set).map_err(|e| {
            format!("this process cannot be bound to core {core}: {e}; choose a core that exists")
        })?;
    }
    if let Priority::Fifo(level) = priority {
        stillpoint_shm::real_time(level).map_err(|e| e.to_string())?;
    }
    Ok(())
}
