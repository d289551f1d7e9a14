//! Roots of functions of one variable inside a bracket.

/// Newton's method that never leaves the bracket: if a step would leave it, or if the derivative is not usable, the
/// bracket is halved. `f` gives value and derivative. It must not be positive at `low` nor negative at `high`, and must
/// grow in between. The start is clamped into the bracket.
pub(crate) fn newton(f: impl Fn(f64) -> (f64, f64), low: f64, high: f64, start: f64) -> f64 {
    let (mut low, mut high) = (low, high);
    let mut x = start.clamp(low, high);
    for _ in 0..200 {
        let (value, slope) = f(x);
        if value == 0.0 {
            return x;
        }
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        if (newton - x).abs() <= 2.0 * f64::EPSILON * x.abs() {
            return newton;
        }
        let inside = newton > low && newton < high;
        x = if inside { newton } else { low + 0.5 * (high - low) };
    }
    x
}

/// Halves a bracket over which `f` changes its sign until its ends are neighbouring numbers.
pub(crate) fn bisect(f: impl Fn(f64) -> f64, low: f64, high: f64) -> f64 {
    let (mut low, mut high) = (low, high);
    let rising = f(low) < 0.0;
    loop {
        let middle = low + 0.5 * (high - low);
        if middle <= low || middle >= high {
            return middle;
        }
        if (f(middle) < 0.0) == rising {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn newton_finds_the_root_of_a_growing_function_from_any_start(
            root in 0.01..20.0f64,
            start in -5.0..50.0f64,
        ) {
            let f = |x: f64| (x * x * x - root * root * root, 3.0 * x * x);
            let found = newton(f, 1e-3, 60.0, start);
            prop_assert!((found - root).abs() <= 1e-14 * root.max(1.0) , "{found} {root}");
        }

        #[test]
        fn bisection_finds_where_the_sign_changes(root in -3.0..3.0f64, falling in any::<bool>()) {
            let sign = if falling { -1.0 } else { 1.0 };
            let found = bisect(|x| sign * (x - root), -4.0, 4.0);
            prop_assert!((found - root).abs() <= 1e-15 * 4.0, "{found} {root}");
        }
    }
}
