//! A head and the bodies that it carries along, in the head's coordinates (3.58)-(3.63).
//!
//! The bodies' rates are `H zeta'` with `H = J^-1 G^T`; that needs a square `J` with an inverse. Where it has none, see
//! the reference of the tests (`tests/reference`).

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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix2, Matrix2x1, Vector1, Vector2};

    #[test]
    fn every_term_of_the_carried_bodies_counts() {
        let head = Terms { mass: Matrix1::new(2.0), velocity: Matrix1::new(0.5), load: Vector1::new(11.0) };
        let bodies = Terms {
            mass: Matrix2::new(1.0, 0.0, 0.0, 4.0),
            velocity: Matrix2::new(0.1, 0.0, 0.0, 0.2),
            load: Vector2::new(5.0, 7.0),
        };
        let carried = Carried { map: Matrix2x1::new(2.0, 3.0), map_rate: Matrix2x1::new(0.3, -0.1) };
        let all = together(&head, &bodies, &carried);
        // M_h + 4 * 1 + 9 * 4; C_h + (4 * 0.1 + 9 * 0.2) + (2 * 0.3 + 3 * 4 * -0.1); N_h + 2 * 5 + 3 * 7.
        assert!((all.mass[0] - 42.0).abs() < 1e-12, "{all:?}");
        assert!((all.velocity[0] - 2.1).abs() < 1e-12, "{all:?}");
        assert!((all.load[0] - 42.0).abs() < 1e-12, "{all:?}");
        // H^T tau = 2 * 20 + 3 * 30 = 130; less C' rate and the load.
        let found = acceleration(&all, &carried, &Vector1::new(0.5), &Vector2::new(20.0, 30.0)).unwrap();
        assert!((found[0] - (130.0 - 1.05 - 42.0) / 42.0).abs() < 1e-12, "{found}");
    }
}
