//! The weights in shared memory: a training publishes them, and its players take the newest (ch. 5.3.1).

use stillpoint_network::Model;
use stillpoint_samples::{HEADER_SIZE, Header, Sample, SampleKind, Shape};
use stillpoint_shm::{Contract, Domain, Publisher, Subscriber, Topic};
use zerocopy::IntoBytes;

use stillpoint::Failure;

/// Most bytes of a model file.
const CAPACITY: usize = 5 << 20;

/// A model file, as a training publishes it.
struct Weights;

impl Sample for Weights {
    type Body = ();
    type Element = u8;
    const NAME: &'static str = "Weights";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "The bytes of a model file.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

/// The newest weights stay for players that come later.
fn contract() -> Contract {
    Contract { history: 1, pool: 3, ..Contract::new("training.weights", Weights::KIND, None, CAPACITY) }
}

/// The end of the training.
pub struct Sender {
    publisher: Publisher,
    sequence: u64,
    _topic: Topic,
}

impl Sender {
    pub fn new(domain: &Domain) -> Result<Self, Failure> {
        let topic = Topic::create(domain, &contract()).map_err(Failure::failed)?;
        let publisher = topic.publisher().map_err(Failure::failed)?;
        Ok(Self { publisher, sequence: 0, _topic: topic })
    }

    pub fn send(&mut self, model: &Model) -> Result<(), Failure> {
        let bytes = model.to_safetensors().map_err(Failure::failed)?;
        let loan = self.publisher.loan(bytes.len()).map_err(Failure::failed)?;
        let mut loan = loan.ok_or_else(|| Failure::failed("no shared memory is left for the weights"))?;
        let (meta, payload) = loan.parts_mut();
        let count = bytes.len() as u32;
        let header = Header { sequence: self.sequence, count, ..Header::default() };
        meta[..HEADER_SIZE].copy_from_slice(header.as_bytes());
        payload[..bytes.len()].copy_from_slice(&bytes);
        self.publisher.send(loan).map_err(Failure::failed)?;
        self.sequence += 1;
        Ok(())
    }

    /// Gives the newest weights to players that have come since.
    pub fn connect(&self) -> Result<(), Failure> {
        self.publisher.connect().map_err(Failure::failed)
    }
}

/// The end of a player.
pub struct Receiver {
    subscriber: Subscriber,
    newest: Option<Model>,
    _topic: Topic,
}

impl Receiver {
    pub fn new(domain: &Domain) -> Result<Self, Failure> {
        let topic = Topic::open(domain, &contract()).map_err(Failure::failed)?;
        let (subscriber, _) = topic.subscriber_with_history().map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        Ok(Self { subscriber, newest: None, _topic: topic })
    }

    pub fn newest(&mut self) -> Result<Option<&Model>, Failure> {
        while let Some(sample) = self.subscriber.receive().map_err(Failure::failed)? {
            let view = sample.pieces().view::<Weights>().map_err(Failure::failed)?;
            self.newest = Some(Model::from_safetensors(view.elements).map_err(Failure::failed)?);
        }
        Ok(self.newest.as_ref())
    }
}
