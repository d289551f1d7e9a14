//! The fluence of a beam in beam's-eye view.

use std::fmt::Write;

/// Centres of bixels (x, z, mm), and their weights.
type Map<'a> = (&'a [[f64; 2]], &'a [f64]);

/// Bixels by centre (x, z, mm) with their weights, those of the plan beside those of the segments.
pub struct Eye<'a> {
    /// As planned.
    pub planned: Map<'a>,
    /// Of the segments.
    pub shaped: Option<Map<'a>>,
    /// Width of a bixel, mm.
    pub width_mm: f64,
    /// Weight that is drawn darkest.
    pub most: f64,
}

/// Both maps side by side: x to the right, z up.
pub fn draw(eye: &Eye<'_>) -> String {
    let all = || eye.planned.0.iter().chain(eye.shaped.iter().flat_map(|(bixels, _)| bixels.iter()));
    let end = |axis: usize, sign: f64| {
        let most = all().map(|b| sign * b[axis]).fold(f64::NEG_INFINITY, f64::max);
        most + 0.5 * eye.width_mm
    };
    let (left, right, low, high) = (-end(0, -1.0), end(0, 1.0), -end(1, -1.0), end(1, 1.0));
    let (wide, tall, head, gap) = (right - left, high - low, 12.0, 12.0);
    let maps: Vec<(&str, Map<'_>)> = std::iter::once(("planned", eye.planned))
        .chain(eye.shaped.map(|shaped| ("segments", shaped)))
        .collect();
    let width = maps.len() as f64 * (wide + gap) - gap;
    let mut svg = format!(
        "<svg viewBox=\"-1 0 {:.1} {:.1}\" width=\"{:.0}\" role=\"img\" aria-label=\"fluence in beam's-eye view\">",
        width + 2.0,
        tall + head + 1.0,
        2.2 * width
    );
    for (place, (name, (bixels, weights))) in maps.into_iter().enumerate() {
        let from = place as f64 * (wide + gap);
        let _ = write!(
            svg,
            "<text x=\"{from:.1}\" y=\"8\" font-size=\"8\" fill=\"var(--quiet)\">{name}</text>\
             <rect x=\"{from:.1}\" y=\"{head}\" width=\"{wide:.1}\" height=\"{tall:.1}\" fill=\"none\" stroke=\"var(--rule)\" stroke-width=\"0.6\"/>"
        );
        for ([x, z], weight) in bixels.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
            let _ = write!(
                svg,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{w}\" height=\"{w}\" fill=\"var(--bar)\" fill-opacity=\"{:.3}\"/>",
                from + x - 0.5 * eye.width_mm - left,
                head + high - z - 0.5 * eye.width_mm,
                (weight / eye.most).clamp(0.0, 1.0),
                w = eye.width_mm
            );
        }
        // The axis of the beam.
        if left < 0.0 && right > 0.0 && low < 0.0 && high > 0.0 {
            let _ = write!(
                svg,
                "<path d=\"M{:.1} {:.1}h6m-3 -3v6\" stroke=\"var(--ink)\" stroke-width=\"0.7\"/>",
                from - left - 3.0,
                head + high
            );
        }
    }
    svg.push_str("</svg>");
    svg
}
