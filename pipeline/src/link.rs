//! The far end of a link that carries datagrams.

use std::collections::BTreeMap;
use std::net::IpAddr;

use stillpoint_samples::{Datagram, Diagnostics, Metric, Sample};

use crate::activation::Activation;
use crate::operator::Setup;
use crate::operator::{
    FrameRule, Input, Kind, Operator, Output, Policy, Role, SetupError, Stage, StepError, Timer,
};
use crate::outputs::Outputs;
use crate::outside::Arrivals;

/// Name of the kind.
pub const KIND_NAME: &str = "link.udp";
/// How often the far end looks for datagrams, ns.
pub const EVERY: u64 = 1_000_000;
/// Counts of refused datagrams are told this far apart at the closest, ns.
const REPORT_EVERY: u64 = 100_000_000;
/// Datagrams that wait for the far end in a simulated run.
pub const WAITING: u32 = 64;
/// The longest datagram that is taken.
pub const LONGEST: usize = stillpoint_transport::Datagrams::LONGEST;

const DATAGRAM: usize = 0;
const DIAGNOSTICS: usize = 1;
/// Addresses of which it says how many datagrams were too many.
const ADDRESSES: usize = 4;
const METRICS: usize = 4 + ADDRESSES;

/// Sends on what came over the wire in a live run; in any other run, what its input brings.
///
/// It is a source: replay cannot make a datagram again, so a session keeps it.
pub struct Link {
    arrivals: Option<Arrivals>,
    too_long: u64,
    dropped: u64,
    foreign: u64,
    /// How many came from each address above what one may send.
    above: BTreeMap<IpAddr, u64>,
    /// How many datagrams were refused when it was last said, and when that was, ns.
    reported: (u64, u64),
}

impl Operator for Link {
    type Params = ();
    const KIND: Kind = Kind {
        name: KIND_NAME,
        about: "The far end of a link: datagrams as they arrive. The section `links` creates it.",
        role: Role::Source,
        inputs: &[Input {
            name: "datagram",
            sample: Datagram::KIND,
            policy: Policy::Queue(WAITING),
            required: true,
            about: "The samples to send over the link.",
        }],
        outputs: &[
            Output {
                name: "datagram",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "The datagrams that arrived, from any sender.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Counts of datagrams that were dropped, when there are new ones: too long, too many at once, foreign (not of the form that the link's sender gives them), and too many from an address.",
            },
        ],
        timer: Timer::Required,
    };

    fn new((): (), setup: &Setup<'_>) -> Result<Self, SetupError> {
        let arrivals = setup.outside.arrivals.clone();
        Ok(Self { arrivals, too_long: 0, dropped: 0, foreign: 0, above: BTreeMap::new(), reported: (0, 0) })
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![LONGEST, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(arrivals) = &self.arrivals else {
            if let Some(view) = activation.fresh::<Datagram>(DATAGRAM) {
                outputs.send_slice::<Datagram>(DATAGRAM, &(), view.elements)?;
            }
            return Ok(());
        };
        while let Some(bytes) = arrivals.take() {
            if bytes.len() > LONGEST {
                self.too_long += 1;
            } else {
                outputs.send_slice::<Datagram>(DATAGRAM, &(), &bytes)?;
            }
            arrivals.give_back(bytes);
        }
        self.dropped += arrivals.dropped();
        self.foreign += arrivals.foreign();
        for (address, count) in arrivals.above() {
            *self.above.entry(address).or_default() += count;
        }
        // A flood is told ten times a second.
        let (reported, at) = self.reported;
        if self.refused() > reported && (reported == 0 || activation.time.saturating_sub(at) >= REPORT_EVERY)
        {
            self.reported = (self.refused(), activation.time);
            outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics())?;
        }
        Ok(())
    }
}

impl Link {
    fn refused(&self) -> u64 {
        self.too_long + self.dropped + self.foreign + self.above.values().sum::<u64>()
    }

    /// The counts; of addresses those with the most.
    fn metrics(&self) -> Vec<Metric> {
        let mut metrics = vec![
            Metric::new("too_long", self.too_long as f64),
            Metric::new("too_many_at_once", self.dropped as f64),
            Metric::new("foreign", self.foreign as f64),
            Metric::new("too_many", self.above.values().sum::<u64>() as f64),
        ];
        let mut loudest: Vec<(&IpAddr, &u64)> = self.above.iter().collect();
        loudest.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let of_address =
            |(address, count): &(&IpAddr, &u64)| Metric::new(&format!("too_many_{address}"), **count as f64);
        metrics.extend(loudest.iter().take(ADDRESSES).map(of_address));
        metrics
    }
}

/// The entry in the list of kinds.
pub const STAGE: Stage = Stage::of::<Link>();
