//! Step responses: rise, overshoot, settling, and the remaining error.

use serde::Serialize;

/// A target is a step where it stood this long before, and stands this long after, s.
const STANDS: f64 = 1.0;
/// A step is settled if the remaining error is less than this fraction of it.
const BAND: f64 = 0.05;

/// A step of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TargetStep {
    /// When it came, s.
    pub at_s: f64,
    /// When the target changed next, or the session ended, s.
    pub until_s: f64,
    /// Target before and after.
    pub from: f64,
    pub to: f64,
}

/// The answer to a step, in the unit of the target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Response {
    #[serde(flatten)]
    pub step: TargetStep,
    /// How long it was between 10 % and 90 % of the step, s; none where 90 % was not reached. Where it goes up evenly that
    /// is the time from the one to the other. What swings about its way, as a head that breathes, crosses 90 % for the
    /// first time too early, by as much as its swing is large beside how slowly it comes.
    pub rise_s: Option<f64>,
    /// From the step until it stays within 5 % of the step, s; none where it does not.
    pub settling_s: Option<f64>,
    /// Farthest beyond the target.
    pub overshoot: f64,
    /// Mean distance from the target over the last quarter.
    pub left: f64,
    /// Standard deviation over the last quarter.
    pub sd: f64,
}

/// The steps of a target over time: (s, value), in the order of time, that lasted until `end`.
pub fn steps(target: &[(f64, f64)], end: f64) -> Vec<TargetStep> {
    // Where it changed, and to what.
    let mut changes: Vec<(f64, f64)> = Vec::new();
    for (time, value) in target.iter().filter(|p| p.1.is_finite()) {
        if changes.last().is_none_or(|(_, last)| last != value) {
            changes.push((*time, *value));
        }
    }
    let ends = changes.iter().skip(1).map(|c| c.0).chain([end]).collect::<Vec<_>>();
    let pairs = changes.windows(2).zip(ends.iter().skip(1));
    let stood = pairs.filter(|(w, end)| w[1].0 - w[0].0 >= STANDS && **end - w[1].0 >= STANDS);
    stood.map(|(w, end)| TargetStep { at_s: w[1].0, until_s: *end, from: w[0].1, to: w[1].1 }).collect()
}

