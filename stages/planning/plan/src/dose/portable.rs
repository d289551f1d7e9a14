//! An engine as bytes, so that another process computes the same doses.
//!
//! All numbers are little endian. In this order: `SPENGN03`; the machine file as JSON; the dose grid (three counts, three
//! spacings, three places, mm); width, margin and centre of bixels; fluence; method; cutoff; isocentre; position of the patient
//! (DICOM term); greatest spacing of the image; shift; how far bixels run within the outline; then the arrays: density,
//! voxels, points of the target, samples where there are some, and the outline: its grid like that of the dose, and its
//! voxels, eight to a byte. A text or an array begins with its length, u64.

use std::sync::Arc;

use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::bixels::{BixelCentre, BixelSpec};
use super::engine::{DoseEngine, DoseParams, EngineKey, Fluence, check_grid, check_numbers};
use super::error::DoseError;
use super::machine::{Machine, MachineError};
use super::name::EngineName;
use super::outline::Outline;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Mask, PatientPosition};

const MAGIC: &[u8; 8] = b"SPENGN03";

/// Why bytes are no engine.
#[derive(Debug, Error)]
pub enum PortableError {
    /// They are something else.
    #[error("these bytes are not a dose engine of version 3")]
    Magic,
    /// They end too early, or go on behind the end.
    #[error("the bytes of a dose engine end at {end}, but its {part} needs others")]
    Length {
        /// Where they end.
        end: usize,
        /// What was being read.
        part: &'static str,
    },
    /// A part does not fit the others.
    #[error("the {0} of a dose engine is out of range")]
    Part(&'static str),
    /// The machine cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// A number is out of range.
    #[error(transparent)]
    Dose(#[from] DoseError),
}

impl DoseEngine {
    /// The engine as bytes: the same engine gives the same bytes.
    ///
    /// # Errors
    /// The machine cannot be written.
    pub fn to_bytes(&self) -> Result<Vec<u8>, PortableError> {
        // Every field is named, so that a new one is thought of here.
        let Self {
            machine,
            params,
            isocentre_mm,
            position,
            density,
            voxels,
            target_mm,
            outline,
            image_spacing_mm,
            samples,
            shift_mm,
            key: _,
        } = self;
        let DoseParams { grid, bixels, fluence, cutoff_mm, engine } = params;
        let mut bytes = MAGIC.to_vec();
        let mut array = |part: &[u8], count: usize| {
            bytes.extend((count as u64).to_le_bytes());
            bytes.extend(part);
        };
        let machine = machine.file().to_json()?;
        array(machine.as_bytes(), machine.len());
        let mut numbers: Vec<f64> = Vec::new();
        numbers.extend(grid.spacing_mm.iter().chain(&grid.origin_mm));
        numbers.extend([bixels.width_mm, bixels.margin_mm, *cutoff_mm, *image_spacing_mm]);
        numbers.extend(isocentre_mm.iter().chain(shift_mm));
        numbers.push(bixels.inside_mm);
        let kinds = [
            u64::from(bixels.centre == BixelCentre::Offset),
            u64::from(*fluence == Fluence::OpenField),
            u64::from(samples.is_some()),
            u64::from(*engine == EngineName::Superposition),
        ];
        let counts = grid.counts.map(|count| count as u64);
        array(counts.as_bytes(), counts.len());
        array(kinds.as_bytes(), kinds.len());
        array(numbers.as_bytes(), numbers.len());
        array(position.term().as_bytes(), position.term().len());
        array(density.as_bytes(), density.len());
        array(voxels.as_bytes(), voxels.len());
        array(target_mm.as_bytes(), target_mm.len());
        let samples = samples.as_deref().unwrap_or_default();
        array(samples.as_bytes(), samples.len());
        let counts = outline.grid.counts.map(|count| count as u64);
        let places = [outline.grid.spacing_mm, outline.grid.origin_mm];
        let inside = outline.inside.to_bytes();
        array(counts.as_bytes(), counts.len());
        array(places.as_bytes(), places.as_flattened().len());
        array(&inside, inside.len());
        Ok(bytes)
    }

    /// The engine of these bytes, which anybody may have made.
    ///
    /// # Errors
    /// The bytes are no engine, or a part of it is out of range.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PortableError> {
        let mut parts = Parts { all: bytes, at: MAGIC.len() };
        if !bytes.starts_with(MAGIC) {
            return Err(PortableError::Magic);
        }
        let machine =
            String::from_utf8(parts.array("machine")?).map_err(|_| PortableError::Part("machine"))?;
        let machine = Machine::from_json(&machine)?;
        let counts: Vec<u64> = parts.array("grid")?;
        let kinds: Vec<u64> = parts.array("kinds")?;
        let numbers: Vec<f64> = parts.array("numbers")?;
        let position = String::from_utf8(parts.array("position")?).ok();
        let (Ok(counts), Ok([offset, open, sampled, superposed]), Ok(numbers)) =
            (<[u64; 3]>::try_from(counts), <[u64; 4]>::try_from(kinds), <[f64; 17]>::try_from(numbers))
        else {
            return Err(PortableError::Part("number of parameters"));
        };
        let three = |at: usize| [numbers[at], numbers[at + 1], numbers[at + 2]];
        let engine = Self {
            machine,
            params: DoseParams {
                grid: Grid {
                    counts: counts.map(|count| usize::try_from(count).unwrap_or(usize::MAX)),
                    spacing_mm: three(0),
                    origin_mm: three(3),
                },
                bixels: BixelSpec {
                    width_mm: numbers[6],
                    margin_mm: numbers[7],
                    centre: if offset == 0 { BixelCentre::Centred } else { BixelCentre::Offset },
                    inside_mm: numbers[16],
                },
                fluence: if open == 0 { Fluence::Uniform } else { Fluence::OpenField },
                cutoff_mm: numbers[8],
                engine: if superposed == 0 { EngineName::Pencil } else { EngineName::Superposition },
            },
            image_spacing_mm: numbers[9],
            isocentre_mm: three(10),
            shift_mm: three(13),
            key: EngineKey::default(),
            position: position
                .and_then(|term| PatientPosition::of_term(&term))
                .ok_or(PortableError::Part("position of the patient"))?,
            density: parts.array("density")?,
            voxels: parts.array("voxels")?,
            target_mm: parts.array("target")?,
            samples: Some(parts.array("samples")?).filter(|_| sampled != 0),
            outline: parts.outline()?,
        };
        if parts.at != bytes.len() {
            return Err(PortableError::Length { end: bytes.len(), part: "end" });
        }
        engine.check()?;
        Ok(engine)
    }

    fn check(&self) -> Result<(), PortableError> {
        check_numbers(&self.params, self.isocentre_mm, self.shift_mm, self.machine.file().sad_mm)?;
        self.superposition()?;
        let voxels = self.params.grid.len();
        let rising = |list: &[u32]| {
            list.windows(2).all(|pair| pair[0] < pair[1])
                && list.last().is_none_or(|last| (*last as usize) < voxels)
        };
        let sampled = |v: &u32| self.samples.as_ref().is_none_or(|all| all.binary_search(v).is_ok());
        let near = |mm: &f64| mm.is_finite() && mm.abs() <= 1e5;
        let parts = [
            (
                "density",
                self.density.len() == voxels && self.density.iter().all(|d| (0.0..=100.0).contains(d)),
            ),
            ("list of samples", self.samples.as_deref().is_none_or(rising)),
            ("list of voxels", rising(&self.voxels) && self.voxels.iter().all(sampled)),
            ("target", !self.target_mm.is_empty() && self.target_mm.as_flattened().iter().all(near)),
            ("spacing of the image", (0.01..=1000.0).contains(&self.image_spacing_mm)),
        ];
        parts.iter().find(|(_, good)| !good).map_or(Ok(()), |(part, _)| Err(PortableError::Part(part)))
    }
}

struct Parts<'a> {
    all: &'a [u8],
    at: usize,
}

