//! Whether the place of the cameras can be trusted: date and residual of the frames that join them to the pose.

use stillpoint_operator::frames::{Frame, Frames};
use stillpoint_operator::{Choice, Params};

/// Whether a condition is required for arming.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Need {
    /// It is required.
    Required,
    /// It is not required, for a bench without it.
    Waived,
}

/// When the place of a camera can be trusted.
#[derive(Clone, Debug, Params)]
pub struct ExtrinsicParams {
    /// Whether a valid extrinsic is required.
    #[param(default = "required")]
    pub need: Need,
    /// Largest residual of the measurement of a frame.
    #[param(unit = "m", default = "1 mm", above = "0 mm", max = "100 mm")]
    pub max_residual: f64,
    /// Largest age of that measurement, in whole days of its date. Without this parameter, any age; a simulated session
    /// has no date.
    #[param(unit = "ns", min = "24 h")]
    pub max_age: Option<u64>,
    /// The frames that are checked. Without this parameter, all frames that are connected to the frame of the pose.
    pub frames: Option<Vec<String>>,
}

/// What is known of the frames between cameras and pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Extrinsic {
    fault: Option<String>,
    /// Day of the oldest measurement, from 1970-01-01.
    oldest: Option<i64>,
    max_age: Option<u64>,
}

const DAY: u64 = 86_400_000_000_000;

impl Extrinsic {
    /// Looks at the frames that join cameras to a pose in `frame`.
    ///
    /// # Errors
    /// A name in `params.frames` that is no frame, in a sentence.
    pub fn of(params: &ExtrinsicParams, frames: &Frames, frame: Option<&str>) -> Result<Self, UnplacedFrame> {
        let waived = Self { fault: None, oldest: None, max_age: None };
        if params.need == Need::Waived {
            return Ok(waived);
        }
        let fault = |fault: String| Ok(Self { fault: Some(fault), ..waived.clone() });
        let counted = match (&params.frames, frame) {
            (Some(names), _) => {
                let named = |name: &String| {
                    frames.placed.get_key_value(name).ok_or_else(|| UnplacedFrame(name.clone()))
                };
                names.iter().map(named).collect::<Result<Vec<_>, _>>()?
            }
            (None, None) => return fault("the pose is in no frame".into()),
            (None, Some(pose)) => {
                frames.placed.iter().filter(|(name, _)| frames.transform(pose, name).is_some()).collect()
            }
        };
        if counted.is_empty() {
            return fault("no frame of a camera is joined to the frame of the pose".into());
        }
        let mut oldest: Option<i64> = None;
        for (name, frame) in counted {
            match day_of(frame, params.max_residual) {
                Ok(day) => oldest = Some(oldest.map_or(day, |o| o.min(day))),
                Err(why) => return fault(format!("the frame `{name}` {why}")),
            }
        }
        Ok(Self { fault: None, oldest, max_age: params.max_age })
    }

    /// Whether the frames can be trusted at `now`, ns since the epoch.
    #[must_use]
    pub fn is_valid(&self, now: u64) -> bool {
        let days = |oldest: i64| ((now / DAY) as i64).saturating_sub(oldest).max(0) as u64;
        let is_old = match (self.oldest, self.max_age) {
            (Some(oldest), Some(most)) => days(oldest).saturating_mul(DAY) > most,
            _ => false,
        };
        self.fault.is_none() && !is_old
    }

