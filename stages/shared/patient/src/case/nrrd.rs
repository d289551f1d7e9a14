//! Volumes from NRRD files: three axes along the patient's, 16 bit integers, gzip or raw, in one file with its header.
//!
//! The format: <https://teem.sourceforge.net/nrrd/format.html>. What a plan cannot stand on is refused by name: other
//! spaces, oblique or exchanged axes, detached data.

use flate2::read::MultiGzDecoder;
use thiserror::Error;

use super::inflate::{InflateError, inflate};
use super::patient::{CaseError, check_grid};
use crate::Grid;

/// A header is a dozen lines; one that does not end in this many bytes is no header.
const LARGEST_HEADER: usize = 1 << 16;
/// How far a direction may lie off its axis, mm per voxel.
const OBLIQUE_MM: f64 = 1e-6;

/// The values of a volume; x runs fastest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Values {
    /// Signed 16 bit.
    I16(Vec<i16>),
    /// Unsigned 16 bit.
    U16(Vec<u16>),
}

/// A volume and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Where its voxels are, in the DICOM patient frame.
    pub grid: Grid,
    /// Its values.
    pub values: Values,
}

/// Why bytes are no such volume.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NrrdError {
    /// Another kind of file.
    #[error("this is no NRRD file: it does not start with `NRRD000`")]
    Magic,
    /// No empty line ends the header.
    #[error("the NRRD header does not end in an empty line: the file is cut off or no NRRD; copy it again")]
    Header,
    /// A field is missing.
    #[error("the NRRD header has no `{0}`: write it with one")]
    Missing(&'static str),
    /// A field cannot be read.
    #[error("the NRRD field `{field}: {text}` cannot be used: {why}")]
    Field {
        /// Name of the field.
        field: &'static str,
        /// Text of the field.
        text: String,
        /// Value that is expected.
        why: &'static str,
    },
    /// The data cannot be unpacked.
    #[error("{0}; copy the file again")]
    Data(#[from] InflateError),
    /// The grid cannot be.
    #[error(transparent)]
    Grid(#[from] CaseError),
}

#[derive(Default)]
struct Fields<'a> {
    kind: Option<&'a str>,
    dimension: Option<&'a str>,
    space: Option<&'a str>,
    sizes: Option<&'a str>,
    directions: Option<&'a str>,
    origin: Option<&'a str>,
    endian: Option<&'a str>,
    encoding: Option<&'a str>,
}

/// The volume that these bytes of an NRRD file hold.
pub fn read_nrrd(bytes: &[u8]) -> Result<Volume, NrrdError> {
    if !bytes.starts_with(b"NRRD000") {
        return Err(NrrdError::Magic);
    }
    let (header, data) = split(bytes).ok_or(NrrdError::Header)?;
    let fields = fields(header)?;
    let signed = match due(fields.kind, "type")? {
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => true,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => false,
        other => {
            return fault("type", other, "int16 (Hounsfield units) or uint16 (labels, centigray) is due");
        }
    };
    let grid = grid(&fields)?;
    let big = match due(fields.endian, "endian")? {
        "little" => false,
        "big" => true,
        other => return fault("endian", other, "`little` or `big` is due"),
    };
    let size = 2 * grid.len();
    let raw = match due(fields.encoding, "encoding")? {
        "gzip" | "gz" => inflate(MultiGzDecoder::new(data), data.len(), size)?,
        "raw" => inflate(data, data.len(), size)?,
        other => return fault("encoding", other, "`gzip` or `raw` is due"),
    };
    let words = raw.chunks_exact(2).map(|b| match big {
        false => u16::from_le_bytes([b[0], b[1]]),
        true => u16::from_be_bytes([b[0], b[1]]),
    });
    let values = match signed {
        true => Values::I16(words.map(|w| w as i16).collect()),
        false => Values::U16(words.collect()),
    };
    Ok(Volume { grid, values })
}

fn fault<T>(field: &'static str, text: &str, why: &'static str) -> Result<T, NrrdError> {
    Err(NrrdError::Field { field, text: text.chars().take(80).collect(), why })
}

fn due<'a>(field: Option<&'a str>, name: &'static str) -> Result<&'a str, NrrdError> {
    field.ok_or(NrrdError::Missing(name))
}

/// The header's text and the data after the empty line.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let searched = &bytes[..bytes.len().min(LARGEST_HEADER)];
    let (end, gap) = (0..searched.len()).find_map(|i| {
        let rest = &searched[i..];
        if rest.starts_with(b"\n\n") { Some((i, 2)) } else { rest.starts_with(b"\r\n\r\n").then_some((i, 4)) }
    })?;
    Some((std::str::from_utf8(&bytes[..end]).ok()?, &bytes[end + gap..]))
}

