//! The dissertation's residual tower in three dimensions (5.2.2), as SCIENCE G9 reads it, with two heads.
//!
//! Read literally (34 blocks, every convolution 7 wide with stride 2) the tower has some 4e10 parameters, and six strides
//! leave nothing of 64 x 64: it cannot be built. The numbers are those of the 34-layer net of He et al. (2016), whose stem
//! is 7 wide with stride 2 and whose four stages have 3, 4, 6 and 3 blocks. That net is built here in three dimensions.
//!
//! - `convolution`: the convolution in three dimensions
//! - `layers`: stem, blocks, heads
//! - `planes`: the 36 input planes of a case
//!
//! It is an experiment: no model of it ships, and `plan` does not use it.

mod convolution;
mod layers;
mod planes;

pub use convolution::convolve;
pub use layers::{Tower, TowerConfig};
pub use planes::{PLANES, planes};
