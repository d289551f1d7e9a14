//! The dose of photon beams by superposition: collapsed cones, gathered.
//!
//! The energy that photons of the source lose (TERMA) is spread by point kernels along the axes of cones, and distances
//! count in water on the way (Ahnesjo, Med. Phys. 16 (1989) 577). Each voxel gathers what the cones bring: the sum goes from
//! the voxel backwards along each axis. So the order of every sum is fixed, and only voxels that are asked for cost anything.
//! Energy of charged particles (primary) and of scattered photons (scatter) are gathered apart.
//!
//! - `section`: spectrum and kernels as the machine file writes them
//! - `terma`: TERMA over the depth in water
//! - `directions`: axes of the cones; `kernels`: energy along an axis
//! - `stencil`: the voxels behind a voxel; `gather`: the sum along all axes
//! - `fluence`: fluence on the isocentre plane
//! - `field`: what a beam does to the voxels that it crosses
//! - `primary`, `scatter`: the dose of each part
//! - `water`: responses in a water tank, for fits
//! - `beam`: the dose of a weighted beam; `columns`: the dose of each bixel, filed over `nodes`, with the scatter of a `pencil`

mod beam;
mod columns;
mod directions;
mod field;
mod fluence;
mod gather;
mod kernels;
mod nodes;
mod pencil;
mod primary;
mod scatter;
mod section;
mod stencil;
mod terma;
pub(crate) mod water;

pub use section::{PointKernels, Superposition};

pub(super) use beam::weighted;
pub(super) use columns::influence;
