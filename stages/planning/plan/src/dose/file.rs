//! The file of one beam's dose, read where it lies: on disk, or in memory.
//!
//! | bytes | what, all little endian |
//! | --- | --- |
//! | 0..8 | `SPDOSE02`; `SPDOSE03` where the couch is turned |
//! | 8..40 | the key: SHA-256 of all that the dose depends on |
//! | 40..44 | CRC-32 of the bytes from 48 on |
//! | 44..48 | 0 |
//! | 48..56 | gantry angle, degrees, f64 |
//! | 56..80 | rows, columns, entries, u64 each |
//! | 80..88 | of `SPDOSE03` alone: couch angle, degrees, f64 |
//! | columns | bixel centres, two f64 each |
//! | rows + 1 | row starts, u32 |
//! | entries | values, f32 |
//! | entries | columns, u16 |

use super::angles::BeamAngles;
use super::beam::BeamRows;
use crate::{RowsError, RowsRef};
use sha2::{Digest, Sha256};
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;
use stillpoint_map::{MappedFile, publish_derived};
use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

const MAGIC: &[u8; 8] = b"SPDOSE02";
/// Of a beam with a couch angle, which follows the header.
const MAGIC_WITH_COUCH: &[u8; 8] = b"SPDOSE03";
const HEADER: usize = 80;
const _: () =
    assert!(cfg!(target_endian = "little"), "dose files are mapped as they are, in little-endian order");

/// SHA-256 of all that a beam's dose depends on.
pub(super) type Key = [u8; 32];

/// Why a file is not the dose that is looked for.
#[derive(Debug, Error)]
pub enum BeamFileError {
    /// It cannot be read.
    #[error("{0}")]
    File(#[from] io::Error),
    /// It is another kind of file.
    #[error("it is not a dose file of version 2 or 3")]
    Magic,
    /// It belongs to other inputs.
    #[error("it is the dose of another patient, machine or beam")]
    Key,
    /// Its header does not fit its size.
    #[error("it has {found} bytes, but {rows} rows, {columns} columns and {entries} entries do not fit that")]
    Size {
        /// Bytes of the file.
        found: usize,
        /// Rows, as the header says.
        rows: u64,
        /// Columns, as the header says.
        columns: u64,
        /// Entries, as the header says.
        entries: u64,
    },
    /// Its bytes have changed since it was written.
    #[error("its checksum is {found:08x}, but {stored:08x} was written")]
    Checksum {
        /// Of the bytes that are there.
        found: u32,
        /// Of the bytes that were written.
        stored: u32,
    },
    /// A bixel or an angle is not finite, or the beam is another one.
    #[error("a bixel's place or an angle of the beam is not a number")]
    Place,
    /// Its entries are no matrix.
    #[error("{0}")]
    Matrix(#[from] RowsError),
}

/// A beam's dose in a mapped file, or in memory as such a file.
#[derive(Debug)]
pub struct BeamFile {
    file: Held,
    layout: Layout,
}

/// Where the bytes of a file are. They are aligned for every number.
#[derive(Debug)]
enum Held {
    Mapped(MappedFile),
    /// Words of the file and its length, bytes.
    Memory(Vec<u64>, usize),
}

impl Held {
    fn in_memory(bytes: &[u8]) -> Self {
        let (words, length) = words_of(bytes);
        Self::Memory(words, length)
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Self::Mapped(file) => file.bytes(),
            Self::Memory(words, length) => &words.as_bytes()[..*length],
        }
    }
}

/// Words that hold these bytes, and their number.
fn words_of(bytes: &[u8]) -> (Vec<u64>, usize) {
    let mut words = vec![0_u64; bytes.len().div_ceil(size_of::<u64>())];
    words.as_mut_bytes()[..bytes.len()].copy_from_slice(bytes);
    (words, bytes.len())
}

impl BeamFile {
    /// Maps and checks the file of this key.
    pub(super) fn open(path: &Path, key: &Key) -> Result<Self, BeamFileError> {
        Self::checked(Held::Mapped(MappedFile::open(path)?), key)
    }

    /// Copies and checks the bytes of the file of this key.
    pub(super) fn of_bytes(bytes: &[u8], key: &Key) -> Result<Self, BeamFileError> {
        Self::checked(Held::in_memory(bytes), key)
    }

    fn checked(file: Held, key: &Key) -> Result<Self, BeamFileError> {
        let layout = Layout::of(file.bytes(), key)?;
        Ok(Self { file, layout })
    }

    /// Maps and checks a file of any key: the caller knows by other means that it is the wanted one.
    ///
    /// # Errors
    /// The file cannot be read, or it is no dose.
    pub fn open_any(path: &Path) -> Result<Self, BeamFileError> {
        Self::of_mapped(MappedFile::open(path)?)
    }

