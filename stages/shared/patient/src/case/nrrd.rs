//! Volumes from NRRD files: three axes along the patient's in either direction, integers or floats, gzip or raw, in one file
//! with the header or beside it.
//!
//! The format: <https://teem.sourceforge.net/nrrd/format.html>. Values are turned into the order of the DICOM patient frame.
//! What a plan cannot stand on is refused by name: spaces that do not say where the patient's left is, oblique or exchanged
//! axes.

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
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Unsigned 8 bit.
    U8(Vec<u8>),
    /// Signed 16 bit.
    I16(Vec<i16>),
    /// Unsigned 16 bit.
    U16(Vec<u16>),
    /// Unsigned 32 bit.
    U32(Vec<u32>),
    /// Signed 32 bit, or floats of 32 or 64 bits.
    F64(Vec<f64>),
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
    #[error("this is not an NRRD file: it does not start with `NRRD000`")]
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
    /// The file of the data cannot be read.
    #[error("the data file of the header, {}, cannot be read: {why}", path.display())]
    DataFile {
        /// Its path.
        path: std::path::PathBuf,
        /// Error of the operating system.
        why: String,
    },
    /// Uncompressed data are longer than the volume.
    #[error(
        "the data have {found} bytes, but the volume has {expected}: a byte was added, or `sizes` or `type` is wrong"
    )]
    Long {
        /// Bytes of the volume.
        expected: usize,
        /// Bytes of the data.
        found: usize,
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
    data_file: Option<&'a str>,
}

/// How a number is written.
#[derive(Clone, Copy)]
enum Kind {
    U8,
    I16,
    U16,
    U32,
    I32,
    F32,
    F64,
}

