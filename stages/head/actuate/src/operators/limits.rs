//! The limits of the beam that change while it runs: only to narrower ones while the beam is on.

use stillpoint_operator::AdoptError;

use super::beam::BeamParams;
use crate::aim::Tolerances;

/// The live parameters of `gate.beam`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    position_tolerance: f64,
    angle_tolerance: f64,
    drift_tolerance: f64,
    drift_angle: f64,
    position_sd: f64,
    angle_sd: f64,
    hysteresis: f64,
    confidence: f64,
    /// ns.
    dwell: u64,
}

impl Limits {
    pub fn of(params: &BeamParams) -> Self {
        Self {
            position_tolerance: params.position_tolerance,
            angle_tolerance: params.angle_tolerance,
            drift_tolerance: params.drift_tolerance,
            drift_angle: params.drift_angle,
            position_sd: params.position_sd,
            angle_sd: params.angle_sd,
            hysteresis: params.hysteresis,
            confidence: params.confidence,
            dwell: params.dwell,
        }
    }

    pub fn tolerances(&self) -> Tolerances {
        Tolerances {
            position: self.position_tolerance,
            angle: self.angle_tolerance,
            begin: 1.0 - self.hysteresis,
            position_sd: self.position_sd,
            angle_sd: self.angle_sd,
        }
    }

    /// Refuses limits of which one lets more through than before.
    ///
    /// # Errors
    /// The first such limit, with its value and what is allowed.
    pub fn refuse_wider(&self, before: &Self) -> Result<(), AdoptError> {
        let (millimetres, degrees) = ((1e3, "mm"), (1.0_f64.to_degrees(), "deg"));
        let upper = [
            ("position_tolerance", self.position_tolerance, before.position_tolerance, millimetres),
            ("angle_tolerance", self.angle_tolerance, before.angle_tolerance, degrees),
            ("drift_tolerance", self.drift_tolerance, before.drift_tolerance, millimetres),
            ("drift_angle", self.drift_angle, before.drift_angle, degrees),
            ("position_sd", self.position_sd, before.position_sd, millimetres),
            ("angle_sd", self.angle_sd, before.angle_sd, degrees),
        ];
        let lower = [
            ("hysteresis", self.hysteresis, before.hysteresis, (1.0, "")),
            ("confidence", self.confidence, before.confidence, (1.0, "")),
            ("dwell", self.dwell as f64, before.dwell as f64, (1e-6, "ms")),
        ];
        let wider = upper.into_iter().map(|limit| (limit, "up to")).find(|((_, now, was, _), _)| now > was);
        let wider = wider.or_else(|| {
            lower.into_iter().map(|limit| (limit, "at least")).find(|((_, now, was, _), _)| now < was)
        });
        let Some(((name, now, was, (scale, unit)), bound)) = wider else { return Ok(()) };
        let text =
            |value: f64| format!("{} {unit}", (value * scale * 1e6).round() / 1e6).trim_end().to_owned();
        Err(AdoptError(format!(
            "`{name}` is wider while the beam is on: {} (allowed: {bound} {}); wait until the beam is off, or send console.disarm",
            text(now),
            text(was)
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEFORE: Limits = Limits {
        position_tolerance: 1e-3,
        angle_tolerance: 0.01,
        drift_tolerance: 2e-3,
        drift_angle: 0.02,
        position_sd: 5e-4,
        angle_sd: 0.005,
        hysteresis: 0.2,
        confidence: 0.5,
        dwell: 500_000_000,
    };

    #[test]
    fn narrower_limits_pass_and_each_wider_one_is_refused_with_what_is_allowed() {
        let narrower = Limits { position_tolerance: 5e-4, hysteresis: 0.3, dwell: 600_000_000, ..BEFORE };
        assert!(narrower.refuse_wider(&BEFORE).is_ok() && BEFORE.refuse_wider(&BEFORE).is_ok());
        let wider = [
            (
                "position_tolerance",
                Limits { position_tolerance: 1.1e-3, ..BEFORE },
                "1.1 mm (allowed: up to 1 mm)",
            ),
            ("angle_tolerance", Limits { angle_tolerance: 0.02, ..BEFORE }, "(allowed: up to 0.572958 deg)"),
            ("drift_tolerance", Limits { drift_tolerance: 3e-3, ..BEFORE }, "3 mm (allowed: up to 2 mm)"),
            ("drift_angle", Limits { drift_angle: 0.03, ..BEFORE }, "deg"),
            ("position_sd", Limits { position_sd: 6e-4, ..BEFORE }, "0.6 mm (allowed: up to 0.5 mm)"),
            ("angle_sd", Limits { angle_sd: 0.006, ..BEFORE }, "deg"),
            ("hysteresis", Limits { hysteresis: 0.1, ..BEFORE }, "0.1 (allowed: at least 0.2)"),
            ("confidence", Limits { confidence: 0.4, ..BEFORE }, "0.4 (allowed: at least 0.5)"),
            ("dwell", Limits { dwell: 400_000_000, ..BEFORE }, "400 ms (allowed: at least 500 ms)"),
        ];
        for (name, limits, words) in wider {
            let refused = limits.refuse_wider(&BEFORE).unwrap_err().to_string();
            assert!(refused.starts_with(&format!("`{name}` is wider while the beam is on")), "{refused}");
            assert!(refused.contains(words), "{refused}");
        }
    }
}
