//! The iterations of an alignment, and what is known of where they end.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

use super::equations::{Equations, Sums};
use super::misfit::spread;
use super::robust::Robust;
use crate::observability::Observability;
use crate::patch::Place;
use crate::surface::Surface;

/// Standard deviation of normal errors over the median of their absolute values.
const NORMAL_OVER_MEDIAN: f64 = 1.4826;
/// Distances below this are rounding of the clouds' 32-bit coordinates, m.
const ROUNDING: f64 = 1e-6;
/// Points seen at a smaller cosine are left out; below twice it they count less.
const COSINE_LEAST: f64 = 0.2;
const COSINE_FULL: f64 = 0.5;
/// Patches of a smaller weight do not tell the scale of the distances: a smile is no noise.
const OWN_LEAST: f64 = 0.3;
/// Rounding, m: a smaller step ends the iterations whatever the scale.
const STEP_LEAST: f64 = 1e-7;
/// Noise of the normals makes a sphere's turns seem constrained: their sensitivity is 2/3 of the normals' variance. What is
/// not three times that is refused.
const NOISE_MARGIN: f64 = 2.0;

/// How a cloud is aligned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlignParams {
    /// A point within this distance lies on the surface, m.
    pub tolerance: f64,
    /// Directions of a lower sensitivity are refused.
    pub least_sensitivity: f64,
}

impl AlignParams {
    /// What a direction must reach on this surface.
    fn least_sensitivity(&self, surface: &Surface) -> f64 {
        self.least_sensitivity.max(NOISE_MARGIN * surface.slope_variance())
    }
}

/// What the patches smooth away is no outlier, however good the camera is: noses and brows hold the turns.
fn least_scale(surface: &Surface) -> f64 {
    surface.noise_sd().max(ROUNDING)
}

/// How many points are used, and how often.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Points at most, spread evenly over the order of the cloud.
    pub points: usize,
    /// Iterations at most.
    pub iterations: u32,
    /// A step below this part of the distances' standard deviation ends them. A rotation counts by the movement that it
    /// makes.
    pub step: f64,
    /// Standard deviation of the distances to begin with, m.
    pub scale: f64,
    /// How distances are weighted.
    pub robust: Robust,
}

/// A cloud near its surface: where iterations ended, without what is known of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Into the surface's coordinates, about its centre.
    pub surface_from_cloud: Isometry3<f64>,
    /// Robust standard deviation of the distances, m, before the last step.
    pub sd: f64,
    /// Iterations done.
    pub iterations: u32,
}

/// A cloud on its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Into the surface's coordinates, about its centre.
    pub surface_from_cloud: Isometry3<f64>,
    /// What the surface constrains, in the surface's axes, about its centre.
    pub observability: Observability,
    /// Covariance of the movement (translation, rotation times length) about the centre, m2, in the surface's axes;
    /// zero in refused directions.
    pub covariance: Matrix6<f64>,
    /// Weighted root mean square of the distances, m.
    pub rms: f64,
    /// Robust standard deviation of the distances, m.
    pub sd: f64,
    /// Part of the points that lie on the surface within the tolerance, or part of the surface that they lie on: the
    /// smaller of the two.
    pub overlap: f64,
    /// Part of the surface that the points lie on.
    pub covered: f64,
    /// Iterations done.
    pub iterations: u32,
    /// Points used.
    pub points: usize,
}

/// Aligns clouds; after the first of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Aligner {
    distances: Vec<f64>,
    groups: Vec<Group>,
}

/// A group of patches: how its residuals pull, and whether a point lies on it.
#[derive(Debug, Clone, Copy)]
struct Group {
    pull: Vector6<f64>,
    hit: bool,
}

/// Whether a pass sums up the groups that the covariance needs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Groups {
    Summed,
    NotSummed,
}

impl Aligner {
    /// Brings `cloud` (m, finite, seen from the origin of its frame) nearer to the surface from a start.
    pub fn approach(
        &mut self,
        surface: &Surface,
        cloud: &[Vector3<f64>],
        start: &Isometry3<f64>,
        params: &AlignParams,
        effort: &Effort,
    ) -> Approach {
        let least = params.least_sensitivity(surface);
        let mut pose = *start;
        let mut scale = effort.scale.max(least_scale(surface));
        let mut iterations = 0;
        while iterations < effort.iterations {
            iterations += 1;
            let at = self.pass(surface, cloud, &pose, scale, params, effort, Groups::NotSummed);
            scale = self.scale().max(least_scale(surface));
            let seen = Observability::new(&at.information, at.weight, least);
            let movement = seen.solve(&at.right, at.weight);
            pose = moved(&pose, &movement, surface.length());
            let small = movement.norm() < STEP_LEAST.max(effort.step * scale);
            if small {
                break;
            }
        }
        Approach { surface_from_cloud: pose, sd: scale, iterations }
    }

