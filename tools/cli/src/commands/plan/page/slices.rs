//! Slices of the image with isodose lines and the outlines of structures, as drawings in millimetres.

use std::fmt::Write;

use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Role};
use stillpoint_report::chart::colour;
use stillpoint_report::isolines::isolines;
use stillpoint_report::page::Block;
use stillpoint_report::{base64, escape};

use crate::exit::Failure;
use crate::picture::Plane;

/// Isodoses in percent of the highest prescription, with their colours.
pub const ISODOSES: [(f64, &str); 6] = [
    (107.0, "#ff5cf4"),
    (100.0, "#ff4d4d"),
    (95.0, "#ffa02e"),
    (80.0, "#ffe14d"),
    (50.0, "#5fe07d"),
    (30.0, "#5cb8ff"),
];
/// Soft tissue and bone are both seen in this window.
const WINDOW_HU: [f64; 2] = [-250.0, 450.0];
/// How far beyond the targets slices are shown, mm, and how many at most.
const BEYOND_MM: f64 = 20.0;
const MOST_SLICES: usize = 21;
/// A line shorter than this has no label, nodes.
const LABELLED: usize = 12;

/// A dose over a case.
#[derive(Clone, Copy)]
pub struct Dosed<'a> {
    pub case: &'a Case,
    pub grid: &'a Grid,
    pub gray: &'a [f32],
    pub prescribed_gy: f64,
}

/// The slices of a plane around the targets; that of the isocentre is seen first.
pub fn stack(dosed: &Dosed<'_>, plane: Plane) -> Result<Block, Failure> {
    let [_, _, across] = plane.axes();
    let grid = dosed.case.grid();
    let slice_of = |mm: f64| {
        let place = libm::round((mm - grid.origin_mm[across]) / grid.spacing_mm[across]).max(0.0) as usize;
        place.min(grid.counts[across] - 1)
    };
    let isocentre = slice_of(dosed.case.isocentre_mm()[across]);
    let (mut low, mut high) = (isocentre, isocentre);
    for target in dosed.case.targets() {
        for voxel in target.mask.indices() {
            let place = grid.voxel(voxel)[across];
            (low, high) = (low.min(place), high.max(place));
        }
    }
    let beyond = libm::ceil(BEYOND_MM / grid.spacing_mm[across]) as usize;
    let (low, high) = (low.saturating_sub(beyond), (high + beyond).min(grid.counts[across] - 1));
    let step = (high - low).div_ceil(MOST_SLICES).max(1);
    // Steps go out from the slice of the isocentre, so that it is one of them.
    let mut slices: Vec<usize> = (low..=high).filter(|s| s.abs_diff(isocentre) % step == 0).collect();
    if across == 2 {
        slices.reverse();
    }
    let first = slices.iter().position(|s| *s == isocentre).unwrap_or_default();
    let axis = ["x", "y", "z"][across];
    let drawing = |slice: &usize| -> Result<(String, String), Failure> {
        let mm = grid.centre_mm(std::array::from_fn(|k| if k == across { *slice } else { 0 }))[across];
        let centre = if *slice == isocentre { ", through the isocentre" } else { "" };
        Ok((draw(dosed, plane, *slice)?, format!("{axis} = {mm:.1} mm{centre}")))
    };
    let drawings: Result<Vec<_>, Failure> = slices.iter().map(drawing).collect();
    Ok(Block::Stack { title: format!("{} slices", plane.name()), drawings: drawings?, first })
}

/// A place of the picture, mm from its left upper corner.
struct Sheet {
    axes: [usize; 3],
    image: Grid,
}

impl Sheet {
    fn size_mm(&self) -> [f64; 2] {
        [self.axes[0], self.axes[1]].map(|axis| self.image.counts[axis] as f64 * self.image.spacing_mm[axis])
    }

    /// Where a place along both axes (mm of the patient) is on the sheet; the head is up.
    fn at(&self, place_mm: [f64; 2]) -> [f64; 2] {
        let size = self.size_mm();
        std::array::from_fn(|k| {
            let axis = self.axes[k];
            let along = place_mm[k] - self.image.origin_mm[axis] + 0.5 * self.image.spacing_mm[axis];
            if axis == 2 { size[k] - along } else { along }
        })
    }
}

