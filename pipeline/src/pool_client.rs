//! Where an operator reaches the workers of a planning pool.

use stillpoint_samples::{
    Diagnostics, LONGEST_POOL_MESSAGE, Metric, Pieces, PoolMessage, PoolMessageBody, PoolWord, Sample,
};

use crate::graph::{HostTls, PoolNode};
use crate::hosts::endpoint_fault;
use crate::operator::activation::Activation;
use crate::operator::outputs::Outputs;
use crate::operator::outside::Arrivals;
use crate::operator::params::CheckedParams;
use crate::operator::{
    FrameRule, Input, Kind, Operator, Output, ParamConflict, Params, Policy, Role, Setup, SetupError, Stage,
    StepError, Timer,
};

/// Name of the kind.
pub const KIND_NAME: &str = "pool.client";
/// Messages that may wait before the operator; more wait in shared memory.
pub const MOST_WAITING: usize = 16;
/// Time between two samples that say that there is no network, ns.
const SAYS_SO: u64 = 1_000_000_000;
const MESSAGES: usize = 0;
const DIAGNOSTICS: usize = 1;

/// The files of a certificate, relative to the pipeline file. They are read by the bridge alone, and no session keeps them.
#[derive(Clone, Debug, Params)]
pub struct TlsParams {
    /// Certificate of this program, PEM.
    pub certificate: String,
    /// Key of the certificate, PEM; only its owner may read it.
    pub key: String,
    /// Certificate of the authority that signs all certificates, PEM.
    pub authority: String,
}

/// Parameters of `pool.client`.
#[derive(Clone, Debug, Params)]
pub struct PoolClientParams {
    /// Endpoint of a router or of a listening worker: `tls/ADDRESS:PORT`, or `tcp/ADDRESS:PORT` without a certificate.
    pub connect: String,
    /// The certificate.
    pub tls: Option<TlsParams>,
}

/// Carries the messages of an operator to the workers of a planning pool and back. In a live run, the bridge takes the
/// messages out of shared memory and gives them to the network, so that no operator waits for it; what arrives is sent on.
///
/// It is a source: a session keeps every message of a worker, so that a replay needs no network. In any other run there is no
/// network: it says so, and whoever asks computes by itself.
pub struct PoolClient {
    arrivals: Option<Arrivals>,
    every: u64,
    malformed: u64,
}

impl Operator for PoolClient {
    type Params = PoolClientParams;
    const KIND: Kind = Kind {
        name: KIND_NAME,
        about: "Carries messages to the workers of a planning pool and back.",
        role: Role::Source,
        inputs: &[Input {
            name: "calls",
            sample: PoolMessage::KIND,
            policy: Policy::Queue(64),
            required: true,
            about: "Messages to workers, as `plan.optimizer` sends them.",
        }],
        outputs: &[
            Output {
                name: "messages",
                sample: PoolMessage::KIND,
                frame: FrameRule::None,
                about: "Messages of workers.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "The count of messages that could not be read, when it is new.",
            },
        ],
        timer: Timer::Required,
    };

    fn validate(params: &PoolClientParams) -> Result<(), ParamConflict> {
        match endpoint_fault(&params.connect, params.tls.is_some()) {
            None => Ok(()),
            Some((reason, help)) => Err(ParamConflict { params: &["connect", "tls"], reason, help }),
        }
    }

    fn new(_: PoolClientParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let every = setup.every.unwrap_or(SAYS_SO).max(1);
        Ok(Self { arrivals: setup.outside.arrivals.clone(), every, malformed: 0 })
    }

    fn capacities(_: &PoolClientParams) -> Vec<usize> {
        vec![LONGEST_POOL_MESSAGE, 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(arrivals) = &self.arrivals else {
            // Now and then: the operator that asks may have been started again.
            let is_time = activation.tick.is_multiple_of((SAYS_SO / self.every).max(1));
            if activation.cause == stillpoint_samples::Cause::Timer && is_time {
                let body = PoolMessageBody { word: PoolWord::NoNetwork as u32, ..PoolMessageBody::default() };
                outputs.send_slice::<PoolMessage>(MESSAGES, &body, &[])?;
            }
            return Ok(());
        };
        let before = self.malformed;
        for _ in 0..MOST_WAITING {
            let Some(bytes) = arrivals.take() else { break };
            let pieces = Pieces::split(PoolMessage::KIND, &bytes).ok();
            match pieces.filter(|p| p.header().count as usize <= outputs.capacity(MESSAGES)) {
                Some(pieces) => outputs.send_pieces(MESSAGES, pieces)?,
                None => self.malformed += 1,
            }
            arrivals.give_back(bytes);
        }
        self.malformed += arrivals.dropped();
        if self.malformed > before {
            let metrics = [Metric::new("malformed", self.malformed as f64)];
            outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)?;
        }
        Ok(())
    }
}

/// Its entry in the list of kinds.
pub const STAGE: Stage = Stage::of::<PoolClient>();

/// Where an operator of this kind and these parameters finds its pool.
pub fn node(name: &str, params: &CheckedParams) -> Option<PoolNode> {
    let PoolClientParams { connect, tls } = params.value.downcast_ref::<PoolClientParams>()?.clone();
    let tls = tls.map(|TlsParams { certificate, key, authority }| HostTls {
        certificate: certificate.into(),
        key: key.into(),
        authority: authority.into(),
    });
    Some(PoolNode { name: name.to_owned(), connect, tls })
}
