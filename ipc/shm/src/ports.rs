//! Ports that carry bytes: publisher, subscriber, loan, received sample.

use iceoryx2::port::update_connections::UpdateConnections;
use stillpoint_samples::{Header, Pieces};

use crate::contract::Contract;
use crate::erased::{self, ErasedLoan, ErasedPublisher, ErasedSample, ErasedSubscriber};
use crate::error::{PortKind, ShmError, port_error};

/// Sends samples. It is never blocked by a consumer.
pub struct Publisher {
    port: ErasedPublisher,
    contract: Contract,
}

impl Publisher {
    pub(crate) fn new(port: ErasedPublisher, contract: &Contract) -> Self {
        Self { port, contract: contract.clone() }
    }

    /// Connects to the subscribers that are there. What is sent before is not for them.
    pub fn connect(&self) -> Result<(), ShmError> {
        self.port.update_connections().map_err(|e| port_error(&self.contract.topic, PortKind::Publisher, e))
    }

    /// A buffer for `elements` elements; `None` where the memory of the port is used up.
    pub fn loan(&self, elements: usize) -> Result<Option<Loan>, ShmError> {
        let loan = erased::loan(&self.port, &self.contract, elements)?;
        Ok(loan.map(|loan| Loan { loan, meta_size: self.contract.meta_size }))
    }

    /// Sends what was written into a loan. The header's count says how many elements it has.
    pub fn send(&self, loan: Loan) -> Result<usize, ShmError> {
        erased::send(loan.loan, &self.contract)
    }
}

/// A buffer in shared memory.
pub struct Loan {
    loan: ErasedLoan,
    meta_size: usize,
}

impl Loan {
    /// Header and body, and room for the elements. Both may hold bytes of an earlier sample.
    pub fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        erased::loan_parts(&mut self.loan, self.meta_size)
    }

    /// The bytes as they stand.
    pub fn pieces(&self) -> Pieces<'_> {
        let (meta, payload) = erased::loan_view(&self.loan, self.meta_size);
        Pieces { meta, payload }
    }
}

/// Receives samples: the newest `depth` of each publisher, in order.
pub struct Subscriber {
    port: ErasedSubscriber,
    contract: Contract,
}

impl Subscriber {
    pub(crate) fn new(port: ErasedSubscriber, contract: &Contract) -> Self {
        Self { port, contract: contract.clone() }
    }

    /// Connects to the publishers that are there, so that what they send from now on, and have sent to this
    /// subscriber, stays even if they die. Says whether samples wait.
    pub fn connect(&self) -> Result<bool, ShmError> {
        self.port.has_samples().map_err(|e| port_error(&self.contract.topic, PortKind::Subscriber, e))
    }

    /// The oldest sample that waits.
    pub fn receive(&self) -> Result<Option<Received>, ShmError> {
        let sample =
            self.port.receive().map_err(|e| port_error(&self.contract.topic, PortKind::Subscriber, e))?;
        Ok(sample.map(|sample| Received { sample, meta_size: self.contract.meta_size }))
    }
}

/// A sample in shared memory. It stays there until this is dropped.
pub struct Received {
    sample: ErasedSample,
    meta_size: usize,
}

impl Received {
    /// Its bytes; the payload may reach beyond the header's count.
    pub fn pieces(&self) -> Pieces<'_> {
        let (meta, payload) = erased::received_view(&self.sample, self.meta_size);
        Pieces { meta, payload }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        self.pieces().header()
    }
}
