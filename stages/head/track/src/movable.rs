//! How far each part of a face moves by itself: a fixed table, laid on a surface by the nose.
//!
//! The skin over brows, bridge of the nose, temples and ears follows the skull; mouth, cheeks and chin do not, and the
//! neck bends. The table is the mean of heads that are not the patient's; an error of 8 mm and 8 degrees in its place
//! hardly matters (`docs/science.md`, faces that move).

use libm::sqrt;
use nalgebra::{Isometry3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::patch::Place;
use crate::surface::Surface;

/// The table; `data/README.md` says where it comes from.
const TABLE: &str = include_str!("../data/movable.csv");
/// Above this movement a place of the table is the neck, mm. The mean of a place and its neighbours.
const NECK: f64 = 6.0;
/// The line from chin to occiput in the middle plane of the table: height along the crown at the chin, m from the nose,
/// and its growth per metre towards the back of the head.
const CHIN: [f64; 2] = [-0.066, -0.035];
const TO_OCCIPUT: f64 = 0.69;
/// Movements of the table within this distance count for a patch, m; what has none within the second lies on no face.
const NEAR: f64 = 0.012;
const OFF: f64 = 0.018;
/// A nose stands over the cheeks beside it, which are so far to its left or right, m, by at least this, m.
const CHEEKS: [f64; 2] = [0.018, 0.030];
const ASIDE: f64 = 0.008;
const STANDS: f64 = 0.009;
/// Places that are tried as the nose, and how far they are apart, m.
const TRIED: usize = 10;
const APART: f64 = 0.02;
/// Sizes that are tried, of that of the table.
const SIZES: [f64; 6] = [0.75, 0.85, 0.95, 1.05, 1.15, 1.25];
const ITERATIONS: usize = 8;
/// A place of the table within this distance of the surface lies on it, m; least number and least part of them.
const ON: f64 = 0.008;
const ON_LEAST: usize = 80;
const ON_PART: f64 = 0.75;
/// Part of the mean information that holds a direction.
const HOLD: f64 = 0.02;
/// A head on a couch is turned by less, rad.
const TURN_MOST: f64 = 0.6;

/// A place of the table, m, and its movement, m.
#[derive(Clone, Copy, Debug)]
struct Spot {
    at: Vector3<f64>,
    movement: f64,
}

fn table() -> Vec<Spot> {
    let number = |text: Option<&str>| text.and_then(|t| t.trim().parse::<f64>().ok());
    let row = |line: &str| {
        let mut fields = line.split(',');
        let mut next = || number(fields.next());
        let (x, y, z, millimetres) = (next()?, next()?, next()?, next()?);
        Some(Spot { at: Vector3::new(x, y, z), movement: 1e-3 * millimetres })
    };
    TABLE.lines().filter(|line| !line.starts_with('#')).filter_map(row).collect()
}

/// What is behind the neck's line of a place of the table, m; negative at the head.
#[cfg(test)]
fn beyond_neck(at: &Vector3<f64>) -> f64 {
    (CHIN[0] - TO_OCCIPUT * (at.z - CHIN[1])) - at.y
}

/// A table that lies on a surface.
#[derive(Clone, Debug)]
pub struct Movable {
    /// From the surface's coordinates into those of the table, at the size of the head.
    nose_from_surface: Isometry3<f64>,
    size: f64,
    spots: Vec<Spot>,
}

impl Movable {
    /// Lays the table on a surface; `couch_from_surface` turns its axes into those of the couch (x to the left of a
    /// patient who lies on the back, y to the crown, z up). `None` where there is no face.
    #[must_use]
    pub fn on(surface: &Surface, couch_from_surface: &UnitQuaternion<f64>) -> Option<Self> {
        let spots = table();
        let head: Vec<Vector3<f64>> =
            spots.iter().filter(|s| s.movement < 1e-3 * NECK && s.at.z > -0.14).map(|s| s.at).collect();
        let noses = noses(surface, couch_from_surface);
        let starts = noses.iter().flat_map(|nose| SIZES.map(|size| (nose, size)));
        let fits = starts.filter_map(|(nose, size)| {
            let turn = couch_from_surface.inverse();
            let start = Isometry3::from_parts(Translation3::from(*nose), turn);
            let fit = settled(surface, &head, size, start)?;
            let turned = (fit.surface_from_nose.rotation * couch_from_surface).angle();
            (turned < TURN_MOST).then_some((fit, size))
        });
        let (best, size) = fits.max_by(|(a, _), (b, _)| a.score.total_cmp(&b.score))?;
        let enough = best.on >= ON_LEAST && best.on as f64 >= ON_PART * best.over as f64;
        let nose_from_surface = best.surface_from_nose.inverse();
        enough.then_some(Self { nose_from_surface, size, spots })
    }

    /// The same on coordinates about another centre, which is so far from that of the first, m.
    #[must_use]
    pub fn about(mut self, shift: &Vector3<f64>) -> Self {
        self.nose_from_surface *= Translation3::from(*shift);
        self
    }

    fn in_table(&self, at: &Vector3<f64>) -> Vector3<f64> {
        (self.nose_from_surface * Point3::from(*at)).coords / self.size
    }

    /// Mean movement of the skin at a place of the surface along its normal, m. `None` where no face is: a hand, a cushion.
    #[must_use]
    pub fn at(&self, place: &Vector3<f64>) -> Option<f64> {
        let at = self.in_table(place);
        let (mut sum, mut weights) = (0.0, 0.0);
        let mut nearest = (f64::INFINITY, 0.0);
        for spot in &self.spots {
            let squared = (spot.at - at).norm_squared();
            if squared < nearest.0 {
                nearest = (squared, spot.movement);
            }
            if squared < NEAR * NEAR {
                let inside = 1.0 - squared / (NEAR * NEAR);
                sum += inside * inside * spot.movement;
                weights += inside * inside;
            }
        }
        if weights > 0.0 {
            return Some(sum / weights);
        }
        (nearest.0 < OFF * OFF).then_some(nearest.1)
    }

    /// The line from chin to occiput as a plane: its normal towards the neck, in the surface's axes, and how far along
    /// it the neck begins, m.
    #[must_use]
    pub fn neck(&self) -> (Vector3<f64>, f64) {
        let steep = Vector3::new(0.0, -1.0, -TO_OCCIPUT);
        let chin = Vector3::new(0.0, CHIN[0], CHIN[1]) * self.size;
        let surface_from_nose = self.nose_from_surface.inverse();
        let normal = surface_from_nose.rotation * (steep / steep.norm());
        (normal, normal.dot(&(surface_from_nose * Point3::from(chin)).coords))
    }
}

/// The places that may be the tip of the nose: they stand over what is left and right of them.
fn noses(surface: &Surface, couch_from_surface: &UnitQuaternion<f64>) -> Vec<Vector3<f64>> {
    let turn: Rotation3<f64> = couch_from_surface.to_rotation_matrix();
    let patches = surface.patches();
    let places: Vec<Vector3<f64>> = patches.iter().map(|p| turn * p.position).collect();
    let mut found: Vec<(f64, usize)> = Vec::new();
    for (number, place) in places.iter().enumerate() {
        let mut sides = [(0.0, 0.0); 2];
        for other in &places {
            let by = other - place;
            let aside = by.x.abs();
            if by.y.abs() < ASIDE && aside > CHEEKS[0] && aside < CHEEKS[1] && by.z.abs() < 0.08 {
                let side = &mut sides[usize::from(by.x > 0.0)];
                side.0 += by.z;
                side.1 += 1.0;
            }
        }
        let depths = sides.iter().filter(|(_, n)| *n > 2.0).map(|(sum, n)| -sum / n);
        let (sum, count) = depths.fold((0.0, 0.0), |(sum, count), depth| (sum + depth, count + 1.0));
        if count > 0.0 && sum / count > STANDS {
            found.push((sum / count, number));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut noses: Vec<usize> = Vec::new();
    for (_, number) in found {
        let is_apart = |other: &usize| (places[*other] - places[number]).norm() > APART;
        if noses.len() < TRIED && noses.iter().all(is_apart) {
            noses.push(number);
        }
    }
    noses.into_iter().map(|number| patches[number].position).collect()
}

struct Settled {
    surface_from_nose: Isometry3<f64>,
    score: f64,
    on: usize,
    over: usize,
}

/// Brings the places of a head of this size onto the surface.
fn settled(surface: &Surface, head: &[Vector3<f64>], size: f64, start: Isometry3<f64>) -> Option<Settled> {
    let length = surface.length();
    let mut pose = start;
    let mut last = None;
    for iteration in 0..=ITERATIONS {
        let (mut information, mut right) = (Matrix6::zeros(), Vector6::zeros());
        let (mut on, mut over, mut score) = (0, 0, 0.0);
        let reach = if iteration < 3 { 2.5 * ON } else { ON };
        for place in head {
            let at = (pose * Point3::from(place * size)).coords;
            let Some(partner) = surface.partner(&at) else { continue };
            if !partner.over || partner.place == Place::Edge {
                continue;
            }
            over += 1;
            let part = partner.sightline.distance / reach;
            let inside = 1.0 - part * part;
            if inside <= 0.0 {
                // A head that is too small has many places inside of the surface.
                score -= 1.0;
                continue;
            }
            on += usize::from(partner.sightline.distance.abs() < ON);
            score += inside;
            let normal = partner.sightline.normal;
            let turn = at.cross(&normal) / length;
            let row = Vector6::new(normal.x, normal.y, normal.z, turn.x, turn.y, turn.z);
            information += row * row.transpose() * inside;
            right -= row * (inside * partner.sightline.distance);
        }
        last = Some(Settled { surface_from_nose: pose, score, on, over });
        let hold = HOLD * information.trace() / 6.0;
        let held = information + Matrix6::from_diagonal_element(hold.max(f64::MIN_POSITIVE));
        let movement = held.cholesky()?.solve(&right);
        let turn = movement.fixed_rows::<3>(3) / length;
        let by = Isometry3::from_parts(
            Translation3::from(movement.fixed_rows::<3>(0).into_owned()),
            UnitQuaternion::from_scaled_axis(turn),
        );
        if sqrt(movement.norm_squared()) > 0.1 {
            return None;
        }
        pose = by * pose;
        pose.rotation.renormalize();
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_still_forehead_a_mouth_that_moves_and_a_neck() {
        let spots = table();
        assert_eq!(spots.len(), 787);
        let movable = Movable { nose_from_surface: Isometry3::identity(), size: 1.0, spots };
        let at = |x, y, z| movable.at(&Vector3::new(x, y, z));
        assert!(at(0.0, 0.09, -0.02).is_some_and(|m| m < 0.1e-3));
        assert!(at(0.0, -0.041, -0.011).is_some_and(|m| m > 1e-3));
        assert_eq!(at(0.0, -0.05, 0.03), None);
        assert!(beyond_neck(&Vector3::new(0.0, -0.1, -0.07)) > 0.0);
        assert!(beyond_neck(&Vector3::new(0.0, -0.05, -0.02)) < 0.0);
        let (normal, begins) = movable.neck();
        for place in [Vector3::new(0.02, -0.1, -0.07), Vector3::new(0.0, 0.0, -0.05)] {
            assert_eq!(normal.dot(&place) > begins, beyond_neck(&place) > 0.0);
        }
    }
}
