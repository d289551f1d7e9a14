//! How parts of a surface agree on where the cloud is: each part alone, against all together.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};

use super::equations::Sums;
use super::mimic::REACH;
use super::misfit::spread;
use super::pieces::{Moves, Pieces};
use crate::patch::{Patch, Place};
use crate::surface::Surface;

/// Points seen at a smaller cosine are left out.
const COSINE_LEAST: f64 = 0.3;
/// Part of the mean information that holds a direction which a part does not constrain.
const HOLD: f64 = 1e-2;
/// Points that a part needs at least.
const POINTS_LEAST: u32 = 40;
/// Part of the information on size that must be left when the pose is free, else the size is not known.
const SIZE_KNOWN: f64 = 0.01;

/// The axes that cut a surface into four parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartAxes {
    middle: Vector3<f64>,
    axes: [Vector3<f64>; 2],
}

impl PartAxes {
    /// The two longest axes of what of a surface follows the skull, through its middle.
    #[must_use]
    pub fn of(surface: &Surface) -> Self {
        let patches = || surface.patches().iter().enumerate().filter(|(number, _)| surface.is_rigid(*number));
        let n = patches().count().max(1) as f64;
        let middle = patches().map(|(_, p)| p.position).sum::<Vector3<f64>>() / n;
        let spread = patches()
            .map(|(_, p)| p.position - middle)
            .fold(nalgebra::Matrix3::zeros(), |sum, d| sum + d * d.transpose());
        let eigen = spread.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let axis = |place: usize| eigen.eigenvectors.column(order[place]).into_owned();
        Self { middle, axes: [axis(0), axis(1)] }
    }

    fn part(&self, at: &Vector3<f64>) -> usize {
        let is_over = |axis: &Vector3<f64>| usize::from(axis.dot(&(at - self.middle)) > 0.0);
        is_over(&self.axes[0]) | is_over(&self.axes[1]) << 1
    }
}

/// How the parts of a surface agree at a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Root mean square, along the normals, of how far two halves of the surface would move against each other to fit
    /// best, m: the greater of two cuts. NaN where a half is not seen.
    pub apart: f64,
    /// The same of the cuts of which both halves are seen; NaN where there is none.
    pub apart_seen: f64,
    /// Least part of a quarter's points that lie on the surface.
    pub least_overlap: f64,
    /// Size of the cloud over that of the surface; NaN where the surface does not tell.
    pub scale: f64,
    /// Number of points on the surface for the solid angle under which its patches are seen. One camera keeps it for one
    /// surface at any distance, unless a part of the surface is gone. Infinite or not a number where no patch is seen.
    pub density: f64,
    /// How the pieces of the surface move; zeros without pieces.
    pub moves: Moves,
}

/// The sums of one quarter.
#[derive(Default)]
struct Quarter {
    sums: Sums,
    close: u32,
    used: u32,
}