fn draw(dosed: &Dosed<'_>, plane: Plane, slice: usize) -> Result<String, Failure> {
    let image = *dosed.case.grid();
    let sheet = Sheet { axes: plane.axes(), image };
    let [width, height] = sheet.size_mm();
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width:.1} {height:.1}\" role=\"img\" aria-label=\"{} slice with isodose lines\">",
        plane.name()
    );
    let _ = write!(
        svg,
        "<image width=\"{width:.1}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" href=\"data:image/png;base64,{}\"/>",
        base64(&tissue(dosed.case, &sheet, slice)?)
    );
    let _ = write!(
        svg,
        "<image width=\"{width:.1}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" class=\"wash\" href=\"data:image/png;base64,{}\"/>",
        base64(&wash(dosed, &sheet, slice)?)
    );
    structures(dosed.case, &sheet, slice, &mut svg);
    isodoses(dosed, &sheet, slice, &mut svg);
    let [x, y] = sheet.at([sheet.axes[0], sheet.axes[1]].map(|axis| dosed.case.isocentre_mm()[axis]));
    let _ = write!(
        svg,
        "<path d=\"M{:.1} {y:.1}h8M{x:.1} {:.1}v8\" stroke=\"#fff\" stroke-width=\"0.8\"/>",
        x - 4.0,
        y - 4.0
    );
    let [left, right, top, bottom] = plane.sides();
    for (side, x, y) in [
        (left, 6.0, 0.5 * height),
        (right, width - 6.0, 0.5 * height),
        (top, 0.5 * width, 11.0),
        (bottom, 0.5 * width, height - 4.0),
    ] {
        let _ = write!(
            svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"#fff\" font-size=\"11\" text-anchor=\"middle\">{side}</text>"
        );
    }
    svg.push_str("</svg>");
    Ok(svg)
}

/// The image as a PNG, a pixel for each voxel.
fn tissue(case: &Case, sheet: &Sheet, slice: usize) -> Result<Vec<u8>, Failure> {
    let [u, v, across] = sheet.axes;
    let (columns, rows) = (sheet.image.counts[u], sheet.image.counts[v]);
    let mut pixels = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let mut voxel = [0; 3];
            voxel[u] = column;
            voxel[v] = if v == 2 { rows - 1 - row } else { row };
            voxel[across] = slice;
            let hu = f64::from(case.hu()[sheet.image.index(voxel)]);
            let part = (hu - WINDOW_HU[0]) / (WINDOW_HU[1] - WINDOW_HU[0]);
            pixels.push((255.0 * part.clamp(0.0, 1.0)) as u8);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, columns as u32, rows as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&pixels));
    written.map(|()| bytes).map_err(Failure::failed)
}

/// Part of the prescription from which on the dose has a colour, and how much of the image the colour covers.
const WASH_FROM: f64 = 0.1;
const WASH_COVER: f64 = 0.35;

/// The dose as a PNG, a pixel for each voxel of the image: between the colours of the isodoses, and nothing where there is
/// little.
fn wash(dosed: &Dosed<'_>, sheet: &Sheet, slice: usize) -> Result<Vec<u8>, Failure> {
    let [u, v, across] = sheet.axes;
    let (columns, rows) = (sheet.image.counts[u], sheet.image.counts[v]);
    let scale: Vec<(f64, [f64; 3])> = ISODOSES
        .iter()
        .rev()
        .map(|(percent, colour)| {
            let part = |at: usize| colour.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok());
            (0.01 * percent, [1, 3, 5].map(|at| f64::from(part(at).unwrap_or_default())))
        })
        .collect();
    let mut pixels = Vec::with_capacity(4 * columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let mut voxel = [0; 3];
            voxel[u] = column;
            voxel[v] = if v == 2 { rows - 1 - row } else { row };
            voxel[across] = slice;
            let gray = dosed.grid.value_at(dosed.gray, sheet.image.centre_mm(voxel));
            let part = f64::from(gray) / dosed.prescribed_gy.max(f64::MIN_POSITIVE);
            if part < WASH_FROM {
                pixels.extend([0; 4]);
                continue;
            }
            let after = scale.partition_point(|(level, _)| *level <= part);
            let (low, high) = (&scale[after.saturating_sub(1)], &scale[after.min(scale.len() - 1)]);
            let along = if high.0 > low.0 { (part - low.0) / (high.0 - low.0) } else { 0.0 };
            pixels.extend((0..3).map(|c| (low.1[c] + along * (high.1[c] - low.1[c])) as u8));
            pixels.push((255.0 * WASH_COVER) as u8);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, columns as u32, rows as u32);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&pixels));
    written.map(|()| bytes).map_err(Failure::failed)
}

