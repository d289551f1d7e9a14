//! A sample's own bytes: `Header ++ Body ++ elements` is a CDR body as it is.

use stillpoint_samples::{HEADER_SIZE, Header, Pieces, SampleKind};

use super::{Decoded, Fault};
use stillpoint_cdr::{ENCAPSULATION, Reader, Writer};

pub(super) fn encode(sample: &Pieces<'_>, out: &mut Vec<u8>) {
    let mut w = Writer::new(out);
    w.raw(sample.meta, 1);
    w.raw(sample.payload, 1);
}

pub(super) fn decode<'a>(kind: &SampleKind, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    Reader::new(data)?;
    let pieces = Pieces::split(kind, &data[ENCAPSULATION.len()..])?;
    Ok(Decoded { meta: pieces.meta.into(), payload: pieces.payload.into() })
}

/// The header of a message in its own form, whatever its kind.
pub(crate) fn header(data: &[u8]) -> Result<Header, Fault> {
    let meta = Reader::new(data)?.raw(HEADER_SIZE, 1)?;
    Ok(Pieces { meta, payload: &[] }.header())
}