    /// Aligns `cloud` (m, finite, seen from the origin of its frame) from a start.
    ///
    /// The result is where the iterations ended: whether it fits, `overlap` and the residuals say.
    pub fn align(
        &mut self,
        surface: &Surface,
        cloud: &[Vector3<f64>],
        start: &Isometry3<f64>,
        params: &AlignParams,
        effort: &Effort,
    ) -> Alignment {
        let Approach { surface_from_cloud, sd, iterations } =
            self.approach(surface, cloud, start, params, effort);
        let at = self.pass(surface, cloud, &surface_from_cloud, sd, params, effort, Groups::Summed);
        let observability = Observability::new(&at.information, at.weight, params.least_sensitivity(surface));
        let covariance = self.covariance(&observability, &at);
        let hit = self.groups.iter().filter(|g| g.hit).count();
        let covered = hit as f64 / surface.firm_groups().max(1) as f64;
        Alignment {
            surface_from_cloud,
            observability,
            covariance,
            rms: (at.squares / at.weight).sqrt(),
            sd: self.scale(),
            overlap: (at.close as f64 / at.used.max(1) as f64).min(covered),
            covered,
            iterations,
            points: at.used,
        }
    }

    /// One pass over the points: the equations at `pose`, and the distances for the next scale.
    #[allow(clippy::too_many_arguments)]
    fn pass(
        &mut self,
        surface: &Surface,
        cloud: &[Vector3<f64>],
        pose: &Isometry3<f64>,
        scale: f64,
        params: &AlignParams,
        effort: &Effort,
        groups: Groups,
    ) -> Equations {
        self.distances.clear();
        self.groups.clear();
        if groups == Groups::Summed {
            self.groups.resize(surface.group_count(), Group { pull: Vector6::zeros(), hit: false });
        }
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let inverse_length = 1.0 / surface.length();
        let mut sums = Sums::default();
        let (mut slopes, mut close, mut used) = (0.0, 0, 0);
        let is_last = effort.robust == Robust::Tukey;
        for point in spread(cloud, effort.points) {
            let at = rotation * point + pose.translation.vector;
            if surface.is_neck(&at) {
                continue;
            }
            let Some(partner) = surface.partner(&at) else {
                used += 1;
                continue;
            };
            let sightline = partner.sightline;
            let is_firm = surface.is_firm(partner.patch);
            used += usize::from(is_firm);
            if !partner.over {
                continue;
            }
            if is_firm && sightline.distance.abs() <= params.tolerance {
                close += 1;
                if let Some(group) = self.groups.get_mut(partner.group) {
                    group.hit = true;
                }
            }
            // The line of sight in the surface's axes.
            let cosine = -sightline.normal.dot(&(rotation * point)) / point.norm();
            if partner.place == Place::Edge || cosine < COSINE_LEAST {
                continue;
            }
            let own = if is_last { surface.weight(partner.patch) } else { 1.0 };
            if own >= OWN_LEAST {
                self.distances.push(sightline.distance.abs());
            }
            let (trust, slope) = effort.robust.weight(sightline.distance, scale, params.tolerance);
            if trust == 0.0 {
                continue;
            }
            let facing = (cosine / COSINE_FULL).min(1.0);
            let weight = facing * trust * own;
            let turn = at.cross(&sightline.normal) * inverse_length;
            let row = Vector6::new(
                sightline.normal.x,
                sightline.normal.y,
                sightline.normal.z,
                turn.x,
                turn.y,
                turn.z,
            );
            sums.add(&row, sightline.distance, weight);
            slopes += facing * own * slope;
            if let Some(group) = self.groups.get_mut(partner.group) {
                group.pull += row * (weight * sightline.distance);
            }
        }
        let weight = sums.weight.max(f64::MIN_POSITIVE);
        Equations {
            information: sums.information(),
            right: sums.right,
            weight,
            squares: sums.squares,
            slope: slopes / weight,
            close,
            used,
        }
    }

    /// Robust standard deviation of the distances of the last pass, m.
    fn scale(&mut self) -> f64 {
        let middle = self.distances.len() / 2;
        if self.distances.is_empty() {
            return f64::INFINITY;
        }
        let (_, median, _) = self.distances.select_nth_unstable_by(middle, f64::total_cmp);
        NORMAL_OVER_MEDIAN * *median
    }

    /// Covariance of the movement from how the residuals of whole groups of patches pull: neighbouring points err alike
    /// (sensors smooth, and so do the patches), so counting points would promise too much. Sandwich estimate of an
    /// M-estimator with clusters (Huber 1981; Liang and Zeger 1986).
    fn covariance(&self, observability: &Observability, at: &Equations) -> Matrix6<f64> {
        let mut pulls = Matrix6::zeros();
        let mut count = 0_usize;
        for pull in self.groups.iter().map(|g| g.pull).filter(|p| *p != Vector6::zeros()) {
            pulls += pull * pull.transpose();
            count += 1;
        }
        let freedom = count as f64 / (count as f64 - 6.0).max(1.0);
        // Few good points: the derivative may vanish, and the covariance must not.
        let slope = at.slope.max(0.1);
        let inverse = observability.inverse(at.weight) / slope;
        inverse * pulls * inverse * freedom
    }
}

/// A pose after a movement (translation, rotation times `length`) about the origin, m.
fn moved(pose: &Isometry3<f64>, movement: &Vector6<f64>, length: f64) -> Isometry3<f64> {
    let turn = Vector3::new(movement[3], movement[4], movement[5]) / length;
    let by = Isometry3::from_parts(
        Translation3::new(movement[0], movement[1], movement[2]),
        UnitQuaternion::from_scaled_axis(turn),
    );
    let mut pose = by * pose;
    pose.rotation.renormalize();
    pose
}