/// Outlines, each in the colour of its line in the histogram.
fn structures(case: &Case, sheet: &Sheet, slice: usize, svg: &mut String) {
    let [u, v, across] = sheet.axes;
    for (number, structure) in case.structures().iter().enumerate() {
        let inside = |a: usize, b: usize| {
            let mut voxel = [0; 3];
            (voxel[u], voxel[v], voxel[across]) = (a, b, slice);
            if structure.mask.contains(sheet.image.index(voxel)) { 1.0 } else { 0.0 }
        };
        let lines = isolines([sheet.image.counts[u], sheet.image.counts[v]], inside, 0.5);
        let path = path(sheet, &sheet.image, &lines);
        if !path.is_empty() {
            let wide = if structure.role == Role::Target { 1.8 } else { 1.2 };
            let _ = write!(
                svg,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{wide}\"><title>{}</title></path>",
                on_dark(number),
                escape(&structure.name)
            );
        }
    }
}

/// The colour of a structure in the histogram; black is white on an image.
pub fn on_dark(number: usize) -> String {
    match colour(number) {
        [0, 0, 0] => "#ffffff".to_owned(),
        [r, g, b] => format!("#{r:02x}{g:02x}{b:02x}"),
    }
}

fn isodoses(dosed: &Dosed<'_>, sheet: &Sheet, slice: usize, svg: &mut String) {
    let [u, v, across] = sheet.axes;
    let grid = dosed.grid;
    let height_mm =
        sheet.image.centre_mm(std::array::from_fn(|k| if k == across { slice } else { 0 }))[across];
    let [columns, rows] = [grid.counts[u], grid.counts[v]];
    let mut values = Vec::with_capacity(columns * rows);
    for b in 0..rows {
        for a in 0..columns {
            let mut voxel = [0; 3];
            (voxel[u], voxel[v]) = (a, b);
            let mut place = grid.centre_mm(voxel);
            place[across] = height_mm;
            values.push(f64::from(grid.value_at(dosed.gray, place)));
        }
    }
    let mut labels = String::new();
    for (percent, colour) in ISODOSES {
        let level = 0.01 * percent * dosed.prescribed_gy;
        let lines = isolines([columns, rows], |a, b| values[b * columns + a], level);
        let path = path(sheet, grid, &lines);
        if path.is_empty() {
            continue;
        }
        let _ = write!(
            svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"0.9\" stroke-dasharray=\"{}\"/>",
            if percent >= 95.0 { "none" } else { "4 1.5" }
        );
        let longest = lines.iter().max_by_key(|line| line.len()).filter(|line| line.len() >= LABELLED);
        if let Some(line) = longest {
            // Labels of neighbouring levels do not stand beside each other.
            let part = 0.1 + 0.005 * percent;
            let [a, b] = line[((line.len() as f64 * part) as usize) % line.len()];
            let [x, y] = sheet.at(along(sheet, grid, [a, b]));
            let _ = write!(
                labels,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{colour}\" stroke=\"#000\" stroke-width=\"2\" \
                 paint-order=\"stroke\" font-size=\"8.5\" text-anchor=\"middle\">{percent}</text>"
            );
        }
    }
    svg.push_str(&labels);
}

/// Places of the patient along both axes (mm) of a place in units of a grid.
fn along(sheet: &Sheet, grid: &Grid, place: [f64; 2]) -> [f64; 2] {
    std::array::from_fn(|k| grid.origin_mm[sheet.axes[k]] + place[k] * grid.spacing_mm[sheet.axes[k]])
}

fn path(sheet: &Sheet, grid: &Grid, lines: &[Vec<[f64; 2]>]) -> String {
    let mut path = String::new();
    for line in lines {
        for (at, place) in line.iter().enumerate() {
            let [x, y] = sheet.at(along(sheet, grid, *place));
            let _ = write!(path, "{}{x:.1} {y:.1}", if at == 0 { 'M' } else { 'L' });
        }
    }
    path
}