    /// The same of a file that is mapped.
    ///
    /// # Errors
    /// It is no dose.
    pub fn of_mapped(file: MappedFile) -> Result<Self, BeamFileError> {
        let key = file.bytes().get(8..40).and_then(|key| key.try_into().ok()).ok_or(BeamFileError::Magic)?;
        Self::checked(Held::Mapped(file), &key)
    }

    /// Whether bytes that lie anywhere in memory begin as such a file of these angles and have its checksum. It does not look
    /// at the key or at the matrix.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn check_bytes(bytes: &[u8], angles: impl Into<BeamAngles>) -> Result<(), BeamFileError> {
        let (header, found_angles) = opened(bytes)?;
        let (found, stored) = (crc32fast::hash(&bytes[48..]), word(header, 40));
        if u64::from(found) != stored {
            return Err(BeamFileError::Checksum { found, stored: stored as u32 });
        }
        if same_bits(found_angles, angles.into()) { Ok(()) } else { Err(BeamFileError::Place) }
    }

    /// The file.
    pub fn bytes(&self) -> &[u8] {
        self.file.bytes()
    }

    /// Where the beam comes from.
    pub fn angles(&self) -> BeamAngles {
        self.layout.angles
    }

    /// Centres of the bixels on the isocentre plane, x and z in the beam's frame, mm.
    pub fn bixels_mm(&self) -> &[[f64; 2]] {
        self.layout.bixels(self.file.bytes())
    }

    /// Dose by voxel of the dose grid and bixel, gray per unit weight. All entries are positive.
    pub fn dose(&self) -> RowsRef<'_> {
        self.layout.dose(self.file.bytes())
    }

    /// The same dose in memory with each row times its factor: not the dose that the key stands for, so its key is another.
    /// Rows without a factor stay as they are.
    pub(crate) fn scaled(&self, factors: &[f32]) -> Self {
        let (mut words, length) = words_of(self.file.bytes());
        let bytes = &mut words.as_mut_bytes()[..length];
        let starts: Vec<u32> = numbers(&bytes[self.layout.starts.clone()]).to_vec();
        let values = <[f32]>::mut_from_bytes(&mut bytes[self.layout.value.clone()]).unwrap_or_default();
        for (row, factor) in starts.windows(2).zip(factors) {
            values[row[0] as usize..row[1] as usize].iter_mut().for_each(|value| *value *= factor);
        }
        let key = Sha256::new().chain_update(&bytes[8..40]).chain_update(factors.as_bytes()).finalize();
        bytes[8..40].copy_from_slice(&key);
        let checksum = u64::from(crc32fast::hash(&bytes[48..]));
        bytes[40..48].copy_from_slice(checksum.as_bytes());
        Self { file: Held::Memory(words, length), layout: self.layout.clone() }
    }

    /// Size of the file, bytes.
    pub fn size(&self) -> usize {
        self.file.bytes().len()
    }
}

/// The header of a file and the angles in it.
fn opened(bytes: &[u8]) -> Result<(&[u8], BeamAngles), BeamFileError> {
    let has_couch = bytes.starts_with(MAGIC_WITH_COUCH);
    let length = if has_couch { HEADER + size_of::<f64>() } else { HEADER };
    let header = bytes.get(..length).ok_or(BeamFileError::Magic)?;
    if !has_couch && !header.starts_with(MAGIC) {
        return Err(BeamFileError::Magic);
    }
    let couch_deg = if has_couch { f64::from_bits(word(header, HEADER)) } else { 0.0 };
    // A couch at 0 degrees has one way to be written.
    if has_couch && couch_deg == 0.0 {
        return Err(BeamFileError::Place);
    }
    Ok((header, BeamAngles { gantry_deg: f64::from_bits(word(header, 48)), couch_deg }))
}

/// The word of a header that begins at this byte.
fn word(header: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| header[at + i]))
}

/// Whether both are the same bits.
pub(super) fn same_bits(a: BeamAngles, b: BeamAngles) -> bool {
    let bits = |angles: BeamAngles| [angles.gantry_deg, angles.couch_deg].map(f64::to_bits);
    // A couch at -0 degrees is one at 0.
    bits(a) == bits(b) || (a.is_coplanar() && b.is_coplanar() && bits(a)[0] == bits(b)[0])
}

/// Where the parts of a file are.
#[derive(Clone, Debug)]
struct Layout {
    angles: BeamAngles,
    bixels: Range<usize>,
    starts: Range<usize>,
    value: Range<usize>,
    column: Range<usize>,
}

