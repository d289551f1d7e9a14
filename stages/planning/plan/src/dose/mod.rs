//! The dose of photon beams, by pencil beams or by superposition.
//!
//! The method of pencil beams is that of Bortfeld, Schlegel and Rhein, Med. Phys. 20 (1993) 311: the fluence of each bixel is folded with
//! three kernels, each with a depth dose of its own, over the water that lies between the source and the voxel.
//!
//! - `machine`: the machine file; `generic`: the machine that comes with the project
//! - `collimator`: the leaves of the machine; `clearance`: where gantry and couch have room; `arc_limits`: what moves how fast in an arc
//! - `engine`: a patient made ready; [`DoseEngine`] gives the dose of any beam
//! - `angles`: gantry and couch
//! - `beam`: one beam, bixel by bixel
//! - `name`: the two methods; `superposition`: the one that knows air and lung
//! - `low_density`: where beams cross them
//! - `delivered`: the dose of a weighted beam, without a matrix
//! - `bixels`: where the bixels of a beam stand
//! - `kernel`: the lateral dose of a bixel
//! - `depth`: radiological depth, by `siddon`'s segments of a line
//! - `outline`: the patient as rays see it, and the pencils at its edge
//! - `density`: the patient on the dose grid
//! - `frame`: the beam's frame
//! - `cache`: doses kept on disk, each in a `file`
//! - `portable`: an engine as bytes
//! - `error`: what can be wrong

mod angles;
mod arc_limits;
mod beam;
mod bixels;
mod cache;
mod clearance;
mod collimator;
mod delivered;
pub(crate) mod density;
mod depth;
pub(crate) mod engine;
mod error;
mod file;
pub(crate) mod frame;
mod generic;
mod kernel;
mod low_density;
mod machine;
mod name;
mod outline;
mod pending;
mod portable;
mod siddon;
pub(crate) mod superposition;

pub use angles::{BeamAngles, NotAngles};
pub(crate) use arc_limits::farthest_mm;
pub use arc_limits::{ArcLimits, Stretch};
pub use beam::BeamInfluence;
pub use bixels::{BixelCentre, BixelSpec};
pub use cache::{CacheError, CachedBeam, DoseCache, Origin};
pub use clearance::FreeRange;
pub use collimator::Collimator;
pub use engine::{Anatomy, DoseEngine, DoseParams, Fluence};
pub use error::DoseError;
pub use file::{BeamFile, BeamFileError};
pub use low_density::{LEAST_LOW_DENSITY_MM, LowDensity};
pub use machine::{Machine, MachineError, MachineFile, PencilsOf};
pub use name::{EngineName, UnknownEngine};
pub use portable::PortableError;
pub use superposition::{PointKernels, Superposition};
