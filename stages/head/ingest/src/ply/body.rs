//! The rows of a PLY file, text or binary, to points.

use super::PlyError;
use super::header::{Element, Encoding, Header, Scalar};
use crate::checks::{self, quoted};

/// The vertices of the data behind a header. Elements before the vertices are passed over. Text behind the vertices must
/// be the rows that the header says, since a missing vertex would make one of the row behind it; binary faces that are cut
/// off leave the vertices whole.
///
/// # Errors
/// What is wrong with the data.
pub fn vertices(header: &Header, data: &[u8]) -> Result<Vec<[f32; 3]>, PlyError> {
    let place = header.elements.iter().position(|e| e.name == "vertex").ok_or(PlyError::NoVertices)?;
    let axes = header.elements[place].axes().ok_or(PlyError::NoVertices)?;
    match header.encoding {
        Encoding::Ascii => text(header, place, axes, data),
        order => binary(header, place, axes, data, order == Encoding::BigEndian),
    }
}

fn text(header: &Header, place: usize, axes: [usize; 3], data: &[u8]) -> Result<Vec<[f32; 3]>, PlyError> {
    let mut points = Vec::with_capacity(header.elements[place].rows);
    let is_blank = |line: &&[u8]| line.iter().all(u8::is_ascii_whitespace);
    let mut lines = data.split(|b| *b == b'\n').filter(|line| !is_blank(line));
    for (number, element) in header.elements.iter().enumerate() {
        for row in 1..=element.rows {
            let name = || quoted(&element.name);
            let Some(line) = lines.next() else {
                return Err(PlyError::Short { element: name(), expected: element.rows, row });
            };
            let point = text_row(element, row, (number == place).then_some(axes), line)?;
            points.extend(point.map(checks::point));
        }
    }
    let rest: usize = lines.map(|line| line.len() + 1).sum();
    if rest > 0 {
        let rows = header.elements.iter().map(|e| e.rows).sum::<usize>();
        return Err(PlyError::Surplus(format!(
            "the header says {rows} rows, and {rest} bytes of data follow the last one: correct the header"
        )));
    }
    Ok(points)
}

/// One line; its point where the element is that of the vertices.
fn text_row(
    element: &Element,
    row: usize,
    axes: Option<[usize; 3]>,
    line: &[u8],
) -> Result<Option<[f32; 3]>, PlyError> {
    let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
    let shown = |bytes: &[u8]| quoted(String::from_utf8_lossy(bytes).trim());
    let bad = |expected| PlyError::Row {
        element: quoted(&element.name),
        row,
        found: shown(line),
        count: words.len(),
        expected,
    };
    let number = |at: usize, expected: usize, scalar: Scalar| {
        let word = *words.get(at).ok_or_else(|| bad(expected))?;
        let value = match scalar {
            Scalar::F64 => checks::double(word),
            _ => checks::number(word).map(f64::from),
        };
        value.ok_or_else(|| PlyError::NotANumber { element: quoted(&element.name), row, found: shown(word) })
    };
    let (mut at, mut point) = (0, [f32::NAN; 3]);
    // What stands before the end of the row cannot be fewer numbers than its properties.
    let least = element.properties.len();
    for (property, found) in element.properties.iter().enumerate() {
        if let Some(scalar) = found.count {
            let count = number(at, least, scalar)?;
            let whole = count >= 0.0 && count.fract() == 0.0;
            let end = if whole { at.saturating_add(1).saturating_add(count as usize) } else { usize::MAX };
            if end > words.len() {
                return Err(bad(end));
            }
            at = end;
            continue;
        }
        let value = number(at, least, found.scalar)?;
        if let Some(axis) = axes.and_then(|axes| axes.iter().position(|a| *a == property)) {
            point[axis] = value as f32;
        }
        at += 1;
    }
    match at == words.len() {
        true => Ok(axes.map(|_| point)),
        false => Err(bad(at)),
    }
}

fn binary(
    header: &Header,
    place: usize,
    axes: [usize; 3],
    data: &[u8],
    big_endian: bool,
) -> Result<Vec<[f32; 3]>, PlyError> {
    let mut rest = data;
    let mut points = Vec::with_capacity(header.elements[place].rows);
    for (number, element) in header.elements.iter().enumerate() {
        for row in 1..=element.rows {
            let mut point = [f32::NAN; 3];
            match binary_row(element, axes, &mut rest, big_endian, &mut point) {
                Some(()) if number == place => points.push(checks::point(point)),
                Some(()) => {}
                None if number > place => return Ok(points),
                None => {
                    let element_name = quoted(&element.name);
                    return Err(PlyError::Short { element: element_name, expected: element.rows, row });
                }
            }
        }
    }
    let rows = header.elements.iter().map(|e| e.rows).sum();
    checks::surplus(rest, rows).map_err(PlyError::Surplus)?;
    Ok(points)
}

/// Takes a row off the data; `None` where the data ends before.
fn binary_row(
    element: &Element,
    axes: [usize; 3],
    rest: &mut &[u8],
    big_endian: bool,
    point: &mut [f32; 3],
) -> Option<()> {
    for (place, property) in element.properties.iter().enumerate() {
        let Some(count) = property.count else {
            let value = take(rest, property.scalar, big_endian)?;
            if let Some(axis) = axes.iter().position(|a| *a == place) {
                point[axis] = value as f32;
            }
            continue;
        };
        let count = take(rest, count, big_endian)?;
        if !(count >= 0.0 && count.fract() == 0.0) {
            return None;
        }
        let bytes = (count as usize).checked_mul(property.scalar.size())?;
        *rest = rest.get(bytes..)?;
    }
    Some(())
}

fn take(rest: &mut &[u8], scalar: Scalar, big_endian: bool) -> Option<f64> {
    let (bytes, behind) = rest.split_at_checked(scalar.size())?;
    *rest = behind;
    let value = match big_endian {
        true => bytes.iter().fold(0, |value, b| value << 8 | u64::from(*b)),
        false => bytes.iter().rev().fold(0, |value, b| value << 8 | u64::from(*b)),
    };
    Some(scalar.value(value))
}
