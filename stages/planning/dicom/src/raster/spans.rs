//! Sets of intervals on a row. Intervals are half open, sorted, and do not touch.

pub(super) type Spans = Vec<[f64; 2]>;

/// The length of all intervals.
pub(super) fn length(spans: &[[f64; 2]]) -> f64 {
    spans.iter().map(|[from, to]| to - from).sum()
}

/// The intervals between the odd and the even crossings.
pub(super) fn even_odd(mut crossings: Vec<f64>) -> Spans {
    crossings.sort_by(f64::total_cmp);
    let pairs: Spans = crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    unite(pairs)
}

/// What any of these intervals holds.
pub(super) fn unite(mut spans: Spans) -> Spans {
    spans.retain(|[from, to]| from < to);
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut united: Spans = Vec::with_capacity(spans.len());
    for [from, to] in spans {
        match united.last_mut() {
            Some(last) if from <= last[1] => last[1] = last[1].max(to),
            _ => united.push([from, to]),
        }
    }
    united
}

/// What `spans` hold and `without` do not.
pub(super) fn subtract(spans: &[[f64; 2]], without: &[[f64; 2]]) -> Spans {
    let mut left = Vec::with_capacity(spans.len());
    for &[mut from, to] in spans {
        for &[hole_from, hole_to] in without {
            if hole_to <= from || hole_from >= to {
                continue;
            }
            if hole_from > from {
                left.push([from, hole_from]);
            }
            from = hole_to;
        }
        if from < to {
            left.push([from, to]);
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spans() -> impl Strategy<Value = Spans> {
        prop::collection::vec((0..40_u8, 0..10_u8), 0..6)
            .prop_map(|pairs| unite(pairs.iter().map(|&(a, n)| [f64::from(a), f64::from(a + n)]).collect()))
    }

    fn holds(spans: &[[f64; 2]], x: f64) -> bool {
        spans.iter().any(|&[from, to]| from <= x && x < to)
    }

    proptest! {
        #[test]
        fn sets_hold_the_points_that_they_should(a in spans(), b in spans()) {
            let united = unite([a.clone(), b.clone()].concat());
            let left = subtract(&a, &b);
            let exclusive = even_odd([a.clone(), b.clone()].concat().into_flattened());
            for x in (0..60).map(|x| f64::from(x) + 0.5) {
                let (in_a, in_b) = (holds(&a, x), holds(&b, x));
                prop_assert_eq!(holds(&united, x), in_a || in_b);
                prop_assert_eq!(holds(&left, x), in_a && !in_b);
                prop_assert_eq!(holds(&exclusive, x), in_a != in_b);
            }
        }
    }
}
