//! A plan whose workers are behind a network of their own, which is cut for a while.
//!
//! Two network namespaces stand for two hosts, and a veth pair for the cable. Where the kernel or the system does not
//! allow that, the test says so and skips.

use std::process::{Child, Command, Stdio};

use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Arrival, Build, ClientSettings, Courier, CourierError, Message, Pool, To};

use crate::bench::wait_for;
use crate::pool::Ends;
use crate::water::{Water, alone, pooled};

const BEDSIDE: &str = "10.213.7.1/24";
const CLUSTER: &str = "10.213.7.2/24";
const ENDPOINT: &str = "tcp/10.213.7.2:7447";
/// Answers after which the cable is pulled.
const ANSWERS: usize = 10;
/// How long it is out, ns.
const CUT: u64 = 10_000_000_000;

/// A network of its own, held by a process that waits.
struct Namespace(Ends);

impl Namespace {
    /// Held by this command, which runs `cat` in it.
    fn held_by(mut command: Command) -> Option<Self> {
        let here = std::fs::read_link("/proc/self/ns/net").ok()?;
        let child = command.arg("cat").stdin(Stdio::piped()).stdout(Stdio::null()).spawn().ok()?;
        let mut held = Ends(child);
        let is_there = wait_for("a network namespace", || {
            if held.0.try_wait().unwrap().is_some() {
                return Some(false);
            }
            let name = std::fs::read_to_string(format!("/proc/{}/comm", held.0.id())).ok()?;
            let there = std::fs::read_link(format!("/proc/{}/ns/net", held.0.id())).ok()?;
            (name.trim() == "cat" && there != here).then_some(true)
        });
        is_there.then_some(Self(held))
    }

    fn number(&self) -> String {
        self.0.0.id().to_string()
    }

    /// A command within.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["-t", &self.number(), "-U", "-n", "--preserve-credentials", "--", program]);
        command
    }

    fn ip(&self, arguments: &str) -> bool {
        let status = self.command("ip").args(arguments.split(' ')).status();
        status.is_ok_and(|status| status.success())
    }

    fn bridge(&self, arguments: &[&str]) -> Command {
        let mut command = self.command(env!("CARGO_BIN_EXE_stillpoint-bridge"));
        command.args(arguments);
        command
    }
}

/// Bedside and cluster with a cable between them.
fn two_hosts() -> Option<(Namespace, Namespace)> {
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--net", "--"]);
    let bedside = Namespace::held_by(command)?;
    let mut command = bedside.command("unshare");
    command.args(["--net", "--"]);
    let cluster = Namespace::held_by(command)?;
    let is_up = bedside.ip(&format!("link add cable type veth peer name cable netns {}", cluster.number()))
        && [(&bedside, BEDSIDE), (&cluster, CLUSTER)].iter().all(|(host, address)| {
            host.ip(&format!("address add {address} dev cable"))
                && host.ip("link set cable up")
                && host.ip("link set lo up")
        });
    is_up.then_some((bedside, cluster))
}

/// Carries messages, and pulls the cable for a while.
struct Cutting<'a> {
    courier: ChildCourier,
    bedside: &'a Namespace,
    answers: usize,
    cut: Option<u64>,
    is_whole: bool,
}

impl Courier for Cutting<'_> {
    fn now(&self) -> u64 {
        self.courier.now()
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        self.courier.send(to, bytes);
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        if self.cut.is_some_and(|cut| !self.is_whole && self.now() - cut >= CUT) {
            assert!(self.bedside.ip("link set cable up"));
            self.is_whole = true;
        }
        let arrival = self.courier.receive(until)?;
        let message = arrival.as_ref().and_then(|arrival| Message::from_bytes(&arrival.bytes).ok());
        if matches!(message, Some(Message::Answer { .. } | Message::Done { .. })) {
            self.answers += 1;
        }
        if self.answers >= ANSWERS && self.cut.is_none() {
            assert!(self.bedside.ip("link set cable down"));
            self.cut = Some(self.now());
        }
        Ok(arrival)
    }
}

#[test]
fn a_plan_is_the_same_when_the_network_to_its_workers_is_cut_for_ten_seconds() {
    let Some((bedside, cluster)) = two_hosts() else {
        return eprintln!("skipped: network namespaces or veth are not to be had here");
    };
    let water = Water::new();
    let expected = alone(&water);
    let folder = tempfile::tempdir().unwrap();
    let worker = |name: &str, place: &str| -> Ends {
        let mut command = cluster.bridge(&["worker", place, ENDPOINT, "--name", name, "--slots", "1"]);
        let child: Child =
            command.arg("--cache").arg(folder.path().join(name)).stdout(Stdio::null()).spawn().unwrap();
        Ends(child)
    };
    let _workers = [worker("one", "--listen"), worker("two", "--connect")];
    let courier = ChildCourier::start(bedside.bridge(&["plan-client", "--connect", ENDPOINT])).unwrap();
    let cutting = Cutting { courier, bedside: &bedside, answers: 0, cut: None, is_whole: false };
    let mut pool = Pool::new(cutting, ClientSettings::new(Build::here().unwrap()));
    assert!(pooled(&water, &mut pool) == expected);
    let (tally, cutting) = (pool.tally(), pool.courier());
    assert!(cutting.is_whole, "the plan ended before the network was whole again");
    assert!(cutting.answers > ANSWERS, "{} answers", cutting.answers);
    // Nothing but what is compared is computed here: the cut is shorter than the patience.
    assert!(tally.local <= tally.compared, "{tally:?}");
}
