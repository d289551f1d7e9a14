//! The processes of a run as the system sees them: CPU time, memory, scheduling.

use std::path::Path;

use serde::Serialize;
use stillpoint_pipeline::live::granted;

/// A process of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ProcessState {
    /// Its name in the pipeline; `recorder` and the like for the others.
    pub name: String,
    /// Number of the process.
    pub pid: u32,
    /// Whether a signal has stopped it.
    pub suspended: bool,
    /// CPU time of its threads since it began, s.
    pub cpu_s: Option<f64>,
    /// Time for which its first thread was ready and got no core, s.
    pub delayed_s: Option<f64>,
    /// Memory that it holds, shared memory included.
    pub memory_bytes: u64,
    /// The scheduling class that the system grants it: `normal`, or `fifo N`.
    pub granted: String,
    /// The cores on which it may run.
    pub cores: String,
}

/// The children of a supervisor, by name.
pub fn of_run(supervisor: u32) -> Vec<ProcessState> {
    let Ok(entries) = std::fs::read_dir("/proc") else { return Vec::new() };
    let pids = entries.flatten().filter_map(|e| e.file_name().to_string_lossy().parse::<u32>().ok());
    let mut found: Vec<ProcessState> = pids.filter_map(|pid| of_child(pid, supervisor)).collect();
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

fn of_child(pid: u32, supervisor: u32) -> Option<ProcessState> {
    let folder = Path::new("/proc").join(pid.to_string());
    let stat = Stat::of(&std::fs::read_to_string(folder.join("stat")).ok()?)?;
    if stat.parent != supervisor {
        return None;
    }
    // The program, its role, and the name.
    let command = std::fs::read(folder.join("cmdline")).ok()?;
    let name = command.split(|b| *b == 0).nth(2).filter(|name| !name.is_empty())?;
    let status = std::fs::read_to_string(folder.join("status")).unwrap_or_default();
    let field = |name: &str| status.lines().find_map(|l| l.strip_prefix(name)).map(str::trim);
    let memory = field("VmRSS:").and_then(|v| v.split_whitespace().next()?.parse::<u64>().ok());
    let (cpu, delayed) = scheduled(&folder);
    Some(ProcessState {
        name: String::from_utf8_lossy(name).into_owned(),
        pid,
        suspended: stat.state == 'T',
        cpu_s: cpu,
        delayed_s: delayed,
        memory_bytes: memory.unwrap_or(0) * 1024,
        granted: stat.granted,
        cores: field("Cpus_allowed_list:").unwrap_or("").to_owned(),
    })
}

/// CPU time of all threads, and time without a core of the first, which does the work, s; none where the system does not
/// count them.
fn scheduled(folder: &Path) -> (Option<f64>, Option<f64>) {
    let numbers = |folder: &Path| {
        let text = std::fs::read_to_string(folder.join("schedstat")).ok()?;
        let mut numbers = text.split_whitespace().map_while(|n| n.parse::<u64>().ok());
        Some((numbers.next()? as f64 * 1e-9, numbers.next()? as f64 * 1e-9))
    };
    let tasks = std::fs::read_dir(folder.join("task")).into_iter().flatten().flatten();
    let all: Vec<f64> = tasks.filter_map(|task| Some(numbers(&task.path())?.0)).collect();
    ((!all.is_empty()).then(|| all.iter().sum()), numbers(folder).map(|(_, delayed)| delayed))
}

/// What `/proc/PID/stat` says.
#[derive(Debug, PartialEq)]
struct Stat {
    state: char,
    parent: u32,
    granted: String,
}

impl Stat {
    fn of(text: &str) -> Option<Self> {
        // The name of the program stands in brackets, and may hold any letters.
        let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
        // proc_pid_stat(5): the state is field 3, the parent field 4.
        let parent = fields.get(1)?.parse().ok()?;
        Some(Self { state: fields.first()?.chars().next()?, parent, granted: granted(text)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_read_whatever_its_program_is_called() {
        let rest =
            "S 42 7 7 0 -1 0 1 2 3 4 5 6 7 8 20 0 1 0 100 200 300 1 2 3 4 5 6 7 8 9 10 11 12 13 17 1 50 1 0";
        let stat = Stat::of(&format!("7 (a) b (c) {rest}")).unwrap_or_else(|| panic!("it is read"));
        assert_eq!(stat, Stat { state: 'S', parent: 42, granted: "fifo 50".into() });
        assert_eq!(Stat::of("7 (x"), None);
    }

    #[test]
    fn the_children_of_this_process_are_found_with_their_names() {
        let sleep = "/bin/sleep";
        let mut child = std::process::Command::new(sleep)
            .arg("60")
            .arg("1")
            .spawn()
            .unwrap_or_else(|e| panic!("{sleep}: {e}"));
        // A child is there from its start; its command line follows with its program.
        let found = loop {
            if let Some(found) = of_run(std::process::id()).into_iter().find(|p| p.name == "1") {
                break found;
            }
            std::thread::yield_now();
        };
        assert_eq!((found.pid, found.suspended, found.granted.as_str()), (child.id(), false, "normal"));
        assert!(!found.cores.is_empty());
        let _ = child.kill();
        let _ = child.wait();
    }
}
