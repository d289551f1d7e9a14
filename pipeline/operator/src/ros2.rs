//! Messages of ROS 2 for a source: which it takes, and how they reach it.
//!
//! In a live run the bridge hands over every message of the topics that a source names as a [`Delivery`], also one that
//! it does not pass on: the source counts each.

use thiserror::Error;

/// A topic of ROS 2 that a source takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Name of the topic, `/` first.
    pub topic: String,
    /// Name of its type: `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// The most bytes of a message: longer ones are not handed over.
    pub longest: usize,
}

/// Bytes before the attachment of a message.
const HEAD: usize = 24;
/// The longest attachment that is handed over, bytes.
pub const LONGEST_ATTACHMENT: usize = 64;
/// Bytes that a delivery has beside its message, at most.
pub const LONGEST_COMPANIONS: usize = HEAD + LONGEST_ATTACHMENT;

/// What the bridge hands over of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delivery<'a> {
    /// Number of the subscription, in the order in which the source names them.
    pub subscription: u32,
    /// When it arrived, session time, ns.
    pub arrived: u64,
    /// Its bytes.
    pub content: Content<'a>,
}

/// The bytes of a message, or why it was not handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content<'a> {
    /// A message.
    Message {
        /// What stands beside it; empty where it has none.
        attachment: &'a [u8],
        /// The message in CDR.
        message: &'a [u8],
    },
    /// It is longer than the subscription allows.
    TooLong,
    /// It is of another type.
    OtherType,
    /// What stands beside it is too long.
    Attachment,
}

/// Bytes that are no delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{0} bytes are not a message of ROS 2 as the bridge hands it over")]
pub struct NoDelivery(pub usize);

impl<'a> Delivery<'a> {
    /// Puts it into `out`. `pieces` are the bytes of the message, one behind the other.
    pub fn write<'p>(
        subscription: u32,
        arrived: u64,
        content: Result<(&[u8], impl Iterator<Item = &'p [u8]>), Content<'_>>,
        out: &mut Vec<u8>,
    ) {
        out.clear();
        let (code, attachment): (u32, &[u8]) = match &content {
            Ok((attachment, _)) => (0, attachment),
            Err(Content::Message { .. } | Content::TooLong) => (1, &[]),
            Err(Content::OtherType) => (2, &[]),
            Err(Content::Attachment) => (3, &[]),
        };
        out.extend_from_slice(&subscription.to_le_bytes());
        out.extend_from_slice(&code.to_le_bytes());
        out.extend_from_slice(&arrived.to_le_bytes());
        out.extend_from_slice(&(attachment.len() as u64).to_le_bytes());
        out.extend_from_slice(attachment);
        if let Ok((_, pieces)) = content {
            pieces.for_each(|piece| out.extend_from_slice(piece));
        }
    }

    /// Reads one.
    ///
    /// # Errors
    /// The bytes are not what [`Delivery::write`] makes.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, NoDelivery> {
        let none = NoDelivery(bytes.len());
        let (head, rest) = bytes.split_at_checked(HEAD).ok_or(none)?;
        let small = |at: usize| head[at..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b));
        let long = |at: usize| head[at..].first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        let (attachment, message) = rest.split_at_checked(long(16) as usize).ok_or(none)?;
        let content = match small(4) {
            0 => Content::Message { attachment, message },
            1 => Content::TooLong,
            2 => Content::OtherType,
            3 => Content::Attachment,
            _ => return Err(none),
        };
        Ok(Self { subscription: small(0), arrived: long(8), content })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_written_is_read() {
        let mut out = vec![9; 3];
        let pieces = [&b"abc"[..], b"", b"de"];
        Delivery::write(1, 7, Ok((b"beside", pieces.into_iter())), &mut out);
        let content = Content::Message { attachment: b"beside", message: b"abcde" };
        assert_eq!(Delivery::parse(&out), Ok(Delivery { subscription: 1, arrived: 7, content }));
        for content in [Content::TooLong, Content::OtherType, Content::Attachment] {
            Delivery::write(2, 8, Err::<(&[u8], std::iter::Empty<&[u8]>), _>(content), &mut out);
            assert_eq!(Delivery::parse(&out), Ok(Delivery { subscription: 2, arrived: 8, content }));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = Delivery::parse(&bytes);
        }
    }
}
