//! The body of the bridge's process.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::os::fd::OwnedFd;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{EventfdFlags, eventfd};
use stillpoint_shm::{Domain, Wake};

use super::accounts::BridgeReport;
use super::edges::{Incoming, Outgoing};
use super::hello::HelloBridge;
use super::network::{BridgeSettings, Network};
use crate::clock::realtime;
use crate::hosts::BRIDGE;
use crate::limits::start_thread;
use crate::live::affinity::keep_off;
use crate::live::control::{Connect, FromWorker, ToWorker};
use crate::live::error::WorkerError;
use crate::live::pipe::{PipeError, PipeRead, PipeReader, orders, send_message, take_control, wait_for};
use crate::live::run_folder::hold;
use crate::live::worker::{end_with_supervisor, ignore_interrupts};

/// How often the counts are told, and what happened on the network.
const REPORTED: Duration = Duration::from_millis(100);
/// How long the end of a run waits until the other hosts have said what they have.
const SETTLING: Duration = Duration::from_secs(2);

/// The body of the bridge's process. Orders come on standard input; their end is the supervisor's end, and this one's.
/// `open` opens the network, or says why it cannot.
pub fn bridge_main<E: Display>(open: impl FnOnce(BridgeSettings) -> Result<Box<dyn Network>, E>) -> ExitCode {
    if take_control().is_err() {
        return ExitCode::from(70);
    }
    ignore_interrupts();
    match serve(open) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let (operator, reason) = (BRIDGE.to_owned(), error.to_string());
            let _ = send_message(&FromWorker::Fault { operator, incarnation: 0, reason, fatal: true });
            ExitCode::from(70)
        }
    }
}

fn serve<E: Display>(
    open: impl FnOnce(BridgeSettings) -> Result<Box<dyn Network>, E>,
) -> Result<(), WorkerError> {
    let mut orders = orders()?;
    let Some(hello) = wait_for::<HelloBridge>(&mut orders)? else { return Ok(()) };
    start_thread(|| end_with_supervisor(0))?;
    keep_off(&hello.real_time_cores);
    let _held = hold(&hello.root)?;
    let domain = Domain::join(&hello.root, &hello.prefix, BRIDGE)?;
    let bell = Arc::new(
        eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)
            .map_err(|e| WorkerError::Network(e.to_string()))?,
    );
    let ring = bell.clone();
    let network = open(BridgeSettings {
        host: hello.host.clone(),
        ros2: hello.ros2.clone(),
        pools: hello.pools.clone(),
        identity: hello.identity.clone(),
        incarnation: realtime(),
        clock: hello.clock,
        // A bell that cannot be rung has been rung often enough.
        arrived: Arc::new(move || {
            let _ = rustix::io::write(&*ring, &1_u64.to_ne_bytes());
        }),
    })
    .map_err(|e| WorkerError::Network(e.to_string()))?;
    let mut listeners = Vec::new();
    let leaves = hello.leaves.iter().map(|l| Outgoing::open(l, &domain, &*network, &mut listeners));
    let leaves = leaves.collect::<Result<_, _>>()?;
    let arrives = hello.arrives.iter().map(|a| Incoming::open(a, &domain, &*network));
    let arrives = arrives.collect::<Result<_, _>>()?;
    let control = orders.fd().try_clone_to_owned().map_err(PipeError::Input)?;
    let watched = bell.try_clone().map_err(PipeError::Input)?;
    let wake = Wake::new(control, listeners).watching(watched);
    let mut bridge = Bridge {
        leaves,
        arrives,
        network,
        wake,
        bell,
        reported: BTreeSet::new(),
        running: false,
        stopping: None,
        stopped: false,
    };
    send_message(&FromWorker::Made)?;
    bridge.serve(&mut orders)
}

