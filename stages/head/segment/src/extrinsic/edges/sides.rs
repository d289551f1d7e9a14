//! Two long edges at the couch's width, and the edge at its head end.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::cracks::Crack;
use super::error::EdgeError;

/// Steps of the angle of the search, rad.
const ANGLE: f64 = 0.004;
/// Width of a bin of the search, m.
const BIN: f64 = 4e-3;
/// Most that the width may differ in the search, m, and how far places of an edge may be from its bin, m.
const NEAR: f64 = 0.012;
/// Fewest places of an edge.
const LEAST: usize = 60;
/// Distance from a corner of the couch within which places are left out, m: corners are round.
const CORNER: f64 = 0.03;
/// Largest scatter of an edge, px.
const SCATTER: f64 = 0.8;
/// Pieces of the head end, and least share of them that is in view.
const PIECES: usize = 20;
const SEEN: f64 = 0.8;
/// Least share of the places of an edge that are on its line.
const ON_LINE: f64 = 0.8;
/// Most that an edge may be blurred, px, and least: then it is seen wider than it is.
const BLUR: [f64; 2] = [-1.0, 2.5];
/// Most that the head end may be off square, degrees.
const SQUARE_DEG: f64 = 0.5;

/// An edge: its places, and how well they are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Places on it.
    pub places: usize,
    /// Root of the mean square of their distances from the line, px.
    pub scatter: f64,
    /// One pixel across it, m.
    pub pixel: f64,
    /// Columns or rows of the image that it crosses.
    pub lines: usize,
}

impl Edge {
    /// One standard deviation of its place by pixels that are either on it or not: an edge along a row of pixels is anywhere
    /// in it, one across many is known to a part.
    pub fn sigma(&self) -> f64 {
        self.pixel * 12_f64.sqrt().recip() / self.lines.max(1) as f64
    }
}

/// The couch in the plane's axes.
pub(super) struct Sides {
    /// Direction to the head end.
    pub head: Vector2<f64>,
    /// Middle of the couch at its head end.
    pub middle: Vector2<f64>,
    pub edges: [Edge; 3],
    /// How far each edge appears inwards of where it is, px.
    pub blur: f64,
    /// Measured width without blur, m.
    pub width: f64,
    /// Angle of the head end from square, rad.
    pub off_square: f64,
}

/// Whether a step is across an edge with this outward direction.
fn is_across(crack: &Crack, out: &Vector2<f64>) -> bool {
    crack.step.dot(out) > 0.7 * crack.step.norm()
}

pub(super) fn sides(cracks: &[Crack], width: f64) -> Result<Sides, EdgeError> {
    let (angle, low, high, count) = searched(cracks, width);
    if count < LEAST {
        return Err(EdgeError::NoSides { width_mm: 1e3 * width, found: count, least: LEAST });
    }
    let mut across = Vector2::new(libm::cos(angle), libm::sin(angle));
    let along = |across: &Vector2<f64>| Vector2::new(-across.y, across.x);
    let near = |offset: f64, out: Vector2<f64>| -> Vec<Crack> {
        let is_near = |crack: &&Crack| (crack.at.dot(&out) - offset).abs() < NEAR && is_across(crack, &out);
        cracks.iter().filter(is_near).copied().collect()
    };
    let mut both = [near(high, across), near(-low, -across)];
    // The corners of the couch.
    let ends = |edge: &[Crack]| {
        let places = || edge.iter().map(|crack| crack.at.dot(&along(&across)));
        [places().fold(f64::INFINITY, f64::min) + CORNER, places().fold(f64::NEG_INFINITY, f64::max) - CORNER]
    };
    let spans = [ends(&both[0]), ends(&both[1])];
    for (edge, [least, most]) in both.iter_mut().zip(spans) {
        edge.retain(|crack| (least..most).contains(&crack.at.dot(&along(&across))));
    }
    let before = [both[0].len(), both[1].len()];
    let (mut blur, mut measured) = (0.0, 0.0);
    for step in 0..8 {
        let (turned, offsets) = fitted(&both, across, blur);
        across = turned;
        // Without blur first: the width then shows it.
        let pixels: f64 =
            [0, 1].map(|side| pixel(&both[side], if side == 0 { across } else { -across })).iter().sum();
        measured = offsets[0] + offsets[1] - blur * pixels;
        blur = (width - measured) / pixels;
        if step < 4 {
            for (side, edge) in both.iter_mut().enumerate() {
                let out = if side == 0 { across } else { -across };
                trim(edge, &out, offsets[side]);
            }
        }
    }
    if !(BLUR[0]..=BLUR[1]).contains(&blur) {
        return Err(EdgeError::Width { found_mm: 1e3 * measured, given_mm: 1e3 * width, most: BLUR[1] });
    }
    let (across, offsets) = fitted(&both, across, blur);
    let [left, right] =
        [(0, across), (1, -across)].map(|(side, out)| judged(&both[side], &out, offsets[side], blur));
    for (edge, before) in [left, right].into_iter().zip(before) {
        straight(edge, before, "a long edge")?;
    }
    let centre = 0.5 * (offsets[0] - offsets[1]);
    let end = end(cracks, across, centre, width, blur)?;
    Ok(Sides {
        head: end.head,
        middle: across * centre + end.head * end.offset,
        edges: [left, right, end.edge],
        blur,
        width: measured,
        off_square: end.off_square,
    })
}

