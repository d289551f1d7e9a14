//! The errors of iceoryx2's builders and ports as [`PortRefusal`]s: one conversion for each of its error types.

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::{ListenerCreateError, ListenerWaitError};
use iceoryx2::port::notifier::NotifierCreateError;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::ConnectionFailure;
use iceoryx2::port::{LoanError, ReceiveError, SendError};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError};
use iceoryx2::service::builder::publish_subscribe::{PublishSubscribeCreateError, PublishSubscribeOpenError};

use crate::error::PortRefusal;

fn unexpected(answer: &impl std::fmt::Display) -> PortRefusal {
    PortRefusal::Unexpected(answer.to_string())
}

impl From<NodeCreationFailure> for PortRefusal {
    fn from(e: NodeCreationFailure) -> Self {
        match e {
            NodeCreationFailure::InsufficientPermissions => Self::NotPermitted,
            NodeCreationFailure::SystemCorrupted => Self::Corrupted,
            NodeCreationFailure::InternalError | NodeCreationFailure::UnableToGenerateUniqueNodeId => {
                unexpected(&e)
            }
        }
    }
}

impl From<PublishSubscribeCreateError> for PortRefusal {
    fn from(e: PublishSubscribeCreateError) -> Self {
        use PublishSubscribeCreateError as E;
        match e {
            E::AlreadyExists | E::IsBeingCreatedByAnotherInstance => Self::AlreadyThere,
            E::InsufficientPermissions => Self::NotPermitted,
            E::ServiceInCorruptedState | E::HangsInCreation => Self::Corrupted,
            E::UnableToCreateServiceTag | E::ServiceConfigCouldNotBeCreated => Self::NoRoom,
            E::SubscriberBufferMustBeLargerThanHistorySize
            | E::InvalidTypeDefinition
            | E::UnableToAcquireTypeDefinition => Self::Contract(e.to_string()),
            E::Interrupt | E::InternalFailure | E::UnableToGenerateUniqueServiceId => unexpected(&e),
        }
    }
}

impl From<PublishSubscribeOpenError> for PortRefusal {
    fn from(e: PublishSubscribeOpenError) -> Self {
        use PublishSubscribeOpenError as E;
        match e {
            E::DoesNotExist => Self::NotThere,
            E::IncompatibleTypes | E::IncompatibleMessagingPattern | E::IncompatibleAttributes => {
                Self::OtherContract
            }
            E::DoesNotSupportRequestedMinBufferSize => Self::DepthTooLarge,
            E::InsufficientPermissions => Self::NotPermitted,
            E::ServiceInCorruptedState | E::HangsInCreation | E::IsMarkedForDestruction => Self::Corrupted,
            E::ExceedsMaxNumberOfNodes => Self::TooManyNodes,
            E::UnableToCreateServiceTag => Self::NoRoom,
            E::VersionMismatch => Self::OtherVersion,
            E::InvalidTypeDefinition | E::UnableToAcquireTypeDefinition => Self::Contract(e.to_string()),
            E::Interrupt
            | E::InternalFailure
            | E::DoesNotSupportRequestedMinHistorySize
            | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | E::DoesNotSupportRequestedAmountOfPublishers
            | E::DoesNotSupportRequestedAmountOfSubscribers
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::IncompatibleOverflowBehavior => unexpected(&e),
        }
    }
}

impl From<EventCreateError> for PortRefusal {
    fn from(e: EventCreateError) -> Self {
        use EventCreateError as E;
        match e {
            E::AlreadyExists | E::IsBeingCreatedByAnotherInstance => Self::AlreadyThere,
            E::InsufficientPermissions => Self::NotPermitted,
            E::ServiceInCorruptedState => Self::Corrupted,
            E::UnableToCreateServiceTag | E::ServiceConfigCouldNotBeCreated => Self::NoRoom,
            E::Interrupt
            | E::InternalFailure
            | E::EventIdExceedsMaxSupportedValue
            | E::UnableToGenerateUniqueServiceId => unexpected(&e),
        }
    }
}

