//! Limits of the user, shared memory, ports, and what dead runs left.

use std::net::UdpSocket;
use std::path::Path;

use rustix::process::{Resource, getrlimit};
use stillpoint_pipeline::graph::{Graph, Priority, Wire};
use stillpoint_pipeline::live::contracts;
use stillpoint_pipeline::live::run_folder::{self, RunState};

use super::finding::Finding;

/// Free space on the disk of sessions that is enough for some minutes.
const AMPLE: u64 = 1 << 30;
/// Free space below which a recording fails soon.
const SCARCE: u64 = 64 << 20;
/// The folder of shared memory.
const SHARED: &str = "/dev/shm";

fn mib(bytes: u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}

fn limit(value: Option<u64>) -> String {
    value.map_or("unlimited".to_owned(), |v| v.to_string())
}

/// Memory of the topics against what is free.
pub fn shared_memory(graph: &Graph) -> Finding {
    let needed: u64 = contracts::all(graph).iter().map(|c| c.pool_bytes() as u64).sum();
    let (setting, requested) = ("shared memory", format!("{} free in {SHARED}", mib(needed)));
    match rustix::fs::statvfs(SHARED) {
        Err(e) => Finding::unknown(setting, requested, e.to_string()),
        Ok(room) => {
            let free = room.f_bavail.saturating_mul(room.f_frsize);
            if free >= needed {
                Finding::good(setting, requested, format!("{} free", mib(free)))
            } else {
                let size = needed.saturating_mul(2).div_ceil(1 << 20);
                let mend = format!("mount -o remount,size={size}M {SHARED} (for good: in /etc/fstab)");
                Finding::bad(setting, requested, format!("{} free", mib(free)), mend)
            }
        }
    }
}

/// Room for sessions in a folder, which a run may create.
pub fn disk(folder: &Path) -> Finding {
    let (setting, requested) = ("disk of sessions", format!("{} free", mib(AMPLE)));
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let found = folder.ancestors().find_map(|there| rustix::fs::statvfs(there).ok());
    let Some(room) = found else {
        return Finding::unknown(setting, requested, format!("{} is not a folder", folder.display()));
    };
    let free = room.f_bavail.saturating_mul(room.f_frsize);
    let found = format!("{} free for {}", mib(free), folder.display());
    let mend = "make room, or record in another folder (`run --record FOLDER`)";
    if free >= AMPLE {
        Finding::good(setting, requested, found)
    } else if free >= SCARCE {
        Finding::bad(setting, requested, found, mend).lasting().hint()
    } else {
        Finding::bad(setting, requested, found, mend).lasting()
    }
}

/// Files that a process may have open.
pub fn open_files(graph: &Graph) -> Finding {
    let needed = 24 + 9 * contracts::all(graph).len() as u64;
    let allowed = getrlimit(Resource::Nofile).maximum;
    let (setting, requested) = ("open files", format!("at least {needed}"));
    if allowed.is_none_or(|a| a >= needed.min(1024)) {
        Finding::good(setting, requested, limit(allowed))
    } else {
        Finding::bad(
            setting,
            requested,
            limit(allowed),
            "ulimit -n 4096 (for good: LimitNOFILE of the service)",
        )
    }
}

/// The highest priority that a pipeline asks for.
pub fn asked(graph: &Graph) -> Priority {
    let all = graph.processes.iter().map(|p| p.priority);
    all.max_by_key(|p| (p.level(), matches!(p, Priority::Fifo(_)))).unwrap_or(Priority::Normal)
}

