//! The two nodes: one writes a payload behind the time just before it, the other tells how old it was.

use std::error::Error;
use std::time::Duration;

use dora_node_api::{DoraNode, Event, MetadataParameters};
use rustix::thread::{CpuSet, sched_setaffinity};
use rustix::time::{ClockId, clock_gettime};

use crate::Outcome;

/// Times from the first payloads are not counted: connections are still made.
const WARM: usize = 20;

/// The machine's monotonic clock, ns.
fn now() -> u64 {
    let t = clock_gettime(ClockId::Monotonic);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

fn setting(name: &str) -> Result<u64, Box<dyn Error>> {
    Ok(std::env::var(name).map_err(|e| format!("{name}: {e}"))?.parse()?)
}

/// Binds this thread, and those it starts from now on, to the window's core.
fn bind() -> Outcome {
    let mut set = CpuSet::new();
    set.set(setting("HOP_CORE")? as usize);
    Ok(sched_setaffinity(None, &set)?)
}

pub fn source() -> Outcome {
    bind()?;
    let (mut node, events) = DoraNode::init_from_env()?;
    let (size, count) = (setting("HOP_BYTES")? as usize, setting("HOP_COUNT")?);
    let period = Duration::from_micros(setting("HOP_PERIOD_US")?);
    let payload: Vec<u8> = (0..size).map(|i| (i / 3) as u8).collect();
    std::thread::sleep(Duration::from_millis(500));
    for _ in 0..count + WARM as u64 {
        std::thread::sleep(period);
        let before = now();
        node.send_output_raw("load".to_owned().into(), MetadataParameters::default(), size, |out| {
            out.copy_from_slice(&payload);
            out[..8].copy_from_slice(&before.to_le_bytes());
        })?;
    }
    drop(events);
    Ok(())
}

pub fn sink() -> Outcome {
    bind()?;
    let (node, mut events) = DoraNode::init_from_env()?;
    let mut ages = Vec::new();
    while let Some(event) = events.recv() {
        match event {
            Event::Input { data, .. } => {
                let after = now();
                let bytes: &[u8] = (&data).try_into()?;
                let before = bytes.first_chunk().ok_or("the payload is too short")?;
                ages.push(after.saturating_sub(u64::from_le_bytes(*before)));
            }
            Event::InputClosed { .. } | Event::Stop(_) => break,
            _ => {}
        }
    }
    drop(node);
    ages.drain(..WARM.min(ages.len()));
    std::fs::write(std::env::var("HOP_OUT")?, serde_json::to_string(&ages)?)?;
    Ok(())
}
