//! The picture as SVG.

use std::fmt::Write;

use super::Drawing;
use super::layout::{LETTER, place};
use crate::escape::escape;

/// Style of a picture that stands alone. In a page, its variables have the colours of the page.
const STYLE: &str = "<style>:root{color-scheme:light dark}\
    .graph{--g-ink:light-dark(#1c1f24,#e6e8eb);--g-quiet:light-dark(#8a929e,#7b8490);--g-wash:light-dark(#f4f6f8,#22262c);\
    --g-paper:light-dark(#ffffff,#181b20);--g-loop:light-dark(#b3541e,#e0935f);--g-link:light-dark(#2766b0,#7fb2ee)}\
    .graph text{font:12px monospace;fill:var(--g-ink)}.graph text.input,.graph text.output,.graph text.process,.graph text.host\
    {fill:var(--g-ink);opacity:.75}.graph text.name{font-weight:bold;opacity:1}.graph rect{fill:none;stroke:var(--g-quiet)}\
    .graph rect.process{fill:var(--g-wash);stroke:none}.graph rect.host{stroke-dasharray:2 4}.graph rect.operator\
    {fill:var(--g-paper)}.graph path{fill:none;stroke:var(--g-quiet);stroke-width:1.3}.graph path.loop{stroke:var(--g-loop);\
    stroke-dasharray:6 4}.graph path.link{stroke:var(--g-link);stroke-dasharray:2 3}.graph path.tip{fill:var(--g-quiet);\
    stroke:none}.graph path.tip.loop{fill:var(--g-loop)}.graph path.tip.link{fill:var(--g-link)}</style>";

/// The picture as an SVG document that stands alone. Loops are dashed, links are dotted.
pub fn svg(drawing: &Drawing) -> String {
    element(drawing, " xmlns=\"http://www.w3.org/2000/svg\"")
}

/// The picture as an element of a page of HTML, which needs no name space.
pub fn svg_in_page(drawing: &Drawing) -> String {
    element(drawing, "")
}

fn element(drawing: &Drawing, name_space: &str) -> String {
    let layout = place(drawing);
    let (width, height) = layout.size;
    let mut out = format!(
        "<svg{name_space} class=\"graph\" width=\"{width:.0}\" height=\"{height:.0}\" \
         viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\">{STYLE}"
    );
    for rectangle in &layout.rectangles {
        let [x, y, w, h] = rectangle.at;
        let _ = write!(
            out,
            "<rect class=\"{}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" rx=\"4\"/>",
            rectangle.class
        );
    }
    for line in &layout.lines {
        let points: Vec<String> = line.points.iter().map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
        let _ = write!(out, "<path class=\"{}\" d=\"M{}\"/>", line.class, points.join("L"));
        if let Some((x, y)) = line.points.last() {
            let _ = write!(out, "<path class=\"tip {}\" d=\"M{x:.1} {y:.1}l-7 -3.5v7z\"/>", line.class);
        }
    }
    for label in &layout.labels {
        let length = label.text.chars().count() as f64 * LETTER;
        let _ = write!(
            out,
            "<text class=\"{}\" x=\"{:.1}\" y=\"{:.1}\" textLength=\"{length:.1}\">{}</text>",
            label.class,
            label.x,
            label.y,
            escape(&label.text)
        );
    }
    out.push_str("</svg>");
    out
}