/// The angle and the two offsets at which most places are, and how many are at the weaker one.
fn searched(cracks: &[Crack], width: f64) -> (f64, f64, f64, usize) {
    let most = cracks.iter().map(|crack| crack.at.norm()).fold(0.0, f64::max) + 2.0 * BIN;
    let bins = (2.0 * most / BIN).ceil() as usize + 3;
    let (apart, slack) = ((width / BIN).round() as usize, (NEAR / BIN) as usize);
    let mut best = (0.0, 0.0, 0.0, 0);
    for step in 0..(std::f64::consts::PI / ANGLE) as usize {
        let angle = step as f64 * ANGLE;
        let across = Vector2::new(libm::cos(angle), libm::sin(angle));
        let (mut outwards, mut inwards) = (vec![0_usize; bins], vec![0_usize; bins]);
        for crack in cracks {
            let bin = ((crack.at.dot(&across) + most) / BIN) as usize + 1;
            if is_across(crack, &across) {
                outwards[bin] += 1;
            } else if is_across(crack, &-across) {
                inwards[bin] += 1;
            }
        }
        let three = |counts: &[usize], bin: usize| counts[bin - 1] + counts[bin] + counts[bin + 1];
        for low in 1..bins - 1 {
            let weaker = three(&inwards, low);
            if weaker <= best.3 {
                continue;
            }
            for high in (low + apart).saturating_sub(slack)..=(low + apart + slack).min(bins - 2) {
                let count = weaker.min(three(&outwards, high));
                if count > best.3 {
                    let offset = |bin: usize| (bin as f64 - 0.5) * BIN - most;
                    best = (angle, offset(low), offset(high), count);
                }
            }
        }
    }
    best
}

/// The common direction across two edges and their offsets, each along its own outward direction, by least squares.
fn fitted(both: &[Vec<Crack>; 2], across: Vector2<f64>, blur: f64) -> (Vector2<f64>, [f64; 2]) {
    let along = Vector2::new(-across.y, across.x);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (side, edge) in both.iter().enumerate() {
        let sign = if side == 0 { 1.0 } else { -1.0 };
        for crack in edge {
            let at = crack.at + blur * crack.step;
            // sign * offset = across . at + turn * along . at
            let row = Vector3::new(f64::from(side == 0), f64::from(side == 1), -sign * along.dot(&at));
            normal += row * row.transpose();
            right += row * (sign * across.dot(&at));
        }
    }
    let Some(solved) = normal.try_inverse().map(|inverse| inverse * right) else { return (across, [0.0; 2]) };
    let turned = (across + solved.z * along).normalize();
    let length = libm::hypot(1.0, solved.z);
    (turned, [solved.x / length, solved.y / length])
}

/// The mean of one pixel across an edge, m.
fn pixel(edge: &[Crack], out: Vector2<f64>) -> f64 {
    edge.iter().map(|crack| crack.step.dot(&out)).sum::<f64>() / edge.len().max(1) as f64
}

/// Leaves out what is farther than three times the scatter.
fn trim(edge: &mut Vec<Crack>, out: &Vector2<f64>, offset: f64) {
    let off = |crack: &Crack| (crack.at.dot(out) - offset).abs();
    let mut offs: Vec<f64> = edge.iter().map(off).collect();
    offs.sort_by(f64::total_cmp);
    let typical = offs.get(offs.len() / 2).copied().unwrap_or(0.0) + pixel(edge, *out);
    edge.retain(|crack| off(crack) < 3.0 * typical);
}

