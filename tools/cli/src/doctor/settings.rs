//! Settings of the kernel, from `/proc` and `/sys`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::finding::Finding;

/// Longest time in which a core may leave an idle state, us.
const LONGEST_EXIT: u64 = 100;
/// Share of time in which tasks wait for a core, per cent, from which on a machine is too busy.
const BUSY: f64 = 20.0;

/// The files of the kernel, below this folder.
pub struct Kernel {
    root: PathBuf,
}

impl Kernel {
    /// The files of this machine.
    pub fn here() -> Self {
        Self { root: PathBuf::from("/") }
    }

    /// Files below a folder.
    #[cfg(test)]
    pub fn below(root: &std::path::Path) -> Self {
        Self { root: root.to_owned() }
    }

    fn read(&self, path: &str) -> Option<String> {
        Some(std::fs::read_to_string(self.root.join(path)).ok()?.trim().to_owned())
    }

    /// Names in a folder, in order.
    fn list(&self, path: &str) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.root.join(path)).into_iter().flatten().flatten();
        entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect()
    }

    /// Everything, for a pipeline that binds processes to these cores, and asks for real-time priority or not.
    pub fn findings(&self, cores: &BTreeSet<usize>, is_real_time: bool) -> Vec<Finding> {
        vec![
            self.governor(),
            self.idle_states(),
            self.clock_source(),
            self.throttling(is_real_time),
            self.interrupts(cores),
            self.pressure(),
        ]
    }

    fn governor(&self) -> Finding {
        let (setting, requested) = ("frequency governor", "performance");
        let cpus = self.list("sys/devices/system/cpu");
        let governor =
            |cpu: &String| self.read(&format!("sys/devices/system/cpu/{cpu}/cpufreq/scaling_governor"));
        let found: BTreeSet<String> = cpus.iter().filter_map(governor).collect();
        let message = found.iter().cloned().collect::<Vec<_>>().join(", ");
        if found.is_empty() {
            Finding::unknown(setting, requested, "the system has no setting, as in a virtual machine")
        } else if found.iter().all(|g| g == requested) {
            Finding::good(setting, requested, message)
        } else {
            Finding::bad(setting, requested, message, "cpupower frequency-set -g performance").hint()
        }
    }

    fn idle_states(&self) -> Finding {
        let (setting, requested) =
            ("idle states of the cores", format!("at most {LONGEST_EXIT} us to leave one"));
        let folder = "sys/devices/system/cpu/cpu0/cpuidle";
        let state = |name: &String| {
            let of = |file: &str| self.read(&format!("{folder}/{name}/{file}"));
            let is_on = of("disable").is_none_or(|d| d == "0");
            Some((of("latency")?.parse::<u64>().ok()?, of("name")?)).filter(|_| is_on)
        };
        match self.list(folder).iter().filter_map(state).max() {
            None => {
                Finding::unknown(setting, requested, "the system has no setting, as in a virtual machine")
            }
            Some((latency, name)) if latency <= LONGEST_EXIT => {
                Finding::good(setting, requested, format!("{name}: {latency} us"))
            }
            Some((latency, name)) => Finding::bad(
                setting,
                requested,
                format!("{name}: {latency} us"),
                format!("cpupower idle-set -D {LONGEST_EXIT}"),
            )
            .hint(),
        }
    }

    fn clock_source(&self) -> Finding {
        let (setting, requested) = ("clock source", "one that is read without the kernel");
        let found = self.read("sys/devices/system/clocksource/clocksource0/current_clocksource");
        match found.as_deref() {
            None => Finding::unknown(setting, requested, "the system does not say"),
            Some(source @ ("tsc" | "kvm-clock" | "arch_sys_counter" | "hyperv_clocksource_tsc_page")) => {
                Finding::good(setting, requested, source)
            }
            Some(source) => {
                Finding::bad(setting, requested, source, "boot with clocksource=tsc").lasting().hint()
            }
        }
    }

    /// The kernel takes the core from real-time threads for a part of each second.
    fn throttling(&self, is_real_time: bool) -> Finding {
        let (setting, requested) = ("throttling of real-time threads", "off");
        match self.read("proc/sys/kernel/sched_rt_runtime_us") {
            None => Finding::unknown(setting, requested, "the system does not say"),
            Some(value) if value == "-1" => Finding::good(setting, requested, "off"),
            Some(value) => {
                let found = Finding::bad(
                    setting,
                    requested,
                    format!("{value} us of each period"),
                    "sysctl -w kernel.sched_rt_runtime_us=-1 (for good: a file in /etc/sysctl.d)",
                );
                // It matters only where a thread never rests.
                if is_real_time { found.hint() } else { Finding::good(setting, "any", value) }
            }
        }
    }

    fn interrupts(&self, cores: &BTreeSet<usize>) -> Finding {
        let setting = "interrupts on the cores of the pipeline";
        if cores.is_empty() {
            return Finding::good(setting, "any", "no process is bound to a core");
        }
        let irqs = self.list("proc/irq");
        let all: Vec<(String, BTreeSet<usize>)> = irqs
            .into_iter()
            .filter_map(|irq| {
                let list = self.read(&format!("proc/irq/{irq}/effective_affinity_list"))?;
                Some((irq, cores_of(&list)))
            })
            .collect();
        if all.is_empty() {
            return Finding::unknown(setting, "none", "the system does not say");
        }
        let there: Vec<&str> =
            all.iter().filter(|(_, on)| !on.is_disjoint(cores)).map(|(irq, _)| irq.as_str()).collect();
        match there.as_slice() {
            [] => Finding::good(setting, "none", "none"),
            some => Finding::bad(
                setting,
                "none",
                format!("{} of {}: {}", some.len(), all.len(), some[..some.len().min(8)].join(", ")),
                "write other cores to /proc/irq/N/smp_affinity_list, and stop irqbalance",
            )
            .hint(),
        }
    }

    fn pressure(&self) -> Finding {
        let (setting, requested) =
            ("other work on the cores", format!("tasks wait for a core in at most {BUSY} % of the time"));
        let text = self.read("proc/pressure/cpu");
        let share = text.as_deref().and_then(|text| {
            let some = text.lines().find(|line| line.starts_with("some"))?;
            some.split_whitespace().find_map(|word| word.strip_prefix("avg10="))?.parse::<f64>().ok()
        });
        match share {
            None => match self.read("proc/loadavg") {
                Some(load) => Finding::unknown(setting, requested, format!("load {load}")),
                None => Finding::unknown(setting, requested, "the system does not say"),
            },
            Some(share) if share <= BUSY => Finding::good(setting, requested, format!("{share} %")),
            Some(share) => {
                Finding::bad(setting, requested, format!("{share} %"), "end other work, or take more cores")
            }
        }
    }
}

