//! The calls of iceoryx2 that carry any type: doc-hidden there, so the version is pinned and they stand only here.

use iceoryx2::port::LoanError;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::ipc;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use stillpoint_samples::Shape;

use crate::contract::Contract;
use crate::domain::Domain;
use crate::error::{PortKind, PortRefusal, ShmError, port_error, topic_error};

pub(crate) type DataFactory = PortFactory<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;
pub(crate) type ErasedPublisher =
    iceoryx2::port::publisher::Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;
pub(crate) type ErasedSubscriber =
    iceoryx2::port::subscriber::Subscriber<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;
pub(crate) type ErasedLoan =
    SampleMutUninit<ipc::Service, [std::mem::MaybeUninit<CustomPayloadMarker>], CustomHeaderMarker>;
pub(crate) type ErasedSample = Sample<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

fn builder(
    domain: &Domain,
    name: &ServiceName,
    contract: &Contract,
) -> Result<Builder<[CustomPayloadMarker], CustomHeaderMarker, ipc::Service>, ShmError> {
    let variant = match contract.shape {
        Shape::Fixed => TypeVariant::FixedSize,
        Shape::Slice => TypeVariant::Dynamic,
    };
    let detail = |variant, name: &str, size, align| {
        TypeDetail::__internal_new_from_parts(variant, name, size, align)
            .map_err(|e| topic_error(contract, PortRefusal::Contract(e.to_string())))
    };
    let payload = detail(variant, &contract.type_name, contract.element_size, contract.element_align)?;
    let header = detail(TypeVariant::FixedSize, "stillpoint/Header", contract.meta_size, 8)?;
    let builder = domain
        .node
        .service_builder(name)
        .publish_subscribe::<[CustomPayloadMarker]>()
        .user_header::<CustomHeaderMarker>();
    // SAFETY: the details describe plain bytes: every use of the payload and the header goes through `u8` slices of
    // exactly these sizes, so no type is assumed that the memory does not have.
    Ok(unsafe {
        builder.__internal_set_payload_type_details(&payload).__internal_set_user_header_type_details(&header)
    })
}

pub(crate) fn create(
    domain: &Domain,
    name: &ServiceName,
    contract: &Contract,
) -> Result<DataFactory, ShmError> {
    builder(domain, name, contract)?
        // The oldest goes when a buffer is full: a publisher is never blocked by a consumer.
        .enable_safe_overflow(true)
        .history_size(contract.history)
        .subscriber_max_buffer_size(contract.deepest())
        .subscriber_max_borrowed_samples(contract.borrowed)
        .max_subscribers(contract.subscribers)
        .max_publishers(contract.publishers)
        .max_nodes(contract.nodes)
        .create()
        .map_err(|e| topic_error(contract, e))
}

pub(crate) fn open(
    domain: &Domain,
    name: &ServiceName,
    contract: &Contract,
) -> Result<DataFactory, ShmError> {
    builder(domain, name, contract)?.open().map_err(|e| topic_error(contract, e))
}

pub(crate) fn publisher(data: &DataFactory, contract: &Contract) -> Result<ErasedPublisher, ShmError> {
    let pool = contract.samples();
    let length = match contract.shape {
        Shape::Fixed => 1,
        Shape::Slice => contract.capacity,
    };
    data.publisher_builder()
        .initial_max_slice_len(length)
        // Growth in flight costs milliseconds, and a dead sender's grown segment loses samples without a word.
        .allocation_strategy(AllocationStrategy::Static)
        .max_loaned_samples(pool)
        .override_sample_preallocation(move |worst| pool.min(worst))
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .map_err(|e| port_error(&contract.topic, PortKind::Publisher, e))
}

pub(crate) fn subscriber(
    data: &DataFactory,
    contract: &Contract,
    depth: usize,
    history: usize,
) -> Result<ErasedSubscriber, ShmError> {
    data.subscriber_builder()
        .buffer_size(depth.max(1))
        .history_request(history)
        .create()
        .map_err(|e| port_error(&contract.topic, PortKind::Subscriber, e))
}

/// A buffer for `elements` elements; `None` where the publisher's memory is used up.
pub(crate) fn loan(
    publisher: &ErasedPublisher,
    contract: &Contract,
    elements: usize,
) -> Result<Option<ErasedLoan>, ShmError> {
    let elements = match contract.shape {
        Shape::Fixed => 1,
        Shape::Slice => elements,
    };
    // SAFETY: the only precondition is that a fixed type is loaned one element at a time.
    match unsafe { publisher.loan_custom_payload(elements) } {
        Ok(loan) => Ok(Some(loan)),
        Err(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => Ok(None),
        Err(e) => Err(port_error(&contract.topic, PortKind::Publisher, e)),
    }
}

/// Header and body, and room for the elements, of a loan.
pub(crate) fn loan_parts(loan: &mut ErasedLoan, meta_size: usize) -> (&mut [u8], &mut [u8]) {
    let header = std::ptr::from_mut(loan.user_header_mut()).cast::<u8>();
    let payload = loan.payload_mut();
    let (start, len) = (payload.as_mut_ptr().cast::<u8>(), payload.len());
    // SAFETY: the service was opened with a user header of `meta_size` bytes that lies before the payload, so the two
    // ranges are apart and belong to this loan alone. The marker reference is to a type of size 0, whose pointer is
    // widened here: this is the one place that does so. The memory is mapped from a zero-filled object, so each byte
    // has a value, and every bit pattern is a valid u8.
    unsafe { (std::slice::from_raw_parts_mut(header, meta_size), std::slice::from_raw_parts_mut(start, len)) }
}

/// Header and body, and the elements, of a loan, to read.
pub(crate) fn loan_view(loan: &ErasedLoan, meta_size: usize) -> (&[u8], &[u8]) {
    let header = std::ptr::from_ref(loan.user_header()).cast::<u8>();
    let payload = loan.payload();
    // SAFETY: as in `loan_parts`; the shared borrow of the loan keeps writers away.
    unsafe {
        (
            std::slice::from_raw_parts(header, meta_size),
            std::slice::from_raw_parts(payload.as_ptr().cast::<u8>(), payload.len()),
        )
    }
}

/// Sends a loan; consumers that it reached.
pub(crate) fn send(loan: ErasedLoan, contract: &Contract) -> Result<usize, ShmError> {
    // SAFETY: each byte has a value (see `loan_parts`), and what lies beyond the header's count is never read.
    unsafe { loan.assume_init() }.send().map_err(|e| port_error(&contract.topic, PortKind::Publisher, e))
}

/// Header and body, and the elements, of a received sample.
pub(crate) fn received_view(sample: &ErasedSample, meta_size: usize) -> (&[u8], &[u8]) {
    let header = std::ptr::from_ref(sample.user_header()).cast::<u8>();
    let payload = sample.payload();
    // SAFETY: as in `loan_parts`; a sample that was sent is never written again while it is borrowed.
    unsafe {
        (
            std::slice::from_raw_parts(header, meta_size),
            std::slice::from_raw_parts(payload.as_ptr().cast::<u8>(), payload.len()),
        )
    }
}
