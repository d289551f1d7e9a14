//! A sample laid out as the message that it is recorded as.
//!
//! Whoever takes samples out of shared memory must copy them anyway: copied into an [`Encoded`], they need no second
//! copy when they are written.

use stillpoint_samples::{BytesError, Header, Pieces, SampleKind};

use crate::form::{Companion, Envelope, Form, Shared};
use crate::topic::TopicInfo;

/// A sample laid out as the message that it is recorded as.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    pub(crate) kind: &'static SampleKind,
    pub(crate) form: Form,
    pub(crate) shared: Shared,
    pub(crate) header: Header,
    /// The message, followed by those beside it.
    bytes: Vec<u8>,
    /// Length of the message.
    message: usize,
    /// What stands beside it, and where each ends.
    companion: &'static [Companion],
    ends: [usize; LONGEST_COMPANIONS],
}

/// Messages beside one.
const LONGEST_COMPANIONS: usize = 2;

impl Encoded {
    /// Lays out a sample of a topic in `buffer`, whose capacity is reused.
    ///
    /// # Errors
    /// The bytes are no sample of the topic's kind.
    pub fn new(info: &TopicInfo, sample: Pieces<'_>, buffer: Vec<u8>) -> Result<Self, BytesError> {
        let sample = sample.check(info.kind)?;
        let mut fitting = Form::of(info.kind).iter().filter_map(|form| Some((*form, form.shared(&sample)?)));
        let (form, shared) = fitting.next().unwrap_or_default();
        Ok(Self::in_form(form, shared, info, &sample, buffer))
    }

    fn in_form(
        form: Form,
        shared: Shared,
        info: &TopicInfo,
        sample: &Pieces<'_>,
        mut bytes: Vec<u8>,
    ) -> Self {
        let frame = info.frame.as_deref().unwrap_or_default();
        bytes.clear();
        form.encode(sample, frame, &mut bytes);
        let message = bytes.len();
        let companion = Companion::of(form, frame);
        let child = if companion.is_empty() { String::new() } else { info.name.replace('.', "/") };
        let mut ends = [message; LONGEST_COMPANIONS];
        for (end, companion) in ends.iter_mut().zip(companion) {
            companion.encode(sample, &child, frame, &mut bytes);
            *end = bytes.len();
        }
        Self { kind: info.kind, form, shared, header: sample.header(), bytes, message, companion, ends }
    }

    /// The same sample in its own form. `None`: the message does not read back, which its form rules out.
    pub(crate) fn in_own_form(&self, info: &TopicInfo) -> Option<Self> {
        let sample = self
            .form
            .decode(
                info.kind,
                &self.shared,
                Envelope { sequence: self.header.sequence as u32, publish_time: self.header.stamp },
                self.message(),
            )
            .ok()?
            .to_bytes();
        let pieces = Pieces::split(info.kind, &sample).ok()?;
        Some(Self::in_form(Form::Own, Shared::default(), info, &pieces, Vec::new()))
    }

    /// The message.
    pub fn message(&self) -> &[u8] {
        &self.bytes[..self.message]
    }

    /// The messages beside it for viewers.
    pub(crate) fn companion(&self) -> impl Iterator<Item = (Companion, &[u8])> {
        let begins = [self.message].into_iter().chain(self.ends);
        let places = begins.zip(self.ends).map(|(begin, end)| &self.bytes[begin..end]);
        self.companion.iter().copied().zip(places)
    }

    /// Number of the sample on its topic and incarnation of its producer.
    pub fn number(&self) -> (u32, u64) {
        (self.header.incarnation, self.header.sequence)
    }

    /// The buffer, to be used again.
    pub fn into_buffer(self) -> Vec<u8> {
        self.bytes
    }
}