impl Parts<'_> {
    /// The outline of the patient.
    fn outline(&mut self) -> Result<Outline, PortableError> {
        let fault = PortableError::Part("outline");
        let counts = <[u64; 3]>::try_from(self.array::<u64>("outline")?);
        let places = <[f64; 6]>::try_from(self.array::<f64>("outline")?);
        let bits: Vec<u8> = self.array("outline")?;
        let (Ok(counts), Ok([x, y, z, from_x, from_y, from_z])) = (counts, places) else { return Err(fault) };
        let grid = Grid {
            counts: counts.map(|count| usize::try_from(count).unwrap_or(usize::MAX)),
            spacing_mm: [x, y, z],
            origin_mm: [from_x, from_y, from_z],
        };
        check_grid("the outline", &grid)?;
        let inside = Mask::from_bytes(grid.len(), &bits).filter(|mask| !mask.is_empty()).ok_or(fault)?;
        // Where the images end stays with whoever has them: he refuses beams that enter there before he takes their plan.
        Ok(Outline { grid, inside: Arc::new(inside), is_cut: [false; 2] })
    }

    /// The next array. Nothing is made before its bytes are known to be there.
    fn array<T: FromBytes + IntoBytes + Immutable + Copy>(
        &mut self,
        part: &'static str,
    ) -> Result<Vec<T>, PortableError> {
        let fault = PortableError::Length { end: self.all.len(), part };
        let mut take = |bytes: usize| {
            let taken = self.all.get(self.at..self.at.checked_add(bytes)?)?;
            self.at += bytes;
            Some(taken)
        };
        let taken = take(8).and_then(|word| {
            let count = usize::try_from(u64::from_le_bytes(word.try_into().ok()?)).ok()?;
            take(count.checked_mul(size_of::<T>())?)
        });
        let each = taken.ok_or(fault)?.chunks_exact(size_of::<T>());
        each.map(|one| T::read_from_bytes(one).map_err(|_| PortableError::Part(part))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_patient::case::phantom;

    fn engine() -> DoseEngine {
        let case = phantom(0).unwrap();
        let params = DoseParams::over(case.grid(), 15.0);
        let engine = DoseEngine::of_case(&case, Machine::shipped().unwrap(), params).unwrap();
        let samples: Vec<u32> = engine.voxels.iter().step_by(3).copied().collect();
        engine.sampled(samples).shifted([1.0, -2.0, 0.5]).unwrap()
    }

    #[test]
    fn an_engine_from_bytes_gives_the_same_dose() {
        let engine = engine();
        let bytes = engine.to_bytes().unwrap();
        let repeated = DoseEngine::from_bytes(&bytes).unwrap();
        assert_eq!(repeated.to_bytes().unwrap(), bytes);
        assert_eq!(repeated.beam(36.0).unwrap(), engine.beam(36.0).unwrap());
        assert_eq!(repeated.beam_file(36.0).unwrap(), engine.beam_file(36.0).unwrap());
    }

    #[test]
    fn broken_bytes_are_refused_or_make_an_engine_that_can_be_asked() {
        let whole = engine().to_bytes().unwrap();
        let config = ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() };
        proptest!(config, |(at in 0..whole.len(), word: u64, cut: bool)| {
            let mut broken = whole.clone();
            // Most of the bytes are densities: the head, where the structure is, is hit as often.
            let at = if word % 2 == 0 { at } else { at % 4096 };
            if cut {
                broken.truncate(at);
            } else {
                let end = (at + 8).min(broken.len());
                broken[at..end].copy_from_slice(&word.to_le_bytes()[..end - at]);
            }
            prop_assert!(!cut || DoseEngine::from_bytes(&broken).is_err());
            if let Ok(engine) = DoseEngine::from_bytes(&broken) {
                let _ = engine.checked_angles(0.0);
            }
        });
    }
}