impl From<EventOpenError> for PortRefusal {
    fn from(e: EventOpenError) -> Self {
        use EventOpenError as E;
        match e {
            E::DoesNotExist => Self::NotThere,
            E::IncompatibleMessagingPattern | E::IncompatibleAttributes => Self::OtherContract,
            E::InsufficientPermissions => Self::NotPermitted,
            E::ServiceInCorruptedState | E::HangsInCreation | E::IsMarkedForDestruction => Self::Corrupted,
            E::ExceedsMaxNumberOfNodes => Self::TooManyNodes,
            E::UnableToCreateServiceTag => Self::NoRoom,
            E::VersionMismatch => Self::OtherVersion,
            E::Interrupt
            | E::InternalFailure
            | E::IncompatibleDeadline
            | E::IncompatibleNotifierCreatedEvent
            | E::IncompatibleNotifierDroppedEvent
            | E::IncompatibleNotifierDeadEvent
            | E::DoesNotSupportRequestedAmountOfNotifiers
            | E::DoesNotSupportRequestedAmountOfListeners
            | E::DoesNotSupportRequestedMaxEventId
            | E::DoesNotSupportRequestedAmountOfNodes => unexpected(&e),
        }
    }
}

impl From<PublisherCreateError> for PortRefusal {
    fn from(e: PublisherCreateError) -> Self {
        use PublisherCreateError as E;
        match e {
            E::ExceedsMaxSupportedPublishers => Self::TooManySenders,
            E::UnableToCreateDataSegment | E::UnableToCreatePortTag => Self::NoRoom,
            E::FailedToDeployThreadsafetyPolicy | E::UnableToGenerateUniquePublisherId => unexpected(&e),
        }
    }
}

impl From<SubscriberCreateError> for PortRefusal {
    fn from(e: SubscriberCreateError) -> Self {
        use SubscriberCreateError as E;
        match e {
            E::ExceedsMaxSupportedSubscribers => Self::TooManyReaders,
            E::BufferSizeExceedsMaxSupportedBufferSizeOfService => Self::DepthTooLarge,
            E::UnableToCreatePortTag => Self::NoRoom,
            E::FailedToDeployThreadsafetyPolicy
            | E::HistoryRequestExceedsHistorySizeOfService
            | E::HistoryRequestExceedsBufferSizeOfSubscriber
            | E::UnableToGenerateUniqueSubscriberId => unexpected(&e),
        }
    }
}

impl From<NotifierCreateError> for PortRefusal {
    fn from(e: NotifierCreateError) -> Self {
        use NotifierCreateError as E;
        match e {
            E::ExceedsMaxSupportedNotifiers => Self::TooManySenders,
            E::UnableToCreatePortTag => Self::NoRoom,
            E::FailedToDeployThreadsafetyPolicy | E::UnableToGenerateUniqueNotifierId => unexpected(&e),
        }
    }
}

impl From<ListenerCreateError> for PortRefusal {
    fn from(e: ListenerCreateError) -> Self {
        use ListenerCreateError as E;
        match e {
            E::ExceedsMaxSupportedListeners => Self::TooManyReaders,
            E::ResourceCreationFailed | E::UnableToCreatePortTag => Self::NoRoom,
            E::FailedToDeployThreadsafetyPolicy | E::UnableToGenerateUniqueListenerId => unexpected(&e),
        }
    }
}

impl From<ListenerWaitError> for PortRefusal {
    fn from(e: ListenerWaitError) -> Self {
        unexpected(&e)
    }
}

impl From<LoanError> for PortRefusal {
    fn from(e: LoanError) -> Self {
        match e {
            LoanError::OutOfMemory | LoanError::ExceedsMaxLoans => Self::NoRoom,
            LoanError::ExceedsMaxLoanSize => Self::SampleTooLarge,
            LoanError::InternalFailure => unexpected(&e),
        }
    }
}

impl From<SendError> for PortRefusal {
    fn from(e: SendError) -> Self {
        match e {
            SendError::ConnectionCorrupted => Self::Corrupted,
            SendError::LoanError(e) => e.into(),
            SendError::ConnectionError(e) => e.into(),
            SendError::ConnectionBrokenSinceSenderNoLongerExists
            | SendError::UnableToDeliver
            | SendError::InternalError => unexpected(&e),
        }
    }
}

impl From<ReceiveError> for PortRefusal {
    fn from(e: ReceiveError) -> Self {
        match e {
            ReceiveError::ExceedsMaxBorrows => Self::TooManyHeld,
            ReceiveError::ConnectionFailure(e) => e.into(),
        }
    }
}

impl From<ConnectionFailure> for PortRefusal {
    fn from(e: ConnectionFailure) -> Self {
        match e {
            ConnectionFailure::FailedToEstablishConnection(_)
            | ConnectionFailure::UnableToMapSendersDataSegment(_) => Self::Unmappable,
        }
    }
}
