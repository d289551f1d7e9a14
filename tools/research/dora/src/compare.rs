//! Windows of dora and of stillpoint that take turns, and the ratios of their medians.

use std::error::Error;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::{Outcome, PAYLOADS};

/// Length of a window, ms.
const LENGTH: u64 = 1000;

/// Runs so many windows of each and prints the medians.
pub fn run(stillpoint: &str, dora: &str, windows: usize) -> Outcome {
    let folder = std::env::temp_dir().join(format!("dora-hop-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    // It runs in that folder.
    let dora = &std::fs::canonicalize(dora).map_err(|e| format!("{dora}: {e}"))?;
    println!("{:>10} {:>12} {:>14} {:>8}", "bytes", "dora, us", "stillpoint, us", "ratio");
    for (bytes, period) in PAYLOADS {
        let (mut theirs, mut ours, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..windows {
            let their = of_dora(dora, &folder, bytes, period)?;
            let our = of_stillpoint(stillpoint, bytes)?;
            ratios.push(their / our);
            theirs.push(their);
            ours.push(our);
        }
        println!("{bytes:>10} {:>12.1} {:>14.1} {:>8.2}", median(theirs), median(ours), median(ratios));
    }
    std::fs::remove_dir_all(folder)?;
    Ok(())
}

/// The last core that this process may use, which is where `bench hop --cores one` runs its processes.
fn core() -> Result<usize, Box<dyn Error>> {
    let set = rustix::thread::sched_getaffinity(None)?;
    (0..rustix::thread::CpuSet::MAX_CPU).rfind(|c| set.is_set(*c)).ok_or_else(|| "no core".into())
}

/// Median age in one window of dora, us.
fn of_dora(dora: &Path, folder: &Path, bytes: usize, period: u64) -> Result<f64, Box<dyn Error>> {
    let (flow, out) = (folder.join("flow.yml"), folder.join("ages.json"));
    let program = std::env::current_exe()?;
    let (program, ages) = (program.display(), out.display());
    let (core, count) = (core()?, LENGTH * 1000 / period);
    std::fs::write(
        &flow,
        format!(
            "nodes:
  - id: source
    path: {program}
    args: source
    outputs: [load]
    env: {{ HOP_CORE: {core}, HOP_BYTES: {bytes}, HOP_PERIOD_US: {period}, HOP_COUNT: {count} }}
  - id: sink
    path: {program}
    args: sink
    inputs: {{ load: {{ source: source/load, queue_size: 4 }} }}
    env: {{ HOP_CORE: {core}, HOP_OUT: \"{ages}\" }}
"
        ),
    )?;
    let _ = std::fs::remove_file(&out);
    let done = Command::new(dora).arg("run").arg(&flow).current_dir(folder).stdin(Stdio::null()).output()?;
    let reported = std::fs::read_to_string(&out).map_err(|e| {
        format!(
            "no ages ({e}): {}{}",
            String::from_utf8_lossy(&done.stdout),
            String::from_utf8_lossy(&done.stderr)
        )
    })?;
    let ages: Vec<u64> = serde_json::from_str(&reported)?;
    Ok(median(ages.iter().map(|a| *a as f64 / 1e3).collect()))
}

/// Median age in one window of stillpoint, us.
fn of_stillpoint(stillpoint: &str, bytes: usize) -> Result<f64, Box<dyn Error>> {
    let (bytes, length) = (bytes.to_string(), LENGTH.to_string());
    let fixed = ["bench", "hop", "--cores", "one", "--windows", "1", "--kind", "one", "--json", "--payload"];
    let done = Command::new(stillpoint).args(fixed).args([&bytes, "--length", &length]).output()?;
    let lines: Value = serde_json::from_slice(&done.stdout)?;
    lines[0]["whole"]["p50"].as_f64().ok_or_else(|| format!("no median in {lines}").into())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(f64::NAN)
}