/// The answer of a value over time to a step.
pub fn response(step: TargetStep, value: &[(f64, f64)]) -> Option<Response> {
    let during: Vec<(f64, f64)> = value
        .iter()
        .filter(|p| (step.at_s..step.until_s).contains(&p.0) && p.1.is_finite())
        .copied()
        .collect();
    let height = step.to - step.from;
    if during.len() < 4 || height == 0.0 {
        return None;
    }
    let part = |v: f64| (v - step.from) / height;
    let between = during.windows(2).filter(|w| (0.1..0.9).contains(&part(w[0].1))).map(|w| w[1].0 - w[0].0);
    let reached = during.iter().any(|p| part(p.1) >= 0.9);
    let last_outside = during.iter().rposition(|p| (part(p.1) - 1.0).abs() > BAND);
    let settled = match last_outside {
        None => during.first(),
        Some(at) => during.get(at + 1),
    };
    let quarter = &during[during.len() * 3 / 4..];
    let n = quarter.len() as f64;
    let left = quarter.iter().map(|p| p.1 - step.to).sum::<f64>() / n;
    let sd = (quarter.iter().map(|p| (p.1 - step.to - left).powi(2)).sum::<f64>() / n).sqrt();
    let beyond = during.iter().map(|p| (part(p.1) - 1.0) * height.abs()).fold(0.0, f64::max);
    Some(Response {
        step,
        rise_s: reached.then(|| between.sum()),
        settling_s: settled.map(|p| p.0 - step.at_s),
        overshoot: beyond,
        left,
        sd,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target() -> Vec<(f64, f64)> {
        (0..600).map(|k| 0.1 * f64::from(k)).map(|t| (t, if t < 5.0 { 1.0 } else { 3.0 })).collect()
    }

    #[test]
    fn a_first_order_system_has_the_rise_and_the_settling_of_its_time_constant() {
        let steps = steps(&target(), 60.0);
        assert_eq!(steps, [TargetStep { at_s: 5.0, until_s: 60.0, from: 1.0, to: 3.0 }]);
        let tau: f64 = 4.0;
        let value = |t: f64| if t < 5.0 { 1.0 } else { 3.0 - 2.0 * (-(t - 5.0) / tau).exp() };
        let points: Vec<_> = (0..60_000).map(|k| 1e-3 * f64::from(k)).map(|t| (t, value(t))).collect();
        let found = response(steps[0], &points).unwrap();
        assert!((found.rise_s.unwrap() - tau * 9f64.ln()).abs() < 3e-3, "{found:?}");
        assert!((found.settling_s.unwrap() - tau * 20f64.ln()).abs() < 3e-3, "{found:?}");
        assert!(found.overshoot == 0.0 && found.left.abs() < 1e-3 && found.sd < 1e-3);
    }

    #[test]
    fn what_breathes_on_its_way_rises_as_slowly_as_what_does_not() {
        let step = TargetStep { at_s: 0.0, until_s: 120.0, from: 0.0, to: 1.0 };
        let (rise, swing, period) = (20.0, 0.045, 4.0);
        let mut crossings = Vec::new();
        for phase in 0..8 {
            let breath =
                |t: f64| swing * (core::f64::consts::TAU * (t / period + f64::from(phase) / 8.0)).sin();
            let points: Vec<_> = (0..12_000)
                .map(|k| 0.01 * f64::from(k))
                .map(|t| (t, 1.0 - (-t * 9f64.ln() / rise).exp() + breath(t)))
                .collect();
            let first = |level: f64| points.iter().find(|p| p.1 >= level).unwrap().0;
            crossings.push(first(0.9) - first(0.1));
            let found = response(step, &points).unwrap().rise_s.unwrap();
            assert!((found / rise - 1.0).abs() < 0.06, "{phase}: {found}");
        }
        assert!(crossings.iter().any(|c| *c < 17.0), "first crossings are too early: {crossings:?}");
    }

    #[test]
    fn a_second_order_system_goes_beyond_by_what_its_damping_says() {
        let (zeta, omega): (f64, f64) = (0.4, 1.0);
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        let answer = |t: f64| {
            1.0 - (-zeta * omega * t).exp()
                * ((damped * t).cos() + zeta * omega / damped * (damped * t).sin())
        };
        // Downwards: beyond is below.
        let step = TargetStep { at_s: 2.0, until_s: 50.0, from: 1.0, to: -1.0 };
        let points: Vec<_> = (0..50_000)
            .map(|k| 1e-3 * f64::from(k))
            .map(|t| (t, 1.0 - 2.0 * answer(f64::max(t - 2.0, 0.0))))
            .collect();
        let found = response(step, &points).unwrap();
        let expected = 2.0 * (-core::f64::consts::PI * zeta / (1.0 - zeta * zeta).sqrt()).exp();
        assert!((found.overshoot - expected).abs() < 1e-5, "{found:?} {expected}");
    }

    #[test]
    fn a_ramp_is_no_step_and_what_is_never_reached_has_no_rise() {
        let ramp: Vec<(f64, f64)> = (0..100).map(|k| (0.1 * f64::from(k), 0.01 * f64::from(k))).collect();
        assert!(steps(&ramp, 10.0).is_empty() && steps(&[], 1.0).is_empty());
        let step = TargetStep { at_s: 0.0, until_s: 10.0, from: 0.0, to: 1.0 };
        let lazy: Vec<_> = (0..100).map(|k| (0.1 * f64::from(k), 0.3)).collect();
        let found = response(step, &lazy).unwrap();
        assert_eq!((found.rise_s, found.settling_s), (None, None));
        assert!((found.left + 0.7).abs() < 1e-12 && response(step, &lazy[..3]).is_none());
    }
}
