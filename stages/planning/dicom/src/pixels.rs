//! The stored words of an image, uncompressed or compressed without loss.

use std::io::Cursor;

use dicom_core::value::Value;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};
use jpeg_decoder::{CodingProcess, Decoder, PixelFormat};

use crate::element::{TagError, wrong};

/// The header of RLE data: a count and 15 places, 32 bits each (PS3.5, G.5).
const RLE_HEADER: usize = 64;

/// The words of an image with 16 bits for each of its pixels.
pub(crate) fn words(
    object: &InMemDicomObject,
    compressed: Option<&str>,
    columns: usize,
    rows: usize,
) -> Result<Vec<u16>, TagError> {
    let element = object.get(tags::PIXEL_DATA).ok_or(TagError::Missing(tags::PIXEL_DATA))?;
    let Some(count) = columns.checked_mul(rows).filter(|n| (1..1 << 30).contains(n)) else {
        return wrong(tags::ROWS, format!("{rows} with {columns} columns"), "1 to 2^30 pixels are expected");
    };
    let Some(syntax) = compressed else {
        return plain(element.to_bytes().ok().as_deref(), columns, rows);
    };
    let Value::PixelSequence(sequence) = element.value() else {
        return wrong(tags::PIXEL_DATA, "not compressed", "the transfer syntax is one of compressed pixels");
    };
    let fragments = sequence.fragments();
    match syntax {
        uids::RLE_LOSSLESS => match fragments {
            [fragment] => run_lengths(fragment, count),
            _ => wrong(tags::PIXEL_DATA, format!("{} pieces", fragments.len()), "RLE has one piece an image"),
        },
        uids::JPEG_LOSSLESS | uids::JPEG_LOSSLESS_SV1 => jpeg(&fragments.concat(), columns, rows),
        uids::JPEG2000_LOSSLESS => jpeg2000(&fragments.concat(), columns, rows),
        _ => {
            let why = "of compressed pixels RLE, JPEG lossless and JPEG 2000 lossless are read: convert the images to explicit little endian (for example `gdcmconv --raw`)";
            wrong(tags::TRANSFER_SYNTAX_UID, syntax, why)
        }
    }
}

fn plain(bytes: Option<&[u8]>, columns: usize, rows: usize) -> Result<Vec<u16>, TagError> {
    let Some(bytes) = bytes else {
        return wrong(tags::PIXEL_DATA, "a sequence", "uncompressed pixels are expected");
    };
    let size = 2 * columns * rows;
    // A value of odd length is padded by one byte.
    if bytes.len() < size || bytes.len() > size + 1 {
        let found = format!("{} bytes for {columns} x {rows} pixels", bytes.len());
        return wrong(tags::PIXEL_DATA, found, "two bytes for each pixel are expected");
    }
    Ok(bytes.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect())
}

/// RLE: the high bytes of all pixels, then the low bytes, each packed (PS3.5, G.3 and G.4).
///
/// The decoder of dicom-transfer-syntax-registry panics on broken data.
fn run_lengths(fragment: &[u8], count: usize) -> Result<Vec<u16>, TagError> {
    let broken = |why| wrong(tags::PIXEL_DATA, format!("RLE: {why}"), "export the image again");
    let Some((header, _)) = fragment.split_at_checked(RLE_HEADER) else {
        return broken("its header has 64 bytes");
    };
    let number = |place: usize| {
        u32::from_le_bytes([header[place], header[place + 1], header[place + 2], header[place + 3]]) as usize
    };
    if number(0) != 2 {
        return broken("an image of 16 bits has two segments");
    }
    let (high, low) = (number(4), number(8));
    let (Some(high), Some(low)) = (fragment.get(high..low), fragment.get(low..)) else {
        return broken("its segments are outside of it");
    };
    match (unpack(high, count), unpack(low, count)) {
        (Some(high), Some(low)) => {
            Ok(high.into_iter().zip(low).map(|(high, low)| u16::from_be_bytes([high, low])).collect())
        }
        _ => broken("its segments hold too few pixels"),
    }
}

/// The first `count` bytes of a packed segment.
fn unpack(mut packed: &[u8], count: usize) -> Option<Vec<u8>> {
    // A packed byte makes at most 64.
    if count / 64 > packed.len() {
        return None;
    }
    let mut bytes = Vec::with_capacity(count);
    while bytes.len() < count {
        let (&head, rest) = packed.split_first()?;
        let left = count - bytes.len();
        packed = match head {
            0..=127 => {
                let (literal, rest) = rest.split_at_checked(usize::from(head) + 1)?;
                bytes.extend(literal.iter().take(left));
                rest
            }
            128 => rest,
            129..=255 => {
                let (&byte, rest) = rest.split_first()?;
                bytes.resize(bytes.len() + (257 - usize::from(head)).min(left), byte);
                rest
            }
        };
    }
    Some(bytes)
}

