//! A head and the bodies that it carries along, in the head's coordinates (3.58)-(3.63).
//!
//! The bodies' rates are `H zeta'` with `H = J^-1 G^T`; that needs a square `J` with an inverse. Where it has none, see
//! [`constrained`](super::constrained).
//!
//! The rigs and the controllers do not use this module yet: the reference vectors and its own tests do.

use nalgebra::{SMatrix, SVector};

/// Matrices of motion of bodies with `D` coordinates: `M x'' + C x' + N = tau`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms<const D: usize> {
    /// `M`.
    pub mass: SMatrix<f64, D, D>,
    /// `C`.
    pub velocity: SMatrix<f64, D, D>,
    /// `N`: gravity, springs.
    pub load: SVector<f64, D>,
}

/// How `B` coordinates follow `D` of the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried<const D: usize, const B: usize> {
    /// `H`.
    pub map: SMatrix<f64, B, D>,
    /// `H'`.
    pub map_rate: SMatrix<f64, B, D>,
}

/// The terms of head and bodies together (3.62):
/// `(M_h + H^T M_b H) zeta'' + (C_h + H^T (C_b H + M_b H')) zeta' + N_h + H^T N_b = H^T tau`.
pub fn together<const D: usize, const B: usize>(
    head: &Terms<D>,
    bodies: &Terms<B>,
    carried: &Carried<D, B>,
) -> Terms<D> {
    let across = carried.map.transpose();
    Terms {
        mass: head.mass + across * (bodies.mass * carried.map),
        velocity: head.velocity + across * (bodies.velocity * carried.map + bodies.mass * carried.map_rate),
        load: head.load + across * bodies.load,
    }
}

/// The head's acceleration under forces `tau` on the bodies; `None` where the mass matrix has no inverse.
pub fn acceleration<const D: usize, const B: usize>(
    terms: &Terms<D>,
    carried: &Carried<D, B>,
    rate: &SVector<f64, D>,
    tau: &SVector<f64, B>,
) -> Option<SVector<f64, D>> {
    let force = carried.map.transpose() * tau - terms.velocity * rate - terms.load;
    crate::linear::solve(terms.mass, force)
}
