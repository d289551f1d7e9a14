//! Wake-up latency as the tools of real-time Linux measure it, where they are installed: `cyclictest`, and `rtla`.

use std::process::Command;
use std::time::Duration;

use super::finding::Finding;

/// The share of the shortest period that a wake-up may be late at most.
const LATE: f64 = 0.5;
/// The period that counts where no operator has a timer, us.
const USUAL_US: f64 = 20_000.0;

/// A tool that measures.
struct Tool {
    name: &'static str,
    arguments: Vec<String>,
    read: fn(&str) -> Option<u64>,
}

/// Runs the tools that are installed, one after the other, each for this time. A tool that is not installed says nothing.
///
/// `asked` is the real-time priority that the pipeline asks for, `shortest` the period of its fastest timer, ns.
pub fn measure(time: Duration, asked: Option<u8>, shortest: Option<u64>) -> Vec<Finding> {
    let allowed = shortest.map_or(USUAL_US, |ns| ns as f64 * 1e-3) * LATE;
    tools(time, asked).iter().filter_map(|tool| tool.finding(allowed)).collect()
}

fn tools(time: Duration, asked: Option<u8>) -> [Tool; 2] {
    let text = |all: &[&str]| all.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>();
    // One wake-up each millisecond.
    let loops = time.as_millis().max(1).to_string();
    let mut cyclictest = text(&["-q", "-i", "1000", "-l", &loops]);
    if let Some(level) = asked {
        cyclictest.extend(text(&["-m", "-p", &level.to_string()]));
    }
    let seconds = format!("{}s", time.as_secs().max(1));
    let mut rtla = text(&["timerlat", "top", "-q", "-d", &seconds]);
    if let Some(level) = asked {
        rtla.extend(text(&["-P", &format!("f:{level}")]));
    }
    [
        Tool { name: "cyclictest", arguments: cyclictest, read: of_cyclictest },
        Tool { name: "rtla", arguments: rtla, read: of_rtla },
    ]
}

impl Tool {
    fn finding(&self, allowed_us: f64) -> Option<Finding> {
        let setting = format!("wake-up by {}", self.name);
        let requested = format!("at most {allowed_us:.0} us late");
        let done = match Command::new(self.name).args(&self.arguments).output() {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
            Err(e) => return Some(Finding::unknown(&setting, requested, e.to_string())),
            Ok(done) => done,
        };
        let Some(worst) = (self.read)(&String::from_utf8_lossy(&done.stdout)) else {
            let error = String::from_utf8_lossy(&done.stderr).into_owned();
            let error = error.lines().find(|line| !line.trim().is_empty()).unwrap_or("it printed no latency");
            return Some(Finding::unknown(&setting, requested, error.trim()));
        };
        let found = format!("worst {worst} us");
        Some(if worst as f64 <= allowed_us {
            Finding::good(&setting, requested, found)
        } else {
            let mend =
                "end other work; `core:` and `priority: fifo 50` for the process; a kernel with PREEMPT_RT";
            // One late wake-up is not a run that does not hold: the share of late ones judges.
            Finding::bad(&setting, requested, found, mend).lasting().hint()
        })
    }
}

/// The worst latency of all threads of `cyclictest`, us.
fn of_cyclictest(text: &str) -> Option<u64> {
    let threads = text.lines().filter(|line| line.starts_with("T:"));
    threads.filter_map(|line| line.split_once("Max:")?.1.split_whitespace().next()?.parse().ok()).max()
}

/// The worst latency of the threads of `rtla timerlat top`, us: the last column of the part about threads.
fn of_rtla(text: &str) -> Option<u64> {
    let of_core = |line: &str| {
        let parts: Vec<&str> = line.split('|').collect();
        let is_core = parts.first()?.split_whitespace().nth(1)?.starts_with('#');
        let worst = parts.get(2)?.split_whitespace().last()?.parse::<u64>().ok()?;
        is_core.then_some(worst)
    };
    text.lines().filter_map(of_core).max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_latency_of_cyclictest_is_that_of_its_worst_thread() {
        // The form of version 2.4.
        let text = "# /dev/cpu_dma_latency set to 0us\n\
                    T: 0 (17272) P: 0 I:1000 C:    300 Min:     76 Act:   93 Avg:  332 Max:   10500\n\
                    T: 1 (17273) P: 0 I:1500 C:    200 Min:     70 Act:   99 Avg:  101 Max:     400\n";
        assert_eq!(of_cyclictest(text), Some(10_500));
        assert_eq!(of_cyclictest("FATAL: could not access /dev/cpu_dma_latency\n"), None);
    }

    #[test]
    fn the_worst_latency_of_rtla_is_that_of_a_thread_and_not_of_the_interrupt() {
        // The columns of its manual page; not output of a run.
        let text = "                                     Timer Latency\n\
             \x20 0 00:00:12   |          IRQ Timer Latency (us)        |         Thread Timer Latency (us)\n\
             CPU COUNT      |      cur       min       avg       max |      cur       min       avg       max\n\
             \x20 1 #12322     |        0         0         1        99 |       10         3         9        31\n\
             \x20 2 #12322     |        3         0         1        10 |       23         3         9        61\n";
        assert_eq!(of_rtla(text), Some(61));
        assert_eq!(of_rtla("Failed to enable timerlat tracer\n"), None);
    }

    #[test]
    fn a_tool_that_is_not_there_says_nothing_and_one_that_fails_is_not_known() {
        let tool = |name, arguments: &[&str]| Tool {
            name,
            arguments: arguments.iter().map(|a| (*a).to_owned()).collect(),
            read: of_cyclictest,
        };
        assert_eq!(tool("no-tool-has-this-name", &[]).finding(100.0), None);
        let failed = tool("sh", &["-c", "echo 'not permitted' >&2; exit 1"]).finding(100.0).unwrap();
        assert_eq!(
            (failed.verdict, failed.found.as_str()),
            (super::super::Verdict::Unknown, "not permitted")
        );
        let late = tool("echo", &["T: 0 Max: 150"]).finding(100.0).unwrap();
        assert_eq!((late.found.as_str(), late.mend.is_empty()), ("worst 150 us", false));
    }
}
