//! A linear system of a size fixed at compile time. (nalgebra's own factors ask every generic caller for its bounds.)

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
    }

    #[test]
    fn a_singular_system_has_no_answer() {
        assert_eq!(solve(SMatrix::<f64, 2, 2>::repeat(1.0), SVector::repeat(1.0)), None);
        assert_eq!(solve(SMatrix::<f64, 2, 2>::repeat(f64::NAN), SVector::repeat(1.0)), None);
    }
}
