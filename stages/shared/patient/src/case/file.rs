//! The case file and its hash.
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..8 | `SPCASE01` |
//! | 8..40 | SHA-256 of the content |
//! | 40..44 | length of the header, u32 little endian |
//! | header | JSON: name, grid, structures, isocentre, prescription, UIDs, provenance |
//! | blocks | each a u64 little endian length, and so many bytes of zlib (RFC 1950) |
//!
//! The blocks are the CT (i16, little endian), each structure's mask in the order of the header (eight voxels to a byte,
//! least significant bit first), and the reference dose (f32, little endian) if the header has one; in all of them x runs
//! fastest, then y, then z. The content is the header's length and bytes and all blocks as they are before compression,
//! so that a case has one hash whatever packed it.

use std::fmt;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::inflate::{InflateError, inflate};
use super::mask::Mask;
use super::patient::{Case, CaseError, CaseParts, Prescription, check_grid};
use super::position::PatientPosition;
use super::structure::{Role, Structure};
use super::uid::Uids;
use crate::Grid;

const MAGIC: &[u8; 8] = b"SPCASE01";
/// A header is kilobytes; more is no header.
const LARGEST_HEADER: usize = 1 << 20;

/// SHA-256 of a case's content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ContentHash(pub [u8; 32]);

impl fmt::Display for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// Why bytes are no case.
#[derive(Debug, Error)]
pub enum CaseFileError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// What a file holds is no case.
    #[error("{}: {source}", path.display())]
    Content {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: Box<CaseFileError>,
    },
    /// Another kind of file.
    #[error("this is not a case file of version 1: make one with `stillpoint case import`")]
    Magic,
    /// The file ends early.
    #[error("the case file ends early, in {0}: copy it again, or import the case again")]
    Short(&'static str),
    /// The file goes on.
    #[error("{0} bytes follow the end of the case: copy it again, or import the case again")]
    Trailing(usize),
    /// The header cannot be read.
    #[error("the header of the case file is wrong: {0}")]
    Header(String),
    /// A block cannot be unpacked.
    #[error("{block} of the case file: {source}; copy it again, or import the case again")]
    Block {
        /// Which block.
        block: String,
        /// The underlying error.
        source: InflateError,
    },
    /// A mask has bits beyond the volume.
    #[error("the mask of {0:?} has voxels beyond the grid")]
    Mask(String),
    /// The content is not that which was written.
    #[error(
        "the content has hash {found}, but the file says {expected}: it is damaged; copy it again, or import the case again"
    )]
    Hash {
        /// Hash in the file.
        expected: ContentHash,
        /// Hash of what is there.
        found: ContentHash,
    },
    /// The parts make no case.
    #[error(transparent)]
    Case(#[from] CaseError),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    name: String,
    counts: [usize; 3],
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
    isocentre_mm: [f64; 3],
    structures: Vec<Named>,
    prescription: Vec<Prescription>,
    fractions: Option<u32>,
    reference_dose: bool,
    uids: Option<Uids>,
    provenance: String,
    #[serde(default, skip_serializing_if = "PatientPosition::is_default")]
    position: PatientPosition,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Named {
    name: String,
    role: Role,
}

/// The case in a file.
pub fn read(path: &Path) -> Result<Case, CaseFileError> {
    let bytes =
        std::fs::read(path).map_err(|source| CaseFileError::File { path: path.to_owned(), source })?;
    from_bytes(&bytes)
        .map_err(|source| CaseFileError::Content { path: path.to_owned(), source: Box::new(source) })
}

/// Writes a case to a file that only its owner can read, and says its hash. A file of that name is replaced whole.
pub fn write(case: &Case, path: &Path) -> Result<ContentHash, CaseFileError> {
    let fault = |source| CaseFileError::File { path: path.to_owned(), source };
    let (bytes, hash) = to_bytes(case)?;
    let mut name = path.file_name().ok_or_else(|| fault(ErrorKind::InvalidInput.into()))?.to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let written = private(&part).and_then(|mut file| {
        file.write_all(&bytes)?;
        file.sync_all()
    });
    written.and_then(|()| std::fs::rename(&part, path)).map_err(|source| {
        // The half-written file is of no use; that it cannot be removed either is the same fault.
        let _ = std::fs::remove_file(&part);
        fault(source)
    })?;
    Ok(hash)
}

fn private(path: &Path) -> std::io::Result<std::fs::File> {
    use std::os::unix::fs::OpenOptionsExt;
    std::fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(path)
}

/// SHA-256 of the content of a case; the same for the same content, on every machine.
pub fn content_hash(case: &Case) -> Result<ContentHash, CaseFileError> {
    let header = header(case)?;
    let mut hasher = hasher(&header);
    for block in blocks(case) {
        hasher.update(&block);
    }
    Ok(ContentHash(hasher.finalize().into()))
}

/// The bytes of a case file, and the hash of its content.
pub fn to_bytes(case: &Case) -> Result<(Vec<u8>, ContentHash), CaseFileError> {
    let header = header(case)?;
    let mut hasher = hasher(&header);
    let mut bytes = MAGIC.to_vec();
    bytes.extend([0; 32]);
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(&header);
    for block in blocks(case) {
        hasher.update(&block);
        let packed = deflate(&block).map_err(|e| CaseFileError::Header(e.to_string()))?;
        bytes.extend((packed.len() as u64).to_le_bytes());
        bytes.extend(packed);
    }
    let hash = ContentHash(hasher.finalize().into());
    bytes[8..40].copy_from_slice(&hash.0);
    Ok((bytes, hash))
}

/// The case that these bytes hold.
pub fn from_bytes(bytes: &[u8]) -> Result<Case, CaseFileError> {
    let mut rest = bytes;
    if take(&mut rest, MAGIC.len()) != Some(&MAGIC[..]) {
        return Err(CaseFileError::Magic);
    }
    let mut expected = ContentHash([0; 32]);
    expected.0.copy_from_slice(take(&mut rest, 32).ok_or(CaseFileError::Short("its hash"))?);
    let length = number::<4>(&mut rest).map(u32::from_le_bytes).ok_or(CaseFileError::Short("its header"))?;
    if length as usize > LARGEST_HEADER {
        return Err(CaseFileError::Header(format!("it is {length} bytes long")));
    }
    let text = take(&mut rest, length as usize).ok_or(CaseFileError::Short("its header"))?;
    let header: Header =
        serde_json::from_slice(text).map_err(|error| CaseFileError::Header(error.to_string()))?;
    let grid = Grid { counts: header.counts, spacing_mm: header.spacing_mm, origin_mm: header.origin_mm };
    check_grid(&grid)?;
    let voxels = grid.len();
    let mut hasher = hasher(text);
    let mut block = |name: &str, size: usize| {
        let raw = unpack(&mut rest, name, size)?;
        hasher.update(&raw);
        Ok::<_, CaseFileError>(raw)
    };
    let hu = block("the CT", 2 * voxels)?.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect();
    let mut structures = Vec::new();
    for Named { name, role } in header.structures {
        let raw = block("a mask", voxels.div_ceil(8))?;
        let mask = Mask::from_bytes(voxels, &raw).ok_or_else(|| CaseFileError::Mask(name.clone()))?;
        structures.push(Structure { name, role, mask });
    }
    let mut reference_dose_gy = None;
    if header.reference_dose {
        let raw = block("the reference dose", 4 * voxels)?;
        let value = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        reference_dose_gy = Some(raw.chunks_exact(4).map(value).collect());
    }
    if !rest.is_empty() {
        return Err(CaseFileError::Trailing(rest.len()));
    }
    let found = ContentHash(hasher.finalize().into());
    if found != expected {
        return Err(CaseFileError::Hash { expected, found });
    }
    let case = Case::new(CaseParts {
        name: header.name,
        grid,
        hu,
        structures,
        isocentre_mm: Some(header.isocentre_mm),
        prescription: header.prescription,
        fractions: header.fractions,
        reference_dose_gy,
        uids: header.uids,
        provenance: header.provenance,
    })?;
    Ok(case.lying(header.position))
}

fn header(case: &Case) -> Result<Vec<u8>, CaseFileError> {
    let grid = case.grid();
    let named = |s: &Structure| Named { name: s.name.clone(), role: s.role };
    let header = Header {
        name: case.name().to_owned(),
        counts: grid.counts,
        spacing_mm: grid.spacing_mm,
        origin_mm: grid.origin_mm,
        isocentre_mm: case.isocentre_mm(),
        structures: case.structures().iter().map(named).collect(),
        prescription: case.prescription().to_vec(),
        fractions: case.fractions(),
        reference_dose: case.reference_dose_gy().is_some(),
        uids: case.uids().cloned(),
        provenance: case.provenance().to_owned(),
        position: case.position(),
    };
    let text = serde_json::to_vec(&header).map_err(|error| CaseFileError::Header(error.to_string()))?;
    match text.len() <= LARGEST_HEADER {
        true => Ok(text),
        false => Err(CaseFileError::Header(format!("it would be {} bytes long", text.len()))),
    }
}

fn hasher(header: &[u8]) -> Sha256 {
    let mut hasher = Sha256::new();
    hasher.update((header.len() as u32).to_le_bytes());
    hasher.update(header);
    hasher
}

/// The blocks of a case before compression, one at a time.
fn blocks(case: &Case) -> impl Iterator<Item = Vec<u8>> + '_ {
    let ct = std::iter::once_with(|| case.hu().iter().flat_map(|v| v.to_le_bytes()).collect());
    let masks = case.structures().iter().map(|s| s.mask.to_bytes());
    let dose = case.reference_dose_gy().into_iter();
    ct.chain(masks).chain(dose.map(|d| d.iter().flat_map(|v| v.to_le_bytes()).collect()))
}

fn deflate(raw: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(raw)?;
    encoder.finish()
}

fn unpack(rest: &mut &[u8], name: &str, size: usize) -> Result<Vec<u8>, CaseFileError> {
    let length = number::<8>(rest).map(u64::from_le_bytes).ok_or(CaseFileError::Short("its blocks"))?;
    let packed = usize::try_from(length).ok().and_then(|l| take(rest, l));
    let packed = packed.ok_or(CaseFileError::Short("its blocks"))?;
    inflate(ZlibDecoder::new(packed), packed.len(), size)
        .map_err(|source| CaseFileError::Block { block: name.to_owned(), source })
}

fn take<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (taken, after) = rest.split_at_checked(length)?;
    *rest = after;
    Some(taken)
}

fn number<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    rest.read_exact(&mut bytes).ok()?;
    Some(bytes)
}
