//! Where a process runs: its core and scheduling class.

use rustix::io::Errno;
use stillpoint_shm::RealTimeError;

use crate::graph::Priority;

/// A process cannot run where the config says.
#[derive(Debug, thiserror::Error)]
pub enum AffinityError {
    /// No machine has so many cores.
    #[error("there is no core {0}")]
    NoCore(usize),
    /// The system refuses the core.
    #[error("this process cannot be bound to core {core}: {cause}; choose a core that exists")]
    Core {
        /// The core.
        core: usize,
        /// The system's answer.
        cause: Errno,
    },
    /// The system refuses the scheduling class.
    #[error(transparent)]
    RealTime(#[from] RealTimeError),
}

/// Keeps this process off some cores, where it may use others. A process that cannot runs where it was.
pub fn keep_off(cores: &[usize]) {
    let Ok(mut set) = rustix::thread::sched_getaffinity(None) else { return };
    cores.iter().filter(|core| **core < rustix::thread::CpuSet::MAX_CPU).for_each(|core| set.unset(*core));
    if set.count() > 0 {
        let _ = rustix::thread::sched_setaffinity(None, &set);
    }
}

/// Binds this thread to a core and sets its scheduling class, or says what forbids it. What forbids a class that was asked for
/// only if allowed is returned: the thread goes on without.
pub fn place(core: Option<usize>, priority: Priority) -> Result<Option<RealTimeError>, AffinityError> {
    if let Some(core) = core {
        let mut set = rustix::thread::CpuSet::new();
        if core >= rustix::thread::CpuSet::MAX_CPU {
            return Err(AffinityError::NoCore(core));
        }
        set.set(core);
        rustix::thread::sched_setaffinity(None, &set).map_err(|cause| AffinityError::Core { core, cause })?;
    }
    match priority {
        Priority::Normal => Ok(None),
        Priority::Fifo(level) => {
            stillpoint_shm::real_time(level)?;
            Ok(None)
        }
        Priority::FifoIfAllowed(level) => Ok(stillpoint_shm::real_time_if_allowed(level).err()),
    }
}

/// The scheduling class of the main thread of a process, as the system grants it: `normal`, or `fifo N`.
pub fn scheduling(pid: u32) -> String {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    granted(&text).unwrap_or_else(|| "unknown".to_owned())
}

/// The class that `/proc/PID/stat` names. The name of the program stands in brackets, and may hold any letters.
pub fn granted(stat: &str) -> Option<String> {
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    // proc_pid_stat(5): the priority is field 40, the class field 41; the first field here is field 3.
    let number = |at: usize| fields.get(at)?.parse::<u32>().ok();
    let level = number(37)?;
    Some(match number(38)? {
        1 => format!("fifo {level}"),
        2 => format!("round robin {level}"),
        6 => "deadline".to_owned(),
        _ => "normal".to_owned(),
    })
}
