//! Spread of the dose around its mean.

use super::*;

/// The text form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    weight: f64,
}

/// `weight / v sum (d - mean)^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Homogeneity {
    /// Weight.
    pub weight: f64,
}

pub(super) const EXAMPLES: &[&str] = &[r#"{"homogeneity": {"weight": 4}}"#];

impl super::Spec for Spec {
    fn doses(&self) -> Vec<Dose> {
        Vec::new()
    }

    fn resolve(&self, _: &dyn Fn(Dose) -> f64) -> Objective {
        Homogeneity { weight: self.weight }.into()
    }
}

impl Shape for Homogeneity {
    fn check(&self) -> Result<(), BadNumber> {
        Ok(())
    }

    fn cost(&self, at: &Doses<'_>) -> f64 {
        let mean = at.mean();
        self.weight / at.whole() * at.squares(|d| d - mean)
    }

    fn add(&self, region: Region<'_>, parts: &mut Parts<'_>) {
        // sum (d - mean)^2 = min_c sum (d - c)^2: one more column, c, and each row once more with -1 in it.
        // The best c is the mean, so it is not negative.
        let whole = region.whole();
        let column = parts.matrix.columns() as u32;
        parts.matrix.widen(1);
        for (row, v) in region.both() {
            parts.averages.push(vec![(row, 1.0)]);
            let (columns, values) = parts.matrix.row(row as usize);
            let columns = [columns, &[column]].concat();
            let values = [values, &[-1.0]].concat();
            let row = parts.matrix.rows() as u32;
            parts.matrix.push_row(&columns, &values);
            for side in [Side::Over, Side::Under] {
                parts.terms.push(Term { row, side, goal: 0.0, weight: self.weight * v / whole });
            }
        }
    }

    fn aim(&self) -> Aim {
        Aim::Even
    }

    fn tolerated_gy(&self) -> Option<f64> {
        None
    }

    fn measure(&self, _: &Dvh) -> Option<Measured> {
        None
    }
}
