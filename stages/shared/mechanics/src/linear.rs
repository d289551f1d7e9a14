//! Linear systems of a size fixed at compile time. (nalgebra's own factors ask every generic caller for its bounds.)

use nalgebra::{SMatrix, SVector};

/// The `x` of `a x = b` by elimination with partial pivoting; `None` where a pivot is 0 or no number.
pub(crate) fn solve<const D: usize>(
    mut a: SMatrix<f64, D, D>,
    mut b: SVector<f64, D>,
) -> Option<SVector<f64, D>> {
    for column in 0..D {
        let pivot = (column..D).fold(column, |best, row| {
            if a[(row, column)].abs() > a[(best, column)].abs() { row } else { best }
        });
        a.swap_rows(column, pivot);
        b.swap_rows(column, pivot);
        let head = a[(column, column)];
        if head == 0.0 || !head.is_finite() {
            return None;
        }
        for row in column + 1..D {
            let factor = a[(row, column)] / head;
            for k in column..D {
                a[(row, k)] -= factor * a[(column, k)];
            }
            b[row] -= factor * b[column];
        }
    }
    for row in (0..D).rev() {
        for k in row + 1..D {
            b[row] -= a[(row, k)] * b[k];
        }
        b[row] /= a[(row, row)];
    }
    Some(b)
}

/// An `x` of `a x = b` for a symmetric `a` without negative eigenvalues, by Cholesky's factor with the largest pivot
/// first. Rows that depend on those before get 0: of all answers, one with few parts.
pub(crate) fn solve_semidefinite<const D: usize>(
    mut a: SMatrix<f64, D, D>,
    mut b: SVector<f64, D>,
) -> SVector<f64, D> {
    let least = 1e-12 * (0..D).fold(0.0_f64, |most, i| most.max(a[(i, i)]));
    let mut order = [0; D];
    let mut used = [false; D];
    let mut rank = 0;
    while rank < D {
        let open = (0..D).filter(|i| !used[*i]);
        let Some(pivot) = open.max_by(|i, j| a[(*i, *i)].total_cmp(&a[(*j, *j)])) else { break };
        let head = a[(pivot, pivot)];
        if head.is_nan() || head <= least {
            break;
        }
        (order[rank], used[pivot]) = (pivot, true);
        rank += 1;
        for row in (0..D).filter(|i| !used[*i]) {
            let factor = a[(row, pivot)] / head;
            for column in 0..D {
                a[(row, column)] -= factor * a[(pivot, column)];
            }
            b[row] -= factor * b[pivot];
        }
    }
    let mut x = SVector::zeros();
    for step in (0..rank).rev() {
        let row = order[step];
        let later = order[step + 1..rank].iter();
        let known: f64 = later.map(|column| a[(row, *column)] * x[*column]).sum();
        x[row] = (b[row] - known) / a[(row, row)];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_found_solves_the_system(entries in prop::array::uniform20(-5.0..5.0f64)) {
            let a = SMatrix::<f64, 4, 4>::from_column_slice(&entries[..16]);
            let b = SVector::<f64, 4>::from_column_slice(&entries[16..]);
            prop_assume!(a.determinant().abs() > 1e-2);
            let x = solve(a, b).unwrap();
            prop_assert!((a * x - b).amax() < 1e-9, "{}", a * x - b);
        }

        #[test]
        fn a_semidefinite_system_is_solved_where_it_can_be(
            entries in prop::array::uniform12(-5.0..5.0f64),
            requested in prop::array::uniform4(-5.0..5.0f64),
            rank in 1..4usize,
        ) {
            let mut root = SMatrix::<f64, 4, 3>::from_column_slice(&entries);
            for column in rank..3 {
                root.column_mut(column).fill(0.0);
            }
            let a = root * root.transpose();
            let b = a * SVector::from(requested);
            let x = solve_semidefinite(a, b);
            prop_assert!((a * x - b).amax() < 1e-8 * a.amax().max(1.0), "{}", a * x - b);
        }
    }

    #[test]
    fn a_singular_system_has_no_answer() {
        assert_eq!(solve(SMatrix::<f64, 2, 2>::repeat(1.0), SVector::repeat(1.0)), None);
        assert_eq!(solve(SMatrix::<f64, 2, 2>::repeat(f64::NAN), SVector::repeat(1.0)), None);
    }
}