struct Bridge {
    // The ends of the edges go before the network.
    leaves: Vec<Outgoing>,
    arrives: Vec<Incoming>,
    network: Box<dyn Network>,
    wake: Wake,
    /// Rung when a sample has arrived.
    bell: Arc<OwnedFd>,
    running: bool,
    /// The faults that were told since something good happened.
    reported: BTreeSet<String>,
    /// Since when it is to stop.
    stopping: Option<Instant>,
    stopped: bool,
}

impl Bridge {
    fn serve(&mut self, orders: &mut PipeReader) -> Result<(), WorkerError> {
        let mut reported = Instant::now();
        loop {
            loop {
                match orders.next()? {
                    PipeRead::Message(ToWorker::Exit) | PipeRead::Ended => return Ok(()),
                    PipeRead::Message(order) => self.obey(&order)?,
                    PipeRead::Nothing => break,
                }
            }
            let worked = self.running && self.pass()?;
            if reported.elapsed() >= REPORTED {
                reported = Instant::now();
                self.send_news()?;
                if let Some(reason) =
                    self.network.renewal().filter(|_| self.running && self.stopping.is_none())
                {
                    return Err(WorkerError::Network(reason));
                }
            }
            if let Some(since) = self.stopping
                && !worked
                && !self.stopped
            {
                let settled = self.leaves.iter().all(|l| l.is_settled(&*self.network));
                if settled || since.elapsed() >= SETTLING {
                    self.stopped = true;
                    self.send_news()?;
                    send_message(&FromWorker::Stopped)?;
                }
            }
            if worked || self.wake.drain()? {
                continue;
            }
            let patience = if self.stopping.is_some() && !self.stopped { REPORTED / 10 } else { REPORTED };
            self.wake.wait(Some(patience.as_nanos() as u64))?;
            // Whatever rings from here on is for the next wait.
            let _ = rustix::io::read(&*self.bell, &mut [0; 8]);
        }
    }

    fn obey(&mut self, order: &ToWorker) -> Result<(), WorkerError> {
        match order {
            ToWorker::Connect(Connect { number }) => {
                self.leaves.iter().try_for_each(Outgoing::connect)?;
                self.arrives.iter().try_for_each(Incoming::connect)?;
                Ok(send_message(&FromWorker::Connected { number: *number })?)
            }
            ToWorker::Go { .. } => {
                self.running = true;
                Ok(())
            }
            ToWorker::Stop => {
                self.stopping = Some(Instant::now());
                Ok(())
            }
            other => Err(WorkerError::NotDirected(format!("{other:?}"))),
        }
    }

    /// Carries what waits, in both directions. Gives whether there was anything.
    fn pass(&mut self) -> Result<bool, WorkerError> {
        let mut worked = false;
        for leaving in &mut self.leaves {
            worked |= leaving.pass_on()?;
        }
        // What arrives after the stop has no operator any more that would take it.
        if self.stopping.is_none() {
            for arriving in &mut self.arrives {
                worked |= arriving.hand_over(&*self.network)?;
            }
        }
        Ok(worked)
    }

    fn send_news(&mut self) -> Result<(), PipeError> {
        let mut faults = Vec::new();
        for event in self.network.events() {
            if event.is_fault {
                faults.push(event.text);
            } else {
                self.reported.clear();
                send_message(&FromWorker::Reported(event.text))?;
            }
        }
        faults.extend(self.leaves.iter_mut().filter_map(Outgoing::refusal));
        faults.extend(self.arrives.iter_mut().filter_map(Incoming::refusal));
        for reason in faults {
            // What keeps a host out keeps each of its edges out.
            if self.reported.insert(reason.clone()) {
                fault(reason)?;
            }
        }
        let network = &*self.network;
        send_message(&FromWorker::Bridged(BridgeReport {
            leaves: self.leaves.iter().map(|l| l.counts(network)).collect(),
            arrives: self.arrives.iter().map(|a| a.counts(network)).collect(),
            is_last: self.stopped,
        }))
    }
}

fn fault(reason: String) -> Result<(), PipeError> {
    send_message(&FromWorker::Fault { operator: BRIDGE.to_owned(), incarnation: 0, reason, fatal: false })
}