/// The real-time priority that a thread of this user is granted: it is tried.
pub fn priority(asked: Priority) -> Finding {
    let setting = "real-time priority";
    let level = asked.level().unwrap_or(1);
    let requested = match asked {
        Priority::Fifo(level) => format!("fifo {level}, as the pipeline asks"),
        Priority::FifoIfAllowed(level) => format!("fifo {level} if allowed, as the pipeline asks"),
        Priority::Normal => "none: no process asks for `priority`".to_owned(),
    };
    // The class is of the thread that asks, and ends with it. Locked memory is of this process, which ends soon.
    let tried = std::thread::scope(|scope| {
        let tries = move || match asked {
            Priority::FifoIfAllowed(level) => stillpoint_shm::real_time_if_allowed(level),
            Priority::Fifo(_) | Priority::Normal => stillpoint_shm::real_time(level),
        };
        let tries = move || tries().map_err(|e| e.to_string());
        scope.spawn(tries).join().unwrap_or_else(|_| Err("the thread that tried ended".to_owned()))
    });
    let reason = match tried {
        Ok(()) => return Finding::good(setting, requested, format!("fifo {level} is granted")),
        Err(reason) => format!("not granted: {reason}"),
    };
    let mend = format!(
        "`USER - rtprio {level}` and `USER - memlock unlimited` in /etc/security/limits.conf, then log in again"
    );
    match asked {
        Priority::Normal => Finding::good(setting, requested, reason),
        Priority::Fifo(_) => Finding::bad(setting, requested, reason, mend).lasting(),
        Priority::FifoIfAllowed(_) => Finding::bad(setting, requested, reason, mend).lasting().hint(),
    }
}

/// The scheduling class that the processes of a run are granted.
pub fn granted(run: &crate::attach::Attached) -> Vec<Finding> {
    let found = crate::processes::of_run(run.pid);
    let mut findings = Vec::new();
    for process in &run.graph.processes {
        let requested = process.priority.full();
        let Some(state) = found.iter().find(|p| p.name == process.name) else { continue };
        let setting = format!("priority of process {}", process.name);
        findings.push(if state.granted == requested {
            Finding::good(&setting, requested, state.granted.clone())
        } else {
            let mend = "`ulimit -r`, then start the run again";
            let missed = Finding::bad(&setting, requested, state.granted.clone(), mend);
            if matches!(process.priority, Priority::FifoIfAllowed(_)) { missed.hint() } else { missed }
        });
    }
    findings
}

/// The ports of the links of a pipeline.
pub fn ports(graph: &Graph) -> Vec<Finding> {
    let mut findings = Vec::new();
    for node in &graph.operators {
        let Some(Wire::Udp(address)) = node.far_end else { continue };
        let (setting, requested) = (format!("port of {}", node.name), format!("{address} is free"));
        findings.push(match UdpSocket::bind(address) {
            Ok(_) => Finding::good(&setting, requested, "free"),
            Err(e) => Finding::bad(
                &setting,
                requested,
                e.to_string(),
                "end the program that holds it (`ss -ulpn`), or choose another port in `links`",
            ),
        });
    }
    findings
}

/// What dead runs left.
pub fn leftovers() -> Finding {
    let (setting, requested) = ("leftovers of dead runs", "none");
    match run_folder::all() {
        Err(e) => Finding::unknown(setting, requested, e.to_string()),
        Ok(all) => {
            let dead: Vec<String> =
                all.into_iter().filter(|run| run.state == RunState::Dead).map(|run| run.id).collect();
            if dead.is_empty() {
                Finding::good(setting, requested, "none")
            } else {
                Finding::bad(setting, requested, dead.join(", "), "stillpoint doctor --clean")
                    .lasting()
                    .hint()
            }
        }
    }
}

/// Cores for the processes of a pipeline.
pub fn cores(graph: &Graph) -> Finding {
    let count = std::thread::available_parallelism().map_or(0, usize::from);
    let processes = graph.processes.len();
    let (setting, requested) = ("cores", format!("for {processes} processes"));
    if count == 0 {
        Finding::unknown(setting, requested, "the system does not say")
    } else if count >= processes.min(4) {
        Finding::good(setting, requested, count.to_string())
    } else {
        let mend = "group operators in `processes`, or take a machine with more cores";
        Finding::bad(setting, requested, count.to_string(), mend).lasting().hint()
    }
}
