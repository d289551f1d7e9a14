//! Bodies under constraints `phi(q) = 0`: an index-1 differential-algebraic system (SCIENCE C2).
//!
//! `[M A^T; A 0] [q''; lambda] = [Q - C q'; -A' q' - 2 a A q' - b^2 phi]`, where the last two terms are Baumgarte's,
//! which correct drift. Redundant constraints are allowed: some of the equivalent rows then carry no force.
//!
//! The plants of the rigs have the reduced form: their motion is compared with the one found here.

use nalgebra::{SMatrix, SVector};

use crate::linear;

/// What holds `L` constraints at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constraints<const Q: usize, const L: usize> {
    /// `phi(q)`.
    pub value: SVector<f64, L>,
    /// `A = d phi / d q`.
    pub jacobian: SMatrix<f64, L, Q>,
    /// `A' q'`.
    pub bias: SVector<f64, L>,
    /// `a` and `b`, 1/s: 5 to 20.
    pub damping: [f64; 2],
}

/// Accelerations and multipliers, in the sign of `M q'' + A^T lambda = Q - C q'`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution<const Q: usize, const L: usize> {
    /// `q''`.
    pub acceleration: SVector<f64, Q>,
    /// `lambda`; 0 for a constraint that was let go.
    pub multiplier: SVector<f64, L>,
}

/// The motion of bodies of mass matrix `mass` under `force = Q - C q'`. `None` where the mass matrix has no inverse.
pub fn solve<const Q: usize, const L: usize>(
    mass: &SMatrix<f64, Q, Q>,
    force: &SVector<f64, Q>,
    rate: &SVector<f64, Q>,
    constraints: &Constraints<Q, L>,
) -> Option<Solution<Q, L>> {
    solve_held(mass, force, rate, constraints, &[true; L])
}

/// Like [`solve`], for contacts: `phi` is a gap that may open. A contact whose multiplier would pull (a positive one)
/// is let go, the strongest pull first, until none pulls.
pub fn solve_contacts<const Q: usize, const L: usize>(
    mass: &SMatrix<f64, Q, Q>,
    force: &SVector<f64, Q>,
    rate: &SVector<f64, Q>,
    constraints: &Constraints<Q, L>,
) -> Option<Solution<Q, L>> {
    let mut held = [true; L];
    loop {
        let solution = solve_held(mass, force, rate, constraints, &held)?;
        let pull = |i: &usize| solution.multiplier[*i];
        let strongest = (0..L).filter(|i| held[*i]).max_by(|a, b| pull(a).total_cmp(&pull(b)));
        match strongest {
            Some(i) if pull(&i) > 0.0 => held[i] = false,
            _ => return Some(solution),
        }
    }
}

fn solve_held<const Q: usize, const L: usize>(
    mass: &SMatrix<f64, Q, Q>,
    force: &SVector<f64, Q>,
    rate: &SVector<f64, Q>,
    constraints: &Constraints<Q, L>,
    held: &[bool; L],
) -> Option<Solution<Q, L>> {
    let Constraints { value, mut jacobian, mut bias, damping: [a, b] } = *constraints;
    bias += jacobian * rate * (2.0 * a) + value * (b * b);
    for (i, held) in held.iter().enumerate() {
        if !held {
            jacobian.row_mut(i).fill(0.0);
            bias[i] = 0.0;
        }
    }
    let free = linear::solve(*mass, *force)?;
    // M^-1 A^T, column by column.
    let mut softness = SMatrix::<f64, Q, L>::zeros();
    for i in 0..L {
        softness.set_column(i, &linear::solve(*mass, jacobian.row(i).transpose())?);
    }
    let multiplier = linear::solve_semidefinite(jacobian * softness, jacobian * free + bias);
    Some(Solution { acceleration: free - softness * multiplier, multiplier })
}

/// Brings positions back onto the constraints, by the shortest way: Gauss and Newton's method with `phi` and `A` as
/// functions of the position, until no component of `phi` exceeds `tolerance`. `None` where ten steps do not do.
pub fn project<const Q: usize, const L: usize>(
    position: SVector<f64, Q>,
    constraints: impl Fn(&SVector<f64, Q>) -> (SVector<f64, L>, SMatrix<f64, L, Q>),
    tolerance: f64,
) -> Option<SVector<f64, Q>> {
    let mut q = position;
    for _ in 0..10 {
        let (value, jacobian) = constraints(&q);
        if value.amax() <= tolerance {
            return Some(q);
        }
        let across = jacobian.transpose();
        q -= across * linear::solve_semidefinite(jacobian * across, value);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix2, RowVector2, SMatrix, Vector1, Vector2, Vector3};

    fn falling(gap_rows: SMatrix<f64, 2, 2>, force: Vector2<f64>) -> Solution<2, 2> {
        let contacts = Constraints {
            value: Vector2::zeros(),
            jacobian: gap_rows,
            bias: Vector2::zeros(),
            damping: [10.0, 10.0],
        };
        solve_contacts(&Matrix2::identity(), &force, &Vector2::zeros(), &contacts).unwrap()
    }

    #[test]
    fn a_contact_holds_what_pushes_and_lets_go_what_pulls() {
        let floors = Matrix2::identity();
        let solution = falling(floors, Vector2::new(-3.0, 4.0));
        assert!((solution.acceleration - Vector2::new(0.0, 4.0)).amax() < 1e-12, "{solution:?}");
        assert!((solution.multiplier - Vector2::new(-3.0, 0.0)).amax() < 1e-12, "{solution:?}");
    }

    #[test]
    fn constraints_that_say_the_same_share_one_load() {
        let twice = Matrix2::new(1.0, 0.0, 1.0, 0.0);
        let solution = falling(twice, Vector2::new(-3.0, 4.0));
        assert!((solution.acceleration - Vector2::new(0.0, 4.0)).amax() < 1e-12, "{solution:?}");
        assert!((solution.multiplier.sum() + 3.0).abs() < 1e-12, "{solution:?}");
    }

    #[test]
    fn positions_come_back_onto_a_sphere_by_the_shortest_way() {
        let sphere = |q: &Vector3<f64>| {
            (Vector1::new(q.norm_squared() - 1.0), SMatrix::<f64, 1, 3>::from((q * 2.0).transpose()))
        };
        let q = project(Vector3::new(1.02, 0.0, 1.02), sphere, 1e-12).unwrap();
        assert!((q - Vector3::new(0.5, 0.0, 0.5).map(f64::sqrt)).amax() < 1e-9, "{q}");
        let nowhere = |_: &Vector1<f64>| (Vector1::new(1.0), Matrix1::zeros());
        assert_eq!(project(Vector1::new(0.0), nowhere, 1e-12), None);
    }

    #[test]
    fn baumgartes_terms_pull_a_drift_back() {
        let drifted = Constraints {
            value: Vector1::new(0.1),
            jacobian: RowVector2::new(1.0, 0.0),
            bias: Vector1::zeros(),
            damping: [5.0, 10.0],
        };
        let rate = Vector2::new(0.2, 0.7);
        let solution = solve(&Matrix2::identity(), &Vector2::zeros(), &rate, &drifted).unwrap();
        assert!((solution.acceleration - Vector2::new(-12.0, 0.0)).amax() < 1e-12, "{solution:?}");
    }
}
