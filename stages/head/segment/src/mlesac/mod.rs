//! MLESAC (Torr and Zisserman, 2000): the plane under which a cloud is most likely.
//!
//! A residual e is an inlier's, normal with deviation sigma, or an outlier's, uniform over nu metres:
//! p(e) = gamma N(e; 0, sigma) + (1 - gamma) / nu. A hypothesis is a plane through three points drawn at random; its
//! gamma comes from a few steps of expectation maximisation; the greatest log-likelihood wins.
//!
//! - `search`: hypotheses, drawn and compared.
//! - `likelihood`: how likely a hypothesis makes the points.
//! - `fit`: the winner, fitted to its inliers.

mod fit;
mod likelihood;
mod search;

pub use fit::{Origin, PlaneFit};
pub use search::{Beneath, Mlesac, MlesacParams};

pub(crate) use search::below;