impl Layout {
    fn of(bytes: &[u8], key: &Key) -> Result<Self, BeamFileError> {
        let (header, angles) = opened(bytes)?;
        if header[8..40] != *key {
            return Err(BeamFileError::Key);
        }
        let (rows, columns, entries) = (word(header, 56), word(header, 64), word(header, 72));
        let size = || {
            let mut end = header.len();
            let mut part = |count: usize, each: usize| {
                let start = end;
                end = end.checked_add(count.checked_mul(each)?)?;
                Some(start..end)
            };
            let [rows, columns, entries] = [rows, columns, entries].map(|count| usize::try_from(count).ok());
            let (rows, columns, entries) = (rows?, columns?, entries?);
            let layout = Self {
                angles,
                bixels: part(columns, 16)?,
                starts: part(rows.checked_add(1)?, 4)?,
                value: part(entries, 4)?,
                column: part(entries, 2)?,
            };
            (layout.column.end == bytes.len()).then_some(layout)
        };
        let layout = size().ok_or(BeamFileError::Size { found: bytes.len(), rows, columns, entries })?;

        let (found, stored) = (crc32fast::hash(&bytes[48..]), word(header, 40));
        if u64::from(found) != stored {
            return Err(BeamFileError::Checksum { found, stored: stored as u32 });
        }
        if !layout.angles.is_finite() || !layout.bixels(bytes).as_flattened().iter().all(|mm| mm.is_finite())
        {
            return Err(BeamFileError::Place);
        }
        layout.dose(bytes).check()?;
        Ok(layout)
    }

    fn bixels<'a>(&self, bytes: &'a [u8]) -> &'a [[f64; 2]] {
        numbers(&bytes[self.bixels.clone()])
    }

    fn dose<'a>(&self, bytes: &'a [u8]) -> RowsRef<'a> {
        RowsRef {
            columns: self.bixels.len() / 16,
            starts: numbers(&bytes[self.starts.clone()]),
            column: numbers(&bytes[self.column.clone()]),
            value: numbers(&bytes[self.value.clone()]),
        }
    }
}

/// The numbers that these bytes are. They are aligned, since a file starts at a page or a word, and each part where its
/// numbers may.
fn numbers<T: FromBytes + KnownLayout + Immutable>(bytes: &[u8]) -> &[T] {
    <[T]>::ref_from_bytes(bytes).unwrap_or_default()
}

/// Writes a beam's dose.
pub(super) fn write(path: &Path, key: &Key, beam: &BeamRows) -> io::Result<()> {
    // Whoever opens it checks it.
    publish_derived(path, |file| write_to(file, key, beam))
}

/// The bytes of such a file.
pub(super) fn bytes(key: &Key, beam: &BeamRows) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Writing to memory cannot fail.
    let _ = write_to(&mut bytes, key, beam);
    bytes
}

