//! What iceoryx2 answers, in words, with what to do about it.
//!
//! Its builders and ports have an error type each, whose variants share their names and say nothing but the name. So
//! the name decides here, for all of them; the version is pinned.

use std::fmt::Debug;

/// The words for an answer of iceoryx2.
pub(crate) fn words(answer: &impl Debug) -> String {
    let text = format!("{answer:?}");
    // `ConnectionFailure(FailedToEstablishConnection(..))`: the outermost name is enough.
    let name = text.split(['(', ' ', '{']).next().unwrap_or(&text);
    let known = match name {
        "ExceedsMaxSupportedSubscribers" | "ExceedsMaxSupportedListeners" => {
            "as many look in as there is room for; end an `echo` or another program that reads this topic"
        }
        "ExceedsMaxSupportedPublishers" | "ExceedsMaxSupportedNotifiers" => {
            "as many send as there is room for; end a `send`, or wait until the dead are cleaned up"
        }
        "ExceedsMaxNumberOfNodes" => {
            "as many processes use it as there is room for; end an `echo`, a `send` or another program that looks in"
        }
        "IncompatibleTypes" | "IncompatibleMessagingPattern" | "IncompatibleAttributes" => {
            "the other end says another layout, unit or frame; let every process run the same build and the same pipeline"
        }
        "DoesNotSupportRequestedMinBufferSize" | "BufferSizeExceedsMaxSupportedBufferSizeOfService" => {
            "it keeps fewer samples than were asked for; ask for a smaller depth"
        }
        "DoesNotExist" => "it is not there; the run has ended, or this is another run's folder",
        "AlreadyExists" | "IsBeingCreatedByAnotherInstance" => {
            "it is there already; another run has the same prefix: start the run again"
        }
        "InsufficientPermissions" => "it belongs to another user; do this as the user who started the run",
        "VersionMismatch" => {
            "another version of iceoryx2 made it; use the same version in every program that takes part"
        }
        "UnableToCreateDataSegment"
        | "ResourceCreationFailed"
        | "UnableToCreatePortTag"
        | "UnableToCreateServiceTag"
        | "ServiceConfigCouldNotBeCreated"
        | "OutOfMemory" => {
            "no room for it; make room in /dev/shm and in the temporary folder, or raise `ulimit -n`"
        }
        "ExceedsMaxLoanSize" => "the sample is larger than the topic was laid out for",
        "ExceedsMaxBorrows" => "more samples are held than the topic was laid out for",
        "ServiceInCorruptedState"
        | "SystemCorrupted"
        | "ConnectionCorrupted"
        | "HangsInCreation"
        | "IsMarkedForDestruction" => "a process died while it used it; end the run and start it again",
        "ConnectionFailure" | "ConnectionError" => {
            "the memory of the other end cannot be mapped; make room in /dev/shm, or start the run again"
        }
        _ => "an answer that is not expected; start the run again, and report it if it comes back",
    };
    format!("{known} (iceoryx2: {text})")
}