fn fields(header: &str) -> Result<Fields<'_>, NrrdError> {
    let mut fields = Fields::default();
    for line in header.lines().skip(1).filter(|l| !l.starts_with('#')) {
        let Some((name, text)) = line.split_once(": ") else { continue };
        let text = text.trim();
        let slot = match name {
            "type" => &mut fields.kind,
            "dimension" => &mut fields.dimension,
            "space" => &mut fields.space,
            "sizes" => &mut fields.sizes,
            "space directions" => &mut fields.directions,
            "space origin" => &mut fields.origin,
            "endian" => &mut fields.endian,
            "encoding" => &mut fields.encoding,
            "data file" | "datafile" => {
                return fault(
                    "data file",
                    text,
                    "data beside the header are not read: write header and data in one file",
                );
            }
            "line skip" | "lineskip" | "byte skip" | "byteskip" => {
                return fault("skip", line, "data must begin right after the header");
            }
            _ => continue,
        };
        *slot = Some(text);
    }
    Ok(fields)
}

fn grid(fields: &Fields<'_>) -> Result<Grid, NrrdError> {
    let dimension = due(fields.dimension, "dimension")?;
    if dimension != "3" {
        return fault("dimension", dimension, "volumes have 3 axes");
    }
    let space = due(fields.space, "space")?;
    if !matches!(space.to_ascii_lowercase().as_str(), "left-posterior-superior" | "lps") {
        return fault("space", space, "left-posterior-superior is due: resample the volume into it");
    }
    let sizes = due(fields.sizes, "sizes")?;
    let mut counts = [0; 3];
    let mut words = sizes.split_whitespace();
    for count in &mut counts {
        match words.next().and_then(|w| w.parse().ok()) {
            Some(n) => *count = n,
            None => return fault("sizes", sizes, "three whole numbers are due"),
        }
    }
    if words.next().is_some() {
        return fault("sizes", sizes, "three whole numbers are due");
    }
    let text = due(fields.directions, "space directions")?;
    let Some(directions) = vectors::<3>(text) else {
        return fault("space directions", text, "three vectors like (3,0,0) are due");
    };
    let mut spacing_mm = [0.0; 3];
    for (axis, direction) in directions.iter().enumerate() {
        let off = (0..3).filter(|&a| a != axis).any(|a| direction[a].abs() > OBLIQUE_MM);
        if off || direction[axis] <= 0.0 {
            let why = "the axes must run to the left, the back and the head, in this order, not oblique: resample the volume";
            return fault("space directions", text, why);
        }
        spacing_mm[axis] = direction[axis];
    }
    let text = due(fields.origin, "space origin")?;
    let Some([origin_mm]) = vectors::<1>(text) else {
        return fault("space origin", text, "one vector like (-250,-250,-160) is due");
    };
    let grid = Grid { counts, spacing_mm, origin_mm };
    check_grid(&grid)?;
    Ok(grid)
}

/// `N` vectors of three finite numbers: `(a,b,c) (d,e,f)`.
fn vectors<const N: usize>(text: &str) -> Option<[[f64; 3]; N]> {
    let mut vectors = [[0.0; 3]; N];
    let mut rest = text.trim();
    for vector in &mut vectors {
        let (inner, after) = rest.strip_prefix('(')?.split_once(')')?;
        let mut numbers = inner.split(',');
        for number in vector.iter_mut() {
            *number = numbers.next()?.trim().parse().ok().filter(|v: &f64| v.is_finite())?;
        }
        if numbers.next().is_some() {
            return None;
        }
        rest = after.trim_start();
    }
    rest.is_empty().then_some(vectors)
}