fn judged(edge: &[Crack], out: &Vector2<f64>, offset: f64, blur: f64) -> Edge {
    let square = |crack: &Crack| {
        let off = ((crack.at + blur * crack.step).dot(out) - offset) / crack.step.dot(out);
        off * off
    };
    let count = edge.len().max(1) as f64;
    let lines = || edge.iter().map(|crack| crack.line);
    Edge {
        places: edge.len(),
        scatter: (edge.iter().map(square).sum::<f64>() / count).sqrt(),
        pixel: pixel(edge, *out),
        lines: lines().max().unwrap_or(0).abs_diff(lines().min().unwrap_or(0)) + 1,
    }
}

fn straight(edge: Edge, before: usize, name: &'static str) -> Result<(), EdgeError> {
    let share = edge.places as f64 / before.max(1) as f64;
    if share < ON_LINE {
        return Err(EdgeError::Steps { edge: name, share: 100.0 * share, least: 100.0 * ON_LINE });
    }
    // Written so that NaN is refused.
    if edge.scatter <= SCATTER {
        Ok(())
    } else {
        Err(EdgeError::Bent { edge: name, found: edge.scatter, most: SCATTER })
    }
}

/// The edge at the head end.
struct End {
    /// Direction to it.
    head: Vector2<f64>,
    edge: Edge,
    /// In this direction, where the middle of the couch is, m.
    offset: f64,
    /// Angle from square, rad.
    off_square: f64,
}

fn end(cracks: &[Crack], across: Vector2<f64>, centre: f64, width: f64, blur: f64) -> Result<End, EdgeError> {
    let along = Vector2::new(-across.y, across.x);
    let inside = 0.5 * width - CORNER;
    let of = |out: Vector2<f64>| -> Vec<Crack> {
        let is_end =
            |crack: &&Crack| (crack.at.dot(&across) - centre).abs() < inside && is_across(crack, &out);
        let all: Vec<Crack> = cracks.iter().filter(is_end).copied().collect();
        // Around the offset where most places are.
        let count = |at: f64| all.iter().filter(|crack| (crack.at.dot(&out) - at).abs() < 0.5 * NEAR).count();
        let fullest = all.iter().map(|crack| crack.at.dot(&out)).max_by_key(|at| count(*at)).unwrap_or(0.0);
        all.into_iter().filter(|crack| (crack.at.dot(&out) - fullest).abs() < NEAR).collect()
    };
    // Share of the pieces across the couch in which there are places.
    let share = |edge: &[Crack]| {
        let piece = |crack: &Crack| {
            ((crack.at.dot(&across) - centre + inside) / (2.0 * inside) * PIECES as f64) as usize
        };
        let mut is_seen = [false; PIECES];
        edge.iter().for_each(|crack| is_seen[piece(crack).min(PIECES - 1)] = true);
        is_seen.iter().filter(|seen| **seen).count() as f64 / PIECES as f64
    };
    let (first, second) = (of(along), of(-along));
    let (head, mut edge) = match (share(&first) >= SEEN, share(&second) >= SEEN) {
        (true, true) => return Err(EdgeError::TwoEnds),
        (true, false) => (along, first),
        (false, true) => (-along, second),
        (false, false) => {
            let share = share(&first).max(share(&second));
            return Err(EdgeError::NoEnd { share: 100.0 * share, least: 100.0 * SEEN });
        }
    };
    let before = edge.len();
    let (mut offset, mut slope) = (0.0, 0.0);
    for step in 0..5 {
        // offset + slope * across = head . at
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for crack in &edge {
            let at = crack.at + blur * crack.step;
            let row = Vector2::new(1.0, at.dot(&across) - centre);
            normal += row * row.transpose();
            right += row * at.dot(&head);
        }
        let Some(solved) = normal.try_inverse().map(|inverse| inverse * right) else { break };
        (offset, slope) = (solved.x, solved.y);
        if step < 4 {
            let expected = |crack: &Crack| offset + slope * (crack.at.dot(&across) - centre);
            let bound = 3.0 * pixel(&edge, head).max(1e-4);
            edge.retain(|crack| ((crack.at + blur * crack.step).dot(&head) - expected(crack)).abs() < bound);
        }
    }
    let turned = (head - slope * across).normalize();
    let origin = across * centre;
    let middle: Vec<Crack> = edge.iter().map(|crack| Crack { at: crack.at - origin, ..*crack }).collect();
    let edge = judged(&middle, &turned, (head * offset).dot(&turned), blur);
    let off_square = libm::atan(slope);
    straight(edge, before, "the edge at the head end")?;
    let off_deg = off_square.to_degrees();
    if off_deg.abs() > SQUARE_DEG {
        return Err(EdgeError::NotSquare { off_deg, most_deg: SQUARE_DEG });
    }
    Ok(End { head, edge, offset, off_square })
}
