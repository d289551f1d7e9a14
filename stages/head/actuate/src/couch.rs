//! Couch angles (patient support, IEC 61217), and whether two of them are the same.

use std::f64::consts::TAU;

/// Angles that differ by no more are the same: what rounding to a tenth of a degree leaves, rad.
const SAME: f64 = 0.05 * TAU / 360.0 + 1e-9;

/// Whether two couch angles are the same, rad; whole turns do not count. False where one is not finite.
pub fn is_same(a: f64, b: f64) -> bool {
    let turn = (a - b).rem_euclid(TAU);
    turn.min(TAU - turn) <= SAME
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_turns_and_roundings_do_not_count_and_other_turns_do() {
        let same = |a: f64, b: f64| is_same(a.to_radians(), b.to_radians());
        for (a, b) in [(0.0, 0.0), (30.0, 30.0), (330.0, -30.0), (-180.0, 180.0), (360.0, 0.0), (29.96, 30.0)]
        {
            assert!(same(a, b) && same(b, a), "{a} {b}");
        }
        for (a, b) in
            [(0.0, 30.0), (30.0, -30.0), (0.0, 180.0), (29.9, 30.0), (f64::NAN, 0.0), (0.0, f64::INFINITY)]
        {
            assert!(!same(a, b) && !same(b, a), "{a} {b}");
        }
    }
}