    /// The reason why they cannot be valid on any day, as text.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}

/// A name of the parameters that is not the name of a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` in `extrinsic.frames` is not a frame that `frames` places")]
pub struct UnplacedFrame(String);

/// Why the measurement of a frame is not valid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
enum FrameFault {
    #[error("has no `measured: YYYY-MM-DD`")]
    NotMeasured,
    #[error("has no `residual`")]
    NoResidual,
    #[error("has a residual of {} mm, more than {} mm", found * 1e3, most * 1e3)]
    Residual { found: f64, most: f64 },
    #[error("has no date: {0}")]
    Date(String),
}

/// Day of a frame's measurement, or the reason why it is not valid.
fn day_of(frame: &Frame, max_residual: f64) -> Result<i64, FrameFault> {
    let date = frame.measured.as_deref().ok_or(FrameFault::NotMeasured)?;
    match frame.residual {
        None => return Err(FrameFault::NoResidual),
        Some(r) if r <= max_residual => {}
        Some(found) => return Err(FrameFault::Residual { found, most: max_residual }),
    }
    day(date).ok_or_else(|| FrameFault::Date(date.to_owned()))
}

/// Days from 1970-01-01 to a date `YYYY-MM-DD` of the Gregorian calendar.
fn day(date: &str) -> Option<i64> {
    let mut parts = date.split('-').map(str::parse::<i64>);
    let (Some(Ok(year)), Some(Ok(month)), Some(Ok(day)), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return None;
    };
    let is_date = (1..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    // Years begin in March: the day that leap years add is then the last of its year.
    let (year, months) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    is_date.then(|| days + (153 * months + 2) / 5 + day - 1 - 719_468)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_operator::frames::Rigid;

    fn params() -> ExtrinsicParams {
        ExtrinsicParams { need: Need::Required, max_residual: 1e-3, max_age: None, frames: None }
    }

    fn frames(measured: Option<&str>, residual: Option<f64>) -> Frames {
        let frame = Frame {
            parent: "couch".into(),
            parent_from_frame: Rigid::IDENTITY,
            measured: measured.map(str::to_string),
            residual,
        };
        let elsewhere = Frame { parent: "wall".into(), measured: None, ..frame.clone() };
        let placed = [("camera".to_string(), frame), ("door".to_string(), elsewhere)];
        Frames { placed: placed.into_iter().collect() }
    }

    fn judged(frames: &Frames, params: &ExtrinsicParams) -> Extrinsic {
        Extrinsic::of(params, frames, Some("couch")).unwrap()
    }

    #[test]
    fn days_are_those_of_the_calendar() {
        let known =
            [("1970-01-01", 0), ("2000-02-29", 11_016), ("2000-03-01", 11_017), ("2026-11-21", 20_778)];
        for (date, number) in known {
            assert_eq!(day(date), Some(number), "{date}");
        }
        assert_eq!((day("2026-13-01"), day("2026-11"), day("yesterday")), (None, None, None));
    }

    #[test]
    fn a_frame_with_date_and_small_residual_is_trusted_and_others_say_what_they_lack() {
        let valid = judged(&frames(Some("2026-11-21"), Some(0.3e-3)), &params());
        assert!(valid.is_valid(0) && valid.is_valid(u64::MAX));
        for (measured, residual, word) in [
            (None, Some(0.3e-3), "measured"),
            (Some("2026-11-21"), None, "residual"),
            (Some("2026-11-21"), Some(2e-3), "2 mm"),
        ] {
            let fault = judged(&frames(measured, residual), &params());
            assert!(!fault.is_valid(0) && fault.fault().unwrap().contains(word), "{fault:?}");
        }
    }

    #[test]
    fn an_old_measurement_is_not_trusted() {
        let params = ExtrinsicParams { max_age: Some(30 * DAY), ..params() };
        let judged = judged(&frames(Some("2026-11-21"), Some(0.0)), &params);
        let day = |day: u64| judged.is_valid(day * DAY);
        assert!(day(20_778) && day(20_808) && !day(20_809));
        // A simulated session starts in 1970.
        assert!(day(0));
    }

    #[test]
    fn without_any_frame_of_a_camera_there_is_nothing_to_trust() {
        let frames = frames(Some("2026-11-21"), Some(0.0));
        assert!(!Extrinsic::of(&params(), &frames, None).unwrap().is_valid(0));
        assert!(!Extrinsic::of(&params(), &frames, Some("room")).unwrap().is_valid(0));
        assert!(!Extrinsic::of(&params(), &frames, Some("wall")).unwrap().is_valid(0));
        let waived = ExtrinsicParams { need: Need::Waived, ..params() };
        assert!(Extrinsic::of(&waived, &frames, None).unwrap().is_valid(0));
        let named = ExtrinsicParams { frames: Some(vec!["kamera".into()]), ..params() };
        assert!(Extrinsic::of(&named, &frames, None).unwrap_err().to_string().contains("kamera"));
    }
}
