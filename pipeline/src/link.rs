//! The far end of a link that carries datagrams.

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
/// Datagrams that wait for the far end in a simulated run.
pub const WAITING: u32 = 64;
/// The longest datagram that is taken.
pub const LONGEST: usize = stillpoint_transport::Datagrams::LONGEST;

const DATAGRAM: usize = 0;
const DIAGNOSTICS: usize = 1;

/// Sends on what came over the wire in a live run; in any other run, what its input brings.
///
/// It is a source: replay cannot make a datagram again, so a session keeps it.
pub struct Link {
    arrivals: Option<Arrivals>,
    too_long: u64,
    dropped: u64,
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
                about: "Counts of datagrams that were dropped, when there are new ones: too long, and too many at once.",
            },
        ],
        timer: Timer::Required,
    };

    fn new((): (), setup: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { arrivals: setup.outside.arrivals.clone(), too_long: 0, dropped: 0 })
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![LONGEST, 2]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(arrivals) = &self.arrivals else {
            if let Some(view) = activation.fresh::<Datagram>(DATAGRAM) {
                outputs.send_slice::<Datagram>(DATAGRAM, &(), view.elements)?;
            }
            return Ok(());
        };
        let refused = self.too_long + self.dropped;
        while let Some(bytes) = arrivals.take() {
            if bytes.len() > LONGEST {
                self.too_long += 1;
            } else {
                outputs.send_slice::<Datagram>(DATAGRAM, &(), &bytes)?;
            }
            arrivals.give_back(bytes);
        }
        self.dropped += arrivals.dropped();
        if self.too_long + self.dropped > refused {
            let metrics = [
                Metric::new("too_long", self.too_long as f64),
                Metric::new("too_many_at_once", self.dropped as f64),
            ];
            outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)?;
        }
        Ok(())
    }
}

/// The entry in the list of kinds.
pub const STAGE: Stage = Stage::of::<Link>();