fn write_to(out: &mut impl Write, key: &Key, beam: &BeamRows) -> io::Result<()> {
    let dose = beam.dose.view();
    let sizes = [dose.rows() as u64, dose.columns as u64, dose.value.len() as u64];
    let angle = beam.angles.gantry_deg.to_bits();
    let couch = beam.angles.couch_deg.to_bits();
    let is_coplanar = beam.angles.is_coplanar();
    let parts: [&[u8]; 7] = [
        angle.as_bytes(),
        sizes.as_bytes(),
        if is_coplanar { &[] } else { couch.as_bytes() },
        beam.bixels_mm.as_bytes(),
        dose.starts.as_bytes(),
        dose.value.as_bytes(),
        dose.column.as_bytes(),
    ];
    let mut checksum = crc32fast::Hasher::new();
    parts.iter().for_each(|part| checksum.update(part));
    out.write_all(if is_coplanar { MAGIC } else { MAGIC_WITH_COUCH })?;
    out.write_all(key)?;
    out.write_all(&u64::from(checksum.finalize()).to_le_bytes())?;
    parts.iter().try_for_each(|part| out.write_all(part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Csc, Rows};
    use proptest::prelude::*;
    use proptest::sample::Index;
    use proptest::test_runner::TestRunner;
    use std::cell::Cell;

    const KEY: Key = [7; 32];

    fn beam() -> BeamRows {
        let dose =
            Csc::new(9, vec![0, 2, 2, 5], vec![1, 8, 0, 1, 2], vec![1.0, 0.5, 0.25, 2.0, 3.0]).unwrap();
        let dose = Rows::from_columns(dose.view()).unwrap();
        BeamRows { angles: 12.5.into(), bixels_mm: vec![[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]], dose }
    }

    #[test]
    fn a_file_gives_back_the_beam_and_only_for_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("beam");
        write(&path, &KEY, &beam()).unwrap();
        let read = BeamFile::open(&path, &KEY).unwrap();
        assert_eq!((read.angles(), read.bixels_mm()), (12.5.into(), beam().bixels_mm.as_slice()));
        assert_eq!(read.dose(), beam().dose.view());
        let copied = BeamFile::of_bytes(&[&[7], read.bytes()].concat()[1..], &KEY).unwrap();
        assert_eq!((copied.dose(), copied.bytes()), (read.dose(), read.bytes()));
        assert!(matches!(BeamFile::of_bytes(&read.bytes()[1..], &KEY), Err(BeamFileError::Magic)));
        assert!(matches!(BeamFile::open(&path, &[8; 32]), Err(BeamFileError::Key)));
    }

    #[test]
    fn a_couch_angle_makes_another_version_of_the_file_and_none_leaves_it_as_it_was() {
        let coplanar = bytes(&KEY, &beam());
        assert_eq!((&coplanar[..8], coplanar.len()), (&MAGIC[..], HEADER + 3 * 16 + 10 * 4 + 5 * 6));
        let turned = bytes(&KEY, &BeamRows { angles: [12.5, -30.0].into(), ..beam() });
        assert_eq!((&turned[..8], turned.len()), (&MAGIC_WITH_COUCH[..], coplanar.len() + 8));
        let read = BeamFile::of_bytes(&turned, &KEY).unwrap();
        assert_eq!((read.angles(), read.dose()), ([12.5, -30.0].into(), beam().dose.view()));
        assert!(BeamFile::check_bytes(&turned, [12.5, -30.0]).is_ok());
        for other in [[12.5, 0.0], [12.5, 30.0], [12.0, -30.0]] {
            assert!(matches!(BeamFile::check_bytes(&turned, other), Err(BeamFileError::Place)));
        }
        let level = bytes(&KEY, &BeamRows { angles: [12.5, -0.0].into(), ..beam() });
        assert_eq!(level, coplanar);
    }

    #[test]
    fn a_scaled_file_has_its_rows_times_their_factors_under_another_key() {
        let file = BeamFile::of_bytes(&bytes(&KEY, &beam()), &KEY).unwrap();
        let factors = [2.0, 3.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0];
        let scaled = file.scaled(&factors);
        assert_eq!((scaled.angles(), scaled.bixels_mm()), (file.angles(), file.bixels_mm()));
        for (row, factor) in factors.into_iter().enumerate() {
            let (columns, values) = file.dose().row(row);
            let expected: Vec<f32> = values.iter().map(|value| factor * value).collect();
            assert_eq!(scaled.dose().row(row), (columns, &expected[..]));
        }
        assert!(matches!(BeamFile::of_bytes(scaled.bytes(), &KEY), Err(BeamFileError::Key)));
        let key: Key = scaled.bytes()[8..40].try_into().unwrap();
        assert_eq!(BeamFile::of_bytes(scaled.bytes(), &key).unwrap().dose(), scaled.dose());
    }

    #[test]
    fn ten_thousand_broken_files_are_refused_or_hold_a_matrix() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("beam");
        let whole = [0.0, 7.5].map(|couch| bytes(&KEY, &BeamRows { angles: [12.5, couch].into(), ..beam() }));

        let harm = (0..6, any::<Index>(), any::<u64>(), any::<bool>());
        let (refused, used) = (Cell::new(0), Cell::new(0));
        let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
        let outcome = TestRunner::new(config).run(&prop::collection::vec(harm, 1..3), |harms| {
            let mut broken = whole[harms.len() % 2].clone();
            for (kind, at, word, sign) in harms {
                match kind {
                    0 => broken.truncate(at.index(broken.len() + 1)),
                    1 => broken.extend(word.to_le_bytes()),
                    // The numbers of the header: any, and those that nearly fit.
                    2 if broken.len() >= HEADER => {
                        broken[48 + 8 * at.index(4)..][..8].copy_from_slice(&word.to_le_bytes());
                    }
                    3 if broken.len() >= HEADER + 8 => broken[80] ^= word as u8,
                    4 if broken.len() >= HEADER => broken[48 + 8 * at.index(4)] ^= word as u8 % 8,
                    _ if !broken.is_empty() => {
                        let at = at.index(broken.len());
                        broken[at] = word as u8;
                    }
                    _ => {}
                }
                // Signed again, so that what lies behind the checksum is reached.
                if sign && broken.len() >= 48 {
                    let checksum = crc32fast::hash(&broken[48..]);
                    broken[40..44].copy_from_slice(&checksum.to_le_bytes());
                }
            }
            std::fs::write(&path, &broken)?;
            match BeamFile::open(&path, &KEY) {
                Err(fault) => {
                    prop_assert!(!fault.to_string().is_empty());
                    refused.set(refused.get() + 1);
                }
                Ok(read) => {
                    prop_assert_eq!(read.dose().check(), Ok(()));
                    prop_assert_eq!(read.bixels_mm().len(), read.dose().columns);
                    used.set(used.get() + 1);
                }
            }
            Ok(())
        });
        outcome.unwrap();
        let (refused, used) = (refused.get(), used.get());
        assert!(refused > used && used > 0, "{refused} refused, {used} used: the harm is one-sided");
    }
}