fn jpeg(bytes: &[u8], columns: usize, rows: usize) -> Result<Vec<u16>, TagError> {
    let broken = |why: String| wrong(tags::PIXEL_DATA, format!("JPEG: {why}"), "export the image again");
    // A pixel takes a bit at least, and the decoder takes memory for all pixels that the header claims.
    if columns * rows / 8 > bytes.len() {
        return broken(format!("{} bytes for {columns} x {rows} pixels", bytes.len()));
    }
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_max_decoding_buffer_size(2 * columns * rows);
    if let Err(fault) = decoder.read_info() {
        return broken(fault.to_string());
    }
    let Some(info) = decoder.info() else { return broken("it has no frame".to_owned()) };
    if [usize::from(info.width), usize::from(info.height)] != [columns, rows] {
        return broken(format!(
            "{} x {} pixels, but {columns} x {rows} are expected",
            info.width, info.height
        ));
    }
    if info.coding_process != CodingProcess::Lossless {
        return broken(format!("coded by the process {:?}, but lossless is expected", info.coding_process));
    }
    let decoded = match decoder.decode() {
        Ok(decoded) => decoded,
        Err(fault) => return broken(fault.to_string()),
    };
    match info.pixel_format {
        PixelFormat::L16 if decoded.len() == 2 * columns * rows => {
            // The decoder writes words as the machine does.
            Ok(decoded.chunks_exact(2).map(|word| u16::from_ne_bytes([word[0], word[1]])).collect())
        }
        PixelFormat::L8 if decoded.len() == columns * rows => {
            Ok(decoded.into_iter().map(u16::from).collect())
        }
        other => broken(format!("pixels of the kind {other:?}")),
    }
}

/// JPEG 2000: a codestream (ISO/IEC 15444-1), whose samples are the words, signed or not.
fn jpeg2000(bytes: &[u8], columns: usize, rows: usize) -> Result<Vec<u16>, TagError> {
    let broken = |why: String| wrong(tags::PIXEL_DATA, format!("JPEG 2000: {why}"), "export the image again");
    // The decoder takes memory for all pixels that the header claims: what it claims is compared before.
    let Some(Size { width, height, components: 1, is_signed, bits }) = size(bytes) else {
        return broken("its first segment does not describe one component".to_owned());
    };
    if [width, height] != [columns, rows] {
        return broken(format!("{width} x {height} pixels, but {columns} x {rows} are expected"));
    }
    if !(1..=16).contains(&bits) {
        return broken(format!("{bits} bits a pixel (allowed: 1 to 16)"));
    }
    if columns * rows / LARGEST_RATIO > bytes.len() {
        return broken(format!("{} bytes for {columns} x {rows} pixels", bytes.len()));
    }
    let settings = DecodeSettings { strict: true, ..DecodeSettings::default() };
    let image = match Image::new(bytes, &settings) {
        Ok(image) => image,
        Err(fault) => return broken(fault.to_string()),
    };
    let mut context = DecoderContext::default();
    let decoded = match image.decode(&mut context) {
        Ok(decoded) => decoded,
        Err(fault) => return broken(fault.to_string()),
    };
    let components = decoded.components();
    let [component] = components else { return broken(format!("{} components", components.len())) };
    let samples = component.samples();
    if samples.len() != columns * rows {
        return broken(format!("{} pixels, but {} are expected", samples.len(), columns * rows));
    }
    // The decoder moves every sample up by half the range, as is right for unsigned samples alone.
    let shift = if is_signed { -f64::from(1_u32 << (bits - 1)) } else { 0.0 };
    Ok(samples.iter().map(|&sample| libm::round(f64::from(sample) + shift) as i32 as u16).collect())
}

/// What a well packed image can be smaller by.
const LARGEST_RATIO: usize = 1 << 14;

/// The size segment of a codestream (A.5.1).
struct Size {
    width: usize,
    height: usize,
    components: u16,
    is_signed: bool,
    bits: u8,
}

fn size(bytes: &[u8]) -> Option<Size> {
    let rest = bytes.strip_prefix(&[0xFF, 0x4F, 0xFF, 0x51])?;
    let long = |at: usize| Some(u32::from_be_bytes(rest.get(at..at + 4)?.try_into().ok()?) as usize);
    let components = u16::from_be_bytes(rest.get(36..38)?.try_into().ok()?);
    let depth = *rest.get(38)?;
    let width = long(4)?.checked_sub(long(12)?)?;
    let height = long(8)?.checked_sub(long(16)?)?;
    Some(Size { width, height, components, is_signed: depth & 0x80 != 0, bits: (depth & 0x7F) + 1 })
}
