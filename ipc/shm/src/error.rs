//! Why shared memory did not do as asked.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use crate::contract::Contract;

/// Why shared memory did not do as asked.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ShmError {
    /// The node of this process could not be made.
    #[error("no iceoryx2 node in {}: {cause}", .root.display())]
    Node {
        /// Root folder of the domain.
        root: PathBuf,
        /// The reason that iceoryx2 gives.
        cause: PortRefusal,
    },
    /// A service could not be created or opened.
    #[error("topic {topic} ({type_name}): {cause}")]
    Topic {
        /// Name of the topic.
        topic: String,
        /// Contract text.
        type_name: String,
        /// The reason that iceoryx2 gives.
        cause: PortRefusal,
    },
    /// A port could not be made or used.
    #[error("{port} on topic {topic}: {cause}")]
    Port {
        /// Name of the topic.
        topic: String,
        /// Which port.
        port: PortKind,
        /// The reason that iceoryx2 gives.
        cause: PortRefusal,
    },
    /// A name that iceoryx2 does not take.
    #[error(
        "`{name}` cannot name a part of shared memory: it is too long, or has a character that no file name has"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// The object in which iceoryx2 counts the nodes of a run cannot be used.
    #[error("{}: {fault}", .object.display())]
    NodeCounter {
        /// The object.
        object: PathBuf,
        /// What is wrong with it.
        fault: CounterFault,
    },
    /// The operating system refused to wait on listeners and control pipe.
    #[error("the listeners of this process cannot be waited for: {0}")]
    Wait(Arc<io::Error>),
}

/// The ports of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortKind {
    /// Sends samples.
    Publisher,
    /// Receives samples.
    Subscriber,
    /// Wakes listeners.
    Notifier,
    /// Is woken.
    Listener,
}

/// Why iceoryx2 refused something, as far as a user can act on it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PortRefusal {
    /// No subscriber or listener more.
    #[error(
        "the topic has as many readers as it has room for; end an `echo` or another program that reads this topic"
    )]
    TooManyReaders,
    /// No publisher or notifier more.
    #[error(
        "the topic has as many senders as it has room for; end a `send`, or wait until ended processes are cleaned up"
    )]
    TooManySenders,
    /// No process more.
    #[error(
        "as many processes use the topic as it has room for; end an `echo`, a `send` or another program that reads it"
    )]
    TooManyNodes,
    /// The other side declares another contract.
    #[error(
        "the other side declares another layout, unit or frame; run the same build and the same pipeline in every process"
    )]
    OtherContract,
    /// The service is laid out for less than was asked for.
    #[error("the topic keeps fewer samples than were asked for; ask for a smaller depth")]
    DepthTooLarge,
    /// Nothing of that name.
    #[error("the topic does not exist; the run has ended, or this is another run's folder")]
    NotThere,
    /// Something of that name.
    #[error("the topic exists already; another run has the same prefix: start the run again")]
    AlreadyThere,
    /// It is somebody else's.
    #[error("the object belongs to another user; use the account of the user who started the run")]
    NotPermitted,
    /// Another version of iceoryx2.
    #[error(
        "another version of iceoryx2 created the object; use the same version in every program that takes part"
    )]
    OtherVersion,
    /// No memory, no disk or no file handles.
    #[error(
        "there is no room for the object; make room in /dev/shm and in the temporary folder, or raise `ulimit -n`"
    )]
    NoRoom,
    /// More elements than the contract has.
    #[error("the sample is larger than the contract of the topic allows")]
    SampleTooLarge,
    /// More samples are held than the contract has.
    #[error("the subscriber holds more samples than the contract of the topic allows")]
    TooManyHeld,
    /// What a process that died left half done.
    #[error("a process died while it used the object; end the run and start it again")]
    Corrupted,
    /// The memory of the other side.
    #[error("the memory of the other side cannot be mapped; make room in /dev/shm, or start the run again")]
    Unmappable,
    /// A contract text or a limit that iceoryx2 does not take.
    #[error("iceoryx2 does not accept the contract ({0}); shorten the names of topic and frame")]
    Contract(String),
    /// Anything else.
    #[error(
        "iceoryx2 failed unexpectedly ({0}); start the run again, and report the failure if it comes back"
    )]
    Unexpected(String),
}

/// What is wrong with the object in which iceoryx2 counts the nodes of a run.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CounterFault {
    /// There is none.
    #[error("the object does not exist; the run has ended, or this is another run's folder")]
    NotThere,
    /// It is not the user's own.
    #[error("the object belongs to user {owner}, not to user {user}; remove it, or start the run again")]
    OtherOwner {
        /// Its owner.
        owner: u32,
        /// This process's user.
        user: u32,
    },
    /// Others may write it.
    #[error("other users may open the object (mode {mode:o}); start the run again")]
    OpenToOthers {
        /// Its permission bits.
        mode: u32,
    },
    /// It does not hold what iceoryx2 wrote.
    #[error("the object holds {size} bytes and no version of iceoryx2; start the run again")]
    Damaged {
        /// Bytes in it.
        size: u64,
    },
    /// The operating system refused.
    #[error("{0}")]
    Io(Arc<io::Error>),
}

impl fmt::Display for PortKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Publisher => "publisher",
            Self::Subscriber => "subscriber",
            Self::Notifier => "notifier",
            Self::Listener => "listener",
        })
    }
}

/// A name that iceoryx2 does not take: it gives no more than that.
pub(crate) fn name_error(name: &str) -> ShmError {
    ShmError::Name { name: name.to_string() }
}

pub(crate) fn topic_error(contract: &Contract, cause: impl Into<PortRefusal>) -> ShmError {
    ShmError::Topic {
        topic: contract.topic.clone(),
        type_name: contract.type_name.clone(),
        cause: cause.into(),
    }
}

pub(crate) fn port_error(topic: &str, port: PortKind, cause: impl Into<PortRefusal>) -> ShmError {
    ShmError::Port { topic: topic.to_string(), port, cause: cause.into() }
}