impl Kind {
    fn of(text: &str) -> Result<Self, NrrdError> {
        Ok(match text {
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => Self::U8,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Self::I16,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Self::U16,
            "int" | "signed int" | "int32" | "int32_t" => Self::I32,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => Self::U32,
            "float" => Self::F32,
            "double" => Self::F64,
            other => {
                return fault(
                    "type",
                    other,
                    "int16, int32, float or double (Hounsfield units), or uint8, uint16 or uint32 (labels, centigray) is required",
                );
            }
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// The volume that these bytes of an NRRD file hold.
pub fn read_nrrd(bytes: &[u8]) -> Result<Volume, NrrdError> {
    read_detached(bytes, |name| {
        Err(NrrdError::Field {
            field: "data file",
            text: name.to_owned(),
            why: "a volume in memory has no files next to it: write header and data in one file",
        })
    })
}

/// The volume that these bytes of an NRRD file hold; `sibling` reads the file that its header names, if it names one.
pub(crate) fn read_detached(
    bytes: &[u8],
    sibling: impl FnOnce(&str) -> Result<Vec<u8>, NrrdError>,
) -> Result<Volume, NrrdError> {
    if !bytes.starts_with(b"NRRD000") {
        return Err(NrrdError::Magic);
    }
    // A header alone may end without an empty line.
    let (header, data) = match split(bytes) {
        Some(both) => both,
        None => match std::str::from_utf8(bytes) {
            Ok(header) if bytes.len() <= LARGEST_HEADER && names_data(header) => (header, &[][..]),
            _ => return Err(NrrdError::Header),
        },
    };
    let fields = fields(header)?;
    let kind = Kind::of(expected(fields.kind, "type")?)?;
    let (grid, flipped) = grid(&fields)?;
    let is_big = match (fields.endian, kind) {
        (None, Kind::U8) => false,
        (endian, _) => match expected(endian, "endian")? {
            "little" => false,
            "big" => true,
            other => return fault("endian", other, "`little` or `big` is required"),
        },
    };
    let detached = match fields.data_file {
        None => None,
        Some(name) => {
            if name.starts_with("LIST") || name.contains('%') || name.contains(['/', '\\']) {
                return fault(
                    "data file",
                    name,
                    "the name of one file in the folder of the header is required",
                );
            }
            Some(sibling(name)?)
        }
    };
    let data = detached.as_deref().unwrap_or(data);
    let size = kind.bytes() * grid.len();
    let mut raw = match expected(fields.encoding, "encoding")? {
        "gzip" | "gz" => inflate(MultiGzDecoder::new(data), data.len(), size)?,
        "raw" if data.len() > size => {
            return Err(NrrdError::Long { expected: size, found: data.len() });
        }
        "raw" => inflate(data, data.len(), size)?,
        other => return fault("encoding", other, "`gzip` or `raw` is required"),
    };
    if is_big {
        raw.chunks_exact_mut(kind.bytes()).for_each(<[u8]>::reverse);
    }
    let values = match kind {
        Kind::U8 => Values::U8(raw),
        Kind::I16 => Values::I16(words(&raw, i16::from_le_bytes)),
        Kind::U16 => Values::U16(words(&raw, u16::from_le_bytes)),
        Kind::U32 => Values::U32(words(&raw, u32::from_le_bytes)),
        Kind::I32 => Values::F64(words(&raw, |b| f64::from(i32::from_le_bytes(b)))),
        Kind::F32 => Values::F64(words(&raw, |b| f64::from(f32::from_le_bytes(b)))),
        Kind::F64 => Values::F64(words(&raw, f64::from_le_bytes)),
    };
    Ok(Volume { grid, values: values.turned(&grid, flipped) })
}

fn words<const N: usize, T>(raw: &[u8], of: impl Fn([u8; N]) -> T) -> Vec<T> {
    raw.as_chunks::<N>().0.iter().map(|bytes| of(*bytes)).collect()
}

fn names_data(header: &str) -> bool {
    header.lines().any(|line| line.starts_with("data file: ") || line.starts_with("datafile: "))
}

impl Values {
    /// The values with these axes the other way round.
    fn turned(self, grid: &Grid, flipped: [bool; 3]) -> Self {
        fn turn<T: Copy>(values: Vec<T>, grid: &Grid, flipped: [bool; 3]) -> Vec<T> {
            if flipped == [false; 3] {
                return values;
            }
            let from = |index| {
                let voxel = grid.voxel(index);
                let axis = |a: usize| if flipped[a] { grid.counts[a] - 1 - voxel[a] } else { voxel[a] };
                values[grid.index(std::array::from_fn(axis))]
            };
            (0..values.len()).map(from).collect()
        }
        match self {
            Self::U8(v) => Self::U8(turn(v, grid, flipped)),
            Self::I16(v) => Self::I16(turn(v, grid, flipped)),
            Self::U16(v) => Self::U16(turn(v, grid, flipped)),
            Self::U32(v) => Self::U32(turn(v, grid, flipped)),
            Self::F64(v) => Self::F64(turn(v, grid, flipped)),
        }
    }
}

fn fault<T>(field: &'static str, text: &str, why: &'static str) -> Result<T, NrrdError> {
    Err(NrrdError::Field { field, text: text.chars().take(80).collect(), why })
}

fn expected<'a>(field: Option<&'a str>, name: &'static str) -> Result<&'a str, NrrdError> {
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
            "data file" | "datafile" => &mut fields.data_file,
            "line skip" | "lineskip" | "byte skip" | "byteskip" => {
                return fault("skip", line, "data must begin right after the header");
            }
            _ => continue,
        };
        *slot = Some(text);
    }
    Ok(fields)
}

/// The grid in the DICOM patient frame, and which axes of the file run against it.
fn grid(fields: &Fields<'_>) -> Result<(Grid, [bool; 3]), NrrdError> {
    let dimension = expected(fields.dimension, "dimension")?;
    if dimension != "3" {
        return fault("dimension", dimension, "volumes have 3 axes");
    }
    let space = expected(fields.space, "space")?;
    let Some(signs) = signs(space) else {
        let why = "left or right, posterior or anterior, superior or inferior are required in this order, like left-posterior-superior or RAS";
        return fault("space", space, why);
    };
    let sizes = expected(fields.sizes, "sizes")?;
    let mut counts = [0; 3];
    let mut words = sizes.split_whitespace();
    for count in &mut counts {
        match words.next().and_then(|w| w.parse().ok()) {
            Some(n) => *count = n,
            None => return fault("sizes", sizes, "three whole numbers are expected"),
        }
    }
    if words.next().is_some() {
        return fault("sizes", sizes, "three whole numbers are expected");
    }
    let text = expected(fields.directions, "space directions")?;
    let Some(directions) = vectors::<3>(text) else {
        return fault("space directions", text, "three vectors like (3,0,0) are expected");
    };
    let mut spacing_mm = [0.0; 3];
    let mut flipped = [false; 3];
    for (axis, direction) in directions.iter().enumerate() {
        if direction.iter().all(|d| d.abs() <= OBLIQUE_MM) {
            return fault(
                "space directions",
                text,
                "an axis has the spacing 0 mm: 0.01 mm to 100 mm is required",
            );
        }
        if (0..3).filter(|&a| a != axis).any(|a| direction[a].abs() > OBLIQUE_MM) {
            let why = "the axes must run along left, posterior and superior, in this order, not oblique: resample the volume";
            return fault("space directions", text, why);
        }
        let along_mm = signs[axis] * direction[axis];
        (spacing_mm[axis], flipped[axis]) = (along_mm.abs(), along_mm < 0.0);
    }
    let text = expected(fields.origin, "space origin")?;
    let Some([origin_mm]) = vectors::<1>(text) else {
        return fault("space origin", text, "one vector like (-250,-250,-160) is expected");
    };
    // Of an axis that runs against the frame, the last voxel is the first of the grid.
    let first = |axis: usize| {
        let back_mm =
            if flipped[axis] { (counts[axis] as f64 - 1.0).max(0.0) * spacing_mm[axis] } else { 0.0 };
        signs[axis] * origin_mm[axis] - back_mm
    };
    let grid = Grid { counts, spacing_mm, origin_mm: std::array::from_fn(first) };
    check_grid(&grid)?;
    Ok((grid, flipped))
}

/// What a coordinate of this space is along left, posterior and superior.
fn signs(space: &str) -> Option<[f64; 3]> {
    let space = space.to_ascii_lowercase();
    let mut letters = match space.contains('-') {
        true => space.split('-').filter_map(|word| word.chars().next()).collect::<Vec<_>>(),
        false => space.chars().collect(),
    };
    letters.truncate(4);
    let [x, y, z] = letters[..] else { return None };
    let sign = |letter: char, along: char, against: char| match letter {
        l if l == along => Some(1.0),
        l if l == against => Some(-1.0),
        _ => None,
    };
    Some([sign(x, 'l', 'r')?, sign(y, 'p', 'a')?, sign(z, 's', 'i')?])
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