/// The agreement of the parts of a `surface` on a cloud (m, finite, seen from the origin) at `surface_from_cloud`. A point
/// within `tolerance` lies on the surface; at most `points` are used. `pieces` are those of the surface, with the
/// standard deviation of the points along the normals, m, and the time of the frame, ns. Of a face only what follows the
/// skull is judged.
#[must_use]
pub fn agreement(
    surface: &Surface,
    axes: &PartAxes,
    mut pieces: Option<(&mut Pieces, f64, u64)>,
    cloud: &[Vector3<f64>],
    surface_from_cloud: &Isometry3<f64>,
    tolerance: f64,
    points: usize,
) -> Agreement {
    let rotation = surface_from_cloud.rotation.to_rotation_matrix().into_inner();
    let inverse_length = 1.0 / surface.length();
    if let Some((pieces, ..)) = &mut pieces {
        pieces.begin();
    }
    let mut hit = pieces.as_mut().map(|(pieces, ..)| std::mem::take(&mut pieces.hits)).unwrap_or_default();
    hit.clear();
    hit.resize(surface.group_count(), false);
    let mut quarters: [Quarter; 4] = Default::default();
    // Of the size: its own information, what it shares with the pose, and how the distances pull.
    let (mut own, mut shared, mut pull) = (0.0, Vector6::zeros(), 0.0);
    for point in spread(cloud, points) {
        let at = rotation * point + surface_from_cloud.translation.vector;
        if surface.is_neck(&at) {
            continue;
        }
        let Some(partner) = surface.partner(&at) else { continue };
        let sightline = partner.sightline;
        let cosine = -sightline.normal.dot(&(rotation * point)) / point.norm();
        if !partner.over || partner.place == Place::Edge || cosine < COSINE_LEAST {
            continue;
        }
        if !surface.is_rigid(partner.patch) {
            if surface.is_mimic(partner.patch)
                && sightline.distance.abs() < REACH
                && let Some((pieces, ..)) = &mut pieces
            {
                pieces.add_mimic(partner.patch, sightline.distance);
            }
            continue;
        }
        let quarter = &mut quarters[axes.part(&at)];
        quarter.used += 1;
        if sightline.distance.abs() > tolerance {
            continue;
        }
        quarter.close += 1;
        let turn = at.cross(&sightline.normal) * inverse_length;
        let row =
            Vector6::new(sightline.normal.x, sightline.normal.y, sightline.normal.z, turn.x, turn.y, turn.z);
        quarter.sums.add(&row, sightline.distance, 1.0);
        hit[partner.group] = true;
        if let Some((pieces, ..)) = &mut pieces {
            pieces.add(partner.patch, &row, sightline.distance);
        }
        let along = sightline.normal.dot(&at);
        own += along * along;
        shared += row * along;
        pull += along * sightline.distance;
    }
    let system = |parts: [usize; 2]| {
        let [a, b] = parts.map(|part| &quarters[part]);
        (a.sums.information() + b.sums.information(), a.sums.right + b.sums.right, a.close + b.close)
    };
    let cut = |one: [usize; 2], other: [usize; 2]| {
        let (one, other) = (system(one), system(other));
        if one.2 < POINTS_LEAST || other.2 < POINTS_LEAST {
            return f64::NAN;
        }
        let gained = |(information, right, _): &(Matrix6<f64>, Vector6<f64>, u32)| {
            solved(information, right).map(|x| right.dot(&x))
        };
        let both = (one.0 + other.0, one.1 + other.1, one.2 + other.2);
        let (Some(first), Some(second), Some(joint)) = (gained(&one), gained(&other), gained(&both)) else {
            return f64::NAN;
        };
        ((first + second - joint).max(0.0) / f64::from(both.2)).sqrt()
    };
    // Bit 0 of a quarter's number says on which side of the first axis it is, bit 1 of the second.
    let (first, second) = (cut([0, 2], [1, 3]), cut([0, 1], [2, 3]));
    let apart = if first.is_nan() || second.is_nan() { f64::NAN } else { first.max(second) };
    // The greater of two numbers is a number if one of them is.
    let apart_seen = first.max(second);
    let parts = quarters.iter().filter(|q| q.used >= POINTS_LEAST);
    let close = quarters.iter().map(|q| f64::from(q.close)).sum::<f64>();
    let density = close / cloud.len().min(points) as f64 * cloud.len() as f64
        / solid_angle(surface, surface_from_cloud, &hit);
    if let Some((pieces, ..)) = &mut pieces {
        pieces.hits = hit;
    }
    let least_overlap = parts.map(|q| f64::from(q.close) / f64::from(q.used)).fold(1.0, f64::min);
    let moves = pieces.map_or(Moves::default(), |(pieces, noise, time)| {
        pieces.end(noise, time, surface, surface_from_cloud)
    });
    let information = quarters.iter().map(|q| q.sums.information()).sum::<Matrix6<f64>>();
    let right = quarters.iter().map(|q| q.sums.right).sum::<Vector6<f64>>();
    Agreement {
        apart,
        apart_seen,
        least_overlap,
        scale: scale(&information, &right, own, &shared, pull),
        density,
        moves,
    }
}

/// The solid angle under which the inside of a surface is seen from the origin of the cloud, over the area of a patch, sr/m2:
/// where a table of movements lies on it, of the patches that follow the skull, in groups that were `hit`. An arm hides whole groups, the holes of a mask do not.
fn solid_angle(surface: &Surface, surface_from_cloud: &Isometry3<f64>, hit: &[bool]) -> f64 {
    let of = |patch: &Patch| {
        let sightline = patch.position - surface_from_cloud.translation.vector;
        let cosine = -patch.normal.dot(&sightline) / sightline.norm();
        if cosine < COSINE_LEAST { 0.0 } else { cosine / sightline.norm_squared() }
    };
    let patches = surface.patches().iter().enumerate();
    let is_judged = |number: &usize| {
        !surface.has_face() || (surface.is_rigid(*number) && hit.get(surface.group(*number)) == Some(&true))
    };
    patches
        .filter(|(number, patch)| patch.place == Place::Inside && is_judged(number))
        .map(|(_, patch)| of(patch))
        .sum()
}

/// The size, with the pose free: the seventh unknown of the normal equations.
fn scale(
    information: &Matrix6<f64>,
    right: &Vector6<f64>,
    own: f64,
    shared: &Vector6<f64>,
    pull: f64,
) -> f64 {
    let (Some(x), Some(y)) = (solved(information, shared), solved(information, right)) else {
        return f64::NAN;
    };
    let left = own - shared.dot(&x);
    if left.is_nan() || left < SIZE_KNOWN * own {
        return f64::NAN;
    }
    // To undo the distances the cloud has to grow by this part.
    let grow = (-pull - shared.dot(&y)) / left;
    1.0 - grow
}

/// The movement that undoes the distances; directions that are not constrained are held.
fn solved(information: &Matrix6<f64>, right: &Vector6<f64>) -> Option<Vector6<f64>> {
    let hold = HOLD * information.trace() / 6.0;
    let held = information + Matrix6::from_diagonal_element(hold.max(f64::MIN_POSITIVE));
    held.cholesky().map(|c| c.solve(right))
}
