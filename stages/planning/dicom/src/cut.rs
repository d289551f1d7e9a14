//! Structures that the end of the images cuts.
//!
//! A target that is cut is another target: its volume, its isocentre and its dose would change. An organ that is cut has
//! other volumes and doses; the caller can allow that up to a size. Outlines and aids are cut and said.

use stillpoint_patient::case::Role;

use crate::raster::{Beyond, Drawn};

/// A part below this is rounding of contours, cm3.
const LEAST_CM3: f64 = 1e-3;

/// What becomes of a structure at the end of the images.
pub(crate) enum Cut {
    /// It is whole.
    Whole,
    /// It is cut, and that is said.
    Note(String),
    /// It is cut, and that is refused.
    Refused(String),
}

/// Whether this structure may be cut as it is.
pub(crate) fn cut(name: &str, role: Role, drawn: &Drawn, allowed_cm3: f64) -> Cut {
    let Beyond { volume_cm3, .. } = drawn.beyond;
    if volume_cm3 <= LEAST_CM3 {
        let ends = role == Role::Target && drawn.reaches_the_end;
        return match ends {
            true => Cut::Note(format!(
                "{name:?} is drawn up to the first or last image: where it goes on, the images end within it"
            )),
            false => Cut::Whole,
        };
    }
    let (drawn_cm3, places) = (drawn.drawn_cm3, places(&drawn.beyond));
    let size = format!("{name:?} reaches {places}: {volume_cm3:.2} of its {drawn_cm3:.2} cm3 are there");
    match role {
        Role::Target | Role::ClinicalTarget => Cut::Refused(format!("{size}; give the whole scan")),
        // The text is rounded up, so that the size that it names is enough.
        Role::Organ if volume_cm3 > allowed_cm3 => Cut::Refused(format!(
            "{size}; give the whole scan, or allow the cut by `--allow-cut {:.2}cm3`",
            libm::ceil(volume_cm3 * 100.0) / 100.0
        )),
        Role::Organ | Role::External | Role::Other => Cut::Note(format!("{size} and are cut off")),
    }
}

fn places(beyond: &Beyond) -> String {
    let places = [
        (beyond.low_mm > 0.0).then(|| format!("{:.1} mm beyond the images toward the feet", beyond.low_mm)),
        (beyond.high_mm > 0.0).then(|| format!("{:.1} mm beyond the images toward the head", beyond.high_mm)),
        (beyond.aside_cm3 > LEAST_CM3).then(|| "beyond their sides".to_owned()),
    ];
    places.into_iter().flatten().collect::<Vec<_>>().join(", ")
}
