//! A dose over a slice, with the beams that give it.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Case;
use stillpoint_plan::dose::BeamAngles;

use super::canvas::{INK, LETTER, Picture};
use super::slice::{Frame, Plane, marks, outlines, tissue};

/// Width of the scale beside the slice.
const SCALE_WIDTH: usize = 104;
const BAR_WIDTH: usize = 22;
/// Doses below this part of the largest are not shown; cover grows until the second.
const FAINT: [f64; 2] = [0.08, 0.35];
const COVER: f64 = 0.5;
/// How far from the edge of the slice the angle of a beam stands, pixels.
const LABEL_INSET: f64 = 58.0;
/// A beam that runs along the line of sight has no line.
const SEEN: f64 = 0.03;

/// What is drawn over a slice.
#[derive(Clone, Copy, Debug)]
pub struct Wash<'a> {
    /// Where the dose is.
    pub grid: &'a Grid,
    /// Gray.
    pub gray: &'a [f32],
    /// Dose of the scale's upper end, gray.
    pub most_gy: f64,
    /// Where the beams come from.
    pub beams: &'a [BeamAngles],
}

/// A dose over the slice of a case in a plane through its isocentre, with a scale in gray, the outlines of structures
/// and the axes of beams, each from the side of its source.
pub fn wash(case: &Case, plane: Plane, wash: &Wash<'_>) -> Picture {
    let (mut picture, frame) = tissue(case, plane);
    let width = picture.width();
    for y in 0..picture.height() {
        for x in 0..width {
            let gray = wash.grid.value_at(wash.gray, frame.place_mm(x, y));
            let part = f64::from(gray) / wash.most_gy;
            let cover = COVER * ((part - FAINT[0]) / (FAINT[1] - FAINT[0])).clamp(0.0, 1.0);
            if cover > 0.0 {
                picture.blend(x, y, colour(part), cover);
            }
        }
    }
    outlines(case, &frame, &mut picture);
    for angles in wash.beams {
        beam(case, &frame, angles, plane == Plane::Axial, &mut picture);
    }
    marks(case, plane, &frame, &mut picture);
    scale(wash.most_gy, &mut picture);
    picture
}

/// From blue over green and yellow to red.
fn colour(part: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 6] = [
        [40.0, 40.0, 200.0],
        [30.0, 140.0, 255.0],
        [40.0, 220.0, 160.0],
        [180.0, 230.0, 40.0],
        [255.0, 180.0, 20.0],
        [230.0, 20.0, 20.0],
    ];
    let place = part.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let low = (place as usize).min(STOPS.len() - 2);
    let share = place - low as f64;
    std::array::from_fn(|c| (STOPS[low][c] * (1.0 - share) + STOPS[low + 1][c] * share).round() as u8)
}

/// A dashed line along the axis of a beam from the edge of the slice to the isocentre.
fn beam(case: &Case, frame: &Frame, angles: &BeamAngles, labelled: bool, picture: &mut Picture) {
    let signs = case.position().signs();
    let source = angles.source();
    let to_source: [f64; 3] = std::array::from_fn(|axis| signs[axis] * source[axis]);
    let [dx, dy] = [frame.axes[0], frame.axes[1]].map(|axis| to_source[axis]);
    let length = libm::hypot(dx, dy);
    if length < SEEN {
        return;
    }
    let [dx, dy] = [dx / length, dy / length];
    let from = frame.pixel(case.isocentre_mm());
    let size = [picture.width(), picture.height()].map(|n| n as f64);
    let inside = |[x, y]: [f64; 2]| x >= 0.0 && y >= 0.0 && x < size[0] && y < size[1];
    let at = |step: f64| [from[0] + step * dx, from[1] + step * dy];
    let mut end = 0.0;
    while inside(at(end + 1.0)) {
        end += 1.0;
    }
    for step in 0..=end as usize {
        if step % 12 < 8 && step > 8 {
            let [x, y] = at(step as f64).map(|p| p as usize);
            picture.blend(x, y, INK, 0.8);
        }
    }
    if labelled {
        let [x, y] = at((end - LABEL_INSET).max(0.0));
        // Beside the line, on the side where the angle grows.
        let tenths = |deg: f64| (10.0 * deg).round() / 10.0;
        let shown = BeamAngles { gantry_deg: tenths(angles.gantry_deg), couch_deg: tenths(angles.couch_deg) };
        let text = format!("{shown}\u{b0}");
        picture.text_around(&text, [x - 28.0 * dy, y + 16.0 * dx], size[0] as usize);
    }
}

/// A bar of colours with doses beside it.
fn scale(most_gy: f64, picture: &mut Picture) {
    let left = picture.width();
    picture.widen(SCALE_WIDTH);
    let (top, bottom) = (34, picture.height().saturating_sub(14));
    let height = bottom.saturating_sub(top).max(1);
    for y in top..bottom {
        let part = (bottom - y) as f64 / height as f64;
        for x in left + 14..left + 14 + BAR_WIDTH {
            picture.paint(x, y, colour(part));
        }
    }
    picture.text("Gy", left + 14, 10);
    let room = (height / (2 * LETTER[1])).max(1) as f64;
    let step = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0].into_iter().find(|s| most_gy / s <= room);
    let step = step.unwrap_or(most_gy);
    let mut dose = 0.0;
    while dose <= most_gy {
        let y = bottom as f64 - dose / most_gy * height as f64;
        for x in left + 14 + BAR_WIDTH..left + 20 + BAR_WIDTH {
            picture.paint(x, (y as usize).min(picture.height() - 1), INK);
        }
        let row = (y as usize).saturating_sub(LETTER[1] / 2).min(picture.height().saturating_sub(LETTER[1]));
        picture.text(&format!("{dose}"), left + 24 + BAR_WIDTH, row);
        dose += step;
    }
}