/// The cores of a list such as `0-2,5`.
pub fn cores_of(list: &str) -> BTreeSet<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse::<usize>().ok()?..=last.trim().parse::<usize>().ok()?.min(4096))
    };
    list.split(',').filter_map(range).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    /// A folder with these files.
    fn kernel(files: &[(&str, &str)]) -> (tempfile::TempDir, Kernel) {
        let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
        for (name, text) in files {
            let path = folder.path().join(name);
            let made = std::fs::create_dir_all(path.parent().unwrap_or(std::path::Path::new("/")))
                .and_then(|()| std::fs::write(&path, text));
            made.unwrap_or_else(|e| panic!("{name}: {e}"));
        }
        let kernel = Kernel::below(folder.path());
        (folder, kernel)
    }

    fn verdict(kernel: &Kernel, cores: &[usize], is_real_time: bool, setting: &str) -> (Verdict, String) {
        let all = kernel.findings(&cores.iter().copied().collect(), is_real_time);
        let found = all.iter().find(|f| f.setting == setting).unwrap_or_else(|| panic!("{setting}"));
        (found.verdict, found.found.clone())
    }

    #[test]
    fn each_setting_is_judged_by_what_its_file_says() {
        let cpu = "sys/devices/system/cpu";
        let (_folder, kernel) = kernel(&[
            (&format!("{cpu}/cpu0/cpufreq/scaling_governor"), "powersave\n"),
            (&format!("{cpu}/cpu1/cpufreq/scaling_governor"), "performance\n"),
            (&format!("{cpu}/cpu0/cpuidle/state0/latency"), "2"),
            (&format!("{cpu}/cpu0/cpuidle/state0/name"), "C1"),
            (&format!("{cpu}/cpu0/cpuidle/state1/latency"), "890"),
            (&format!("{cpu}/cpu0/cpuidle/state1/name"), "C10"),
            (&format!("{cpu}/cpu0/cpuidle/state1/disable"), "1"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet"),
            ("proc/sys/kernel/sched_rt_runtime_us", "950000"),
            ("proc/irq/17/effective_affinity_list", "0-1"),
            ("proc/irq/18/effective_affinity_list", "3"),
            ("proc/pressure/cpu", "some avg10=41.50 avg60=3.00 avg300=1.00 total=1\nfull avg10=0.00"),
        ]);
        assert_eq!(
            verdict(&kernel, &[], true, "frequency governor"),
            (Verdict::Unknown, "performance, powersave".into())
        );
        // The deep state is switched off.
        assert_eq!(
            verdict(&kernel, &[], true, "idle states of the cores"),
            (Verdict::Good, "C1: 2 us".into())
        );
        assert_eq!(verdict(&kernel, &[], true, "clock source").0, Verdict::Unknown);
        assert_eq!(verdict(&kernel, &[], true, "throttling of real-time threads").0, Verdict::Unknown);
        assert_eq!(verdict(&kernel, &[], false, "throttling of real-time threads").0, Verdict::Good);
        let irqs = "interrupts on the cores of the pipeline";
        assert_eq!(verdict(&kernel, &[1], true, irqs), (Verdict::Unknown, "1 of 2: 17".into()));
        assert_eq!(verdict(&kernel, &[2], true, irqs).0, Verdict::Good);
        assert_eq!(verdict(&kernel, &[], true, "other work on the cores"), (Verdict::Bad, "41.5 %".into()));
    }

    #[test]
    fn what_the_system_does_not_say_is_not_judged() {
        let (_folder, kernel) = kernel(&[]);
        let all = kernel.findings(&BTreeSet::from([0]), true);
        assert!(all.iter().all(|f| f.verdict == Verdict::Unknown), "{all:?}");
        assert_eq!(cores_of("0-2,5, 7"), BTreeSet::from([0, 1, 2, 5, 7]));
        assert_eq!(cores_of("-,x"), BTreeSet::new());
    }
}
