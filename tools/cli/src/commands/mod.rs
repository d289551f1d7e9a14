//! The subcommands: one file or folder each, with its arguments and its `execute`.

mod bench;
mod bladder;
pub(crate) mod bridge;
mod calibrate;
mod case;
mod check;
mod delivered;
mod diff;
mod doctor;
mod dose;
mod echo;
mod export;
mod graph;
mod hz;
mod identify;
mod info;
mod log;
mod machine;
mod manual;
mod merge;
mod new;
mod operators;
mod plan;
mod ps;
mod qa;
mod reach;
mod recover;
pub mod replay;
mod report;
mod restart;
mod rig;
pub mod run;
mod schema;
pub mod send;
mod set;
mod stop;
mod sweep;
mod top;
mod topics;
mod trace;
mod train;
mod types;
mod view;
mod what_if;

use clap::Subcommand;
use stillpoint_operator::Registry;

use crate::exit::Ended;

/// A subcommand with its arguments.
#[derive(Subcommand)]
pub enum Command {
    /// Run a pipeline and record it.
    Run(run::Run),
    /// Run the far end of a pipeline as a separate program.
    Rig(rig::Rig),
    /// Check a pipeline and show all its faults.
    Check(check::Check),
    /// Make a folder with a commented pipeline of your own that checks and runs.
    New(new::New),
    /// Replay a session from its journals and compare every recorded topic byte by byte, or with a change.
    Replay(replay::Replay),
    /// Compare two sessions: what differs first, by how much, and how it goes on.
    Diff(diff::Diff),
    /// Write topics of a session as CSV tables or as a smaller MCAP recording, or one sample as PLY, PCD or PNG.
    Export(export::Export),
    /// Show the contents of a session and whether it is complete.
    Info(info::Info),
    /// Write a report of a session: tracks, pictures, rates, latencies, ledger, faults, provenance.
    Report(report::Report),
    /// Join the sessions of the hosts of one run on the time axis of the first session.
    Merge(merge::Merge),
    /// Repair a session whose recorder was cut off.
    Recover(recover::Recover),
    /// List the kinds of operators, or describe one.
    Operators(operators::Operators),
    /// Print the JSON Schema of pipeline files.
    Schema(schema::Schema),
    /// Write completions for shells, man pages, or the reference page of the command.
    Manual(manual::Manual),
    /// Print a map of the targets that a rig can hold.
    Reach(reach::Reach),
    /// Print the pressure of a bladder against its stretch.
    Bladder(bladder::Bladder),
    /// Send a command to a running pipeline.
    Send(send::Send),
    /// Change a live parameter of a running pipeline, or list them.
    Set(set::Set),
    /// Restart one operator of a running pipeline.
    Restart(restart::Restart),
    /// Fit a model to the recorded input and output of a system.
    Identify(identify::Identify),
    /// Print the command that trains the network of a controller, or the prior of beams.
    Train(train::Train),
    /// Print the samples of a topic of a running pipeline or a session.
    Echo(echo::Echo),
    /// List the runs of this machine.
    Ps(ps::Ps),
    /// Show what a pipeline does: operators, edges, processes, how the head is held, and what is wrong.
    Top(top::Top),
    /// Show the state of a run or a session in a browser, on this machine alone.
    View(view::View),
    /// List the topics of a running pipeline or a session: type, rate, size, consumers.
    Topics(topics::Topics),
    /// Measure the rates of topics and their jitter, of a running pipeline or a session.
    Hz(hz::Hz),
    /// Measure how long samples take from a source to a sink, and which operator is to blame for the longest.
    Trace(trace::TracePaths),
    /// Draw a pipeline, a run or a session: operators, processes, topics, and what was measured.
    Graph(graph::Graph),
    /// Print the log of a run or a session by operator and level.
    Log(log::Log),
    /// Measure whether this machine will hold a pipeline.
    Doctor(doctor::Doctor),
    /// End a run in order, as Ctrl-C does.
    Stop(stop::Stop),
    /// Place a depth camera over the couch, and check its depth, from recorded images.
    Calibrate(calibrate::Calibrate),
    /// Check a system by a phantom of known motion, and find what its valves and bladders are.
    Qa(qa::Qa),
    /// List the types of samples, or describe one.
    Types(types::Types),
    /// Import, generate and show the patients of plans.
    Case(case::Case),
    /// Choose the beams of a case and optimise their fluence.
    Plan(Box<plan::Plan>),
    /// Compare the dose of a machine with that of a Monte Carlo program.
    Dose(dose::Dose),
    /// Fit the machine file of a beam to doses measured in a water tank.
    Machine(machine::Machine),
    /// Compute the dose that the patient of a session got from a plan.
    Delivered(Box<delivered::Delivered>),
    /// Compute calls of plans for other hosts (by stillpoint-bridge).
    Worker(stillpoint_arguments::Worker),
    /// List the workers of a planning pool (by stillpoint-bridge).
    Pool(stillpoint_arguments::Pool),
    /// Pass on messages between hosts (by stillpoint-bridge).
    Router(stillpoint_arguments::Router),
    /// Make the certificates of hosts, workers and routers (by stillpoint-bridge).
    Pki(stillpoint_arguments::Pki),
    /// Measure the speed and accuracy of this build on this machine.
    Bench(bench::Bench),
}

impl Command {
    /// Executes the subcommand with these kinds of operators.
    pub fn execute(self, registry: &Registry) -> Ended {
        match self {
            Self::Run(c) => c.execute(registry),
            Self::Rig(c) => c.execute(registry),
            Self::Check(c) => c.execute(registry),
            Self::New(c) => c.execute(registry),
            Self::Replay(c) => c.execute(registry),
            Self::Diff(c) => c.execute(registry),
            Self::Export(c) => c.execute(),
            Self::Info(c) => c.execute(registry),
            Self::Report(c) => c.execute(registry),
            Self::Merge(c) => c.execute(registry),
            Self::Recover(c) => c.execute(),
            Self::Operators(c) => c.execute(registry),
            Self::Schema(c) => c.execute(registry),
            Self::Manual(c) => c.execute(),
            Self::Reach(c) => c.execute(),
            Self::Bladder(c) => c.execute(),
            Self::Send(c) => c.execute(registry),
            Self::Set(c) => c.execute(registry),
            Self::Restart(c) => c.execute(registry),
            Self::Identify(c) => c.execute(),
            Self::Train(c) => c.execute(),
            Self::Echo(c) => c.execute(registry),
            Self::Ps(c) => c.execute(),
            Self::Topics(c) => c.execute(registry),
            Self::Hz(c) => c.execute(registry),
            Self::Trace(c) => c.execute(registry),
            Self::Graph(c) => c.execute(registry),
            Self::Top(c) => c.execute(registry),
            Self::Log(c) => c.execute(),
            Self::Doctor(c) => c.execute(registry),
            Self::View(c) => c.execute(registry),
            Self::Stop(c) => c.execute(),
            Self::Types(c) => c.execute(registry),
            Self::Case(c) => c.execute(),
            Self::Plan(c) => c.execute(),
            Self::Dose(c) => c.execute(),
            Self::Machine(c) => c.execute(),
            Self::Calibrate(c) => c.execute(),
            Self::Qa(c) => c.execute(registry),
            Self::Delivered(c) => c.execute(registry),
            Self::Worker(_) | Self::Pool(_) | Self::Router(_) | Self::Pki(_) => bridge::hand_over(),
            Self::Bench(c) => c.execute(),
        }
    }
}
