//! What is said of a structure whose voxels are not plainly its contours: each sentence with the volumes.

use crate::raster::Drawn;

/// Planes farther apart than this are said, mm.
const FAR_MM: f64 = 5.0;
/// A mask that differs from its contours by more than this part is said.
const DIFFERENT: f64 = 0.05;

/// The sentences for this structure.
pub(crate) fn sentences(name: &str, drawn: &Drawn, lines: usize) -> Vec<String> {
    let mut texts = Vec::new();
    let mut say = |text: String| texts.push(format!("{name:?}: {text}"));
    let Drawn { mask_cm3, exclusive_cm3, repeated, overlapping, distance_mm, thickness_mm, .. } = *drawn;
    if lines > 0 {
        say(format!("{lines} contours are points or open lines and hold no volume"));
    }
    if repeated > 0 {
        say(format!(
            "{repeated} contours repeat another and count once: {mask_cm3:.2} cm3 (by exclusive or {exclusive_cm3:.2} cm3)"
        ));
    }
    if overlapping > 0 {
        say(format!(
            "contours overlap on {overlapping} planes and are united: {mask_cm3:.2} cm3 (by exclusive or {exclusive_cm3:.2} cm3)"
        ));
    }
    if distance_mm.is_finite() && distance_mm > FAR_MM {
        let (means, other, volume_cm3) = match thickness_mm < distance_mm {
            true => ("a slice", "with the space between them", drawn.filled_cm3),
            false => ("all of that distance", "for a slice each", drawn.slices_cm3),
        };
        say(format!(
            "contours are {distance_mm:.1} mm apart, and each represents {means}: {mask_cm3:.2} cm3 ({other} {volume_cm3:.2} cm3)"
        ));
    }
    // Where slabs do not touch at all, every distance is a gap and is said above.
    if let (Some(first), Some(last), true) =
        (drawn.gaps_mm.first(), drawn.gaps_mm.last(), thickness_mm >= distance_mm)
    {
        say(gap_text(*first, *last, drawn.gaps_mm.len(), drawn));
    }
    finish(texts, name, drawn)
}

fn gap_text(first: [f64; 2], last: [f64; 2], count: usize, drawn: &Drawn) -> String {
    let place = match count {
        1 => format!("there is no contour between {:.1} and {:.1} mm, and that gap", first[0], first[1]),
        n => format!("{n} gaps without contours are between {:.1} and {:.1} mm, and each", first[0], last[1]),
    };
    format!(
        "{place} stays empty: {:.2} cm3 (filled {:.2} cm3); where it is not a gap, draw the missing contours",
        drawn.mask_cm3, drawn.filled_cm3
    )
}

/// The rest: planes that no slice takes, and voxels that hold another volume than the contours.
fn finish(mut texts: Vec<String>, name: &str, drawn: &Drawn) -> Vec<String> {
    let inside_cm3 = drawn.drawn_cm3 - drawn.beyond.volume_cm3;
    if drawn.skipped > 0 {
        texts.push(format!(
            "{name:?}: {} planes of contours are closer than the images and are left out: {:.2} cm3 (with them {inside_cm3:.2} cm3)",
            drawn.skipped, drawn.mask_cm3
        ));
    } else if (drawn.mask_cm3 - inside_cm3).abs() > DIFFERENT * inside_cm3 && drawn.mask_cm3 > 0.0 {
        texts.push(format!(
            "{name:?}: its contours hold {inside_cm3:.2} cm3, its voxels {:.2} cm3: it is small for the images' voxels, or is at the end of the images",
            drawn.mask_cm3
        ));
    }
    texts
}
