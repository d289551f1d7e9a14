//! A sample's own bytes: `Head ++ Body ++ elements` is a CDR body as it is.

use stillpoint_samples::{AlignedBytes, HEAD_SIZE, Head, Pieces, SampleKind};

use super::Fault;
use super::cdr::{ENCAPSULATION, Reader, Writer};

pub(super) fn encode(sample: &Pieces<'_>, out: &mut Vec<u8>) {
    let mut w = Writer::new(out);
    w.raw(sample.meta, 1);
    w.raw(sample.payload, 1);
}

pub(super) fn decode(kind: &SampleKind, data: &[u8]) -> Result<AlignedBytes, Fault> {
    Reader::new(data)?;
    let body = &data[ENCAPSULATION.len()..];
    Pieces::split(kind, body).map_err(|e| e.to_string())?;
    Ok(AlignedBytes::copy_of(body))
}

/// The head of a message in its own form, whatever its kind.
pub(crate) fn head(data: &[u8]) -> Result<Head, Fault> {
    let meta = Reader::new(data)?.raw(HEAD_SIZE, 1)?;
    Ok(Pieces { meta, payload: &[] }.head())
}
