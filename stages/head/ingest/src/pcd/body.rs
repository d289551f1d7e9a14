//! The records of a PCD file, in its three encodings, to organised points.

use super::header::{Encoding, Field, FieldType, PcdHeader};
use super::{PcdError, lzf};
use crate::{INVALID_POINT, checks};

/// A cloud read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct PcdCloud {
    /// Row-major points in metres, `width * height` of them; those without a measurement are [`INVALID_POINT`].
    pub points: Vec<[f32; 3]>,
    /// Points in a row.
    pub width: usize,
    /// Rows; 1 for an unorganised cloud.
    pub height: usize,
    /// Sensor pose when the cloud was taken: translation in metres, then a unit quaternion w, x, y, z.
    pub viewpoint: [f64; 7],
}

/// Reads a PCD file: the fields x, y and z of any number type; other fields are skipped.
///
/// Zeros and white space after the last binary record are ignored. Memory stays within 500 times the file's size, and within 20 times it
/// where the file is not compressed.
///
/// # Errors
/// What is wrong with the file, and where.
///
/// ```
/// let file = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n0.1 -0.2 0.9\n";
/// let cloud = stillpoint_ingest::pcd::read(file)?;
/// assert_eq!(cloud.points, [[0.1, -0.2, 0.9]]);
/// # Ok::<(), stillpoint_ingest::pcd::PcdError>(())
/// ```
pub fn read(bytes: &[u8]) -> Result<PcdCloud, PcdError> {
    let header = PcdHeader::parse(bytes)?;
    let data = &bytes[header.data_offset..];
    let points = match header.encoding {
        Encoding::Ascii => read_ascii(&header, data)?,
        Encoding::Binary => read_binary(&header, data)?,
        Encoding::BinaryCompressed => read_compressed(&header, data)?,
    };
    Ok(PcdCloud { points, width: header.width, height: header.height, viewpoint: header.viewpoint })
}

fn read_ascii(header: &PcdHeader, data: &[u8]) -> Result<Vec<[f32; 3]>, PcdError> {
    let expected = header.points();
    // A number and what ends it take two bytes; the last line may lack its end.
    let needed = expected.saturating_mul(header.columns.saturating_mul(2)).saturating_sub(1);
    if data.len() < needed {
        return Err(PcdError::DataTooShort {
            offset: header.data_offset,
            expected: needed,
            found: data.len(),
        });
    }
    let columns = header.axes.map(|place| header.fields[place].column);
    let mut points = Vec::with_capacity(expected);
    let mut line = header.data_line;
    for text in data.split(|&b| b == b'\n') {
        if let Some(point) = ascii_record(text, line, header.columns, columns)? {
            if points.len() == expected {
                return Err(PcdError::RecordCount { line, expected, found: expected + 1 });
            }
            points.push(checks::point(point));
        }
        line += 1;
    }
    if points.len() != expected {
        return Err(PcdError::RecordCount { line: line - 1, expected, found: points.len() });
    }
    Ok(points)
}

/// One line; `None` where it is blank.
fn ascii_record(
    text: &[u8],
    line: usize,
    expected: usize,
    axes: [usize; 3],
) -> Result<Option<[f32; 3]>, PcdError> {
    let mut point = INVALID_POINT;
    let mut found = 0;
    for word in text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()) {
        if found == expected {
            return Err(PcdError::RecordLength { line, expected, found: found + 1 });
        }
        if let Some(i) = axes.iter().position(|&c| c == found) {
            point[i] = checks::number(word).ok_or_else(|| PcdError::NotANumber {
                line,
                column: found + 1,
                axis: ['x', 'y', 'z'][i],
                found: String::from_utf8_lossy(word).chars().take(32).collect(),
            })?;
        }
        found += 1;
    }
    match found {
        0 => Ok(None),
        n if n == expected => Ok(Some(point)),
        _ => Err(PcdError::RecordLength { line, expected, found }),
    }
}

fn read_binary(header: &PcdHeader, data: &[u8]) -> Result<Vec<[f32; 3]>, PcdError> {
    let expected = header.points() * header.record_size;
    let records = data.get(..expected).ok_or(PcdError::DataTooShort {
        offset: header.data_offset,
        expected,
        found: data.len(),
    })?;
    let axes = header.axes.map(|place| &header.fields[place]);
    checks::surplus(&data[expected..], header.points())?;
    Ok(records
        .chunks_exact(header.record_size)
        .map(|record| checks::point(axes.map(|f| number(f.kind, &record[f.offset..]))))
        .collect())
}

fn read_compressed(header: &PcdHeader, data: &[u8]) -> Result<Vec<[f32; 3]>, PcdError> {
    let points = header.points();
    let expected = points * header.record_size;
    let offset = header.data_offset;
    let short = |expected| PcdError::DataTooShort { offset, expected, found: data.len() };
    let (sizes, packed) = data.split_at_checked(8).ok_or(short(8))?;
    let packed_size = little_endian(&sizes[..4]) as usize;
    let unpacked_size = little_endian(&sizes[4..]) as usize;
    if unpacked_size != expected {
        return Err(PcdError::UnpackedSize { offset: offset + 4, expected, found: unpacked_size });
    }
    let (packed, rest) = packed.split_at_checked(packed_size).ok_or(short(packed_size.saturating_add(8)))?;
    checks::surplus(rest, points)?;
    if expected > packed.len().saturating_mul(lzf::MAX_EXPANSION) {
        return Err(PcdError::Compression { offset: offset + 8, unpacked: 0, expected });
    }
    let unpacked = lzf::unpack(packed, expected).map_err(|damage| PcdError::Compression {
        offset: offset + 8 + damage.read,
        unpacked: damage.unpacked,
        expected,
    })?;
    // Unpacked data holds all of the first field, then all of the second.
    let axes = header.axes.map(|place| {
        let field = &header.fields[place];
        column(&unpacked, field, points)
    });
    Ok((0..points)
        .map(|i| checks::point(axes.map(|(kind, bytes)| number(kind, &bytes[i * kind.size()..]))))
        .collect())
}

fn column<'a>(unpacked: &'a [u8], field: &Field, points: usize) -> (FieldType, &'a [u8]) {
    let start = field.offset * points;
    (field.kind, &unpacked[start..start + points * field.kind.size()])
}

/// Up to eight bytes, least significant first.
fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, &b| value << 8 | u64::from(b))
}

/// The number of type `kind` at the start of `bytes`, in `f32`; the casts keep the sign of narrow integers.
fn number(kind: FieldType, bytes: &[u8]) -> f32 {
    let raw = little_endian(&bytes[..kind.size()]);
    match kind {
        FieldType::I8 => f32::from(raw as u8 as i8),
        FieldType::I16 => f32::from(raw as u16 as i16),
        FieldType::I32 => raw as u32 as i32 as f32,
        FieldType::I64 => raw as i64 as f32,
        FieldType::U8 | FieldType::U16 | FieldType::U32 | FieldType::U64 => raw as f32,
        FieldType::F32 => f32::from_bits(raw as u32),
        FieldType::F64 => f64::from_bits(raw) as f32,
    }
}
