//! Where a known surface is in a frame, from anywhere near the planned place, or why what is seen is not this patient.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::model::Model;
use crate::align::{AlignParams, Aligner, Effort, PartAxes, Robust, agreement, misfit};
use crate::patch::Place;
use crate::surface::{Surface, SurfaceError, SurfaceParams};

/// Turns about each axis that are tried, degrees, and the largest of the turns that they make together.
const TURNS: [f64; 7] = [-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0];
const TURN_MOST: f64 = 52.0;
/// How far the middle of what is seen may be shifted towards the feet (against y) by a neck that the model has not, m.
const NECKS: [f64; 3] = [0.0, 0.025, 0.05];
/// Points by which starts are compared, and the distance that counts as far, m.
const POINTS: usize = 250;
const CAP: f64 = 0.02;
/// Starts that are followed, and ends of them that are followed to the end.
const FOLLOWED: usize = 24;
const FINISHED: usize = 4;
/// A first step takes points as far as twice this for the surface's, m.
const WIDE: f64 = 0.015;
const ROUGH: Effort = Effort { points: 600, iterations: 30, step: 0.05, scale: 0.01, robust: Robust::Huber };
const NEARER: Effort =
    Effort { points: 2000, iterations: 30, step: 0.03, scale: 0.003, robust: Robust::Huber };
const FINE: Effort = Effort { points: 6000, iterations: 20, step: 0.03, scale: 0.0, robust: Robust::Tukey };
/// Points by which a fit is judged.
const JUDGED: usize = 4000;
/// Points seen at a smaller cosine are not judged.
const COSINE: f64 = 0.3;
/// How far from the planned place a fit may be, m; its rotation may be as large as the turns that are tried.
const SHIFT_MOST: f64 = 0.2;

/// What a patient must reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// A point within this distance lies on the surface, m.
    pub tolerance: f64,
    /// Least part of the points that must lie on it.
    pub least_near: f64,
    /// Largest root mean square distance of the points from it, m, beside the camera's noise.
    pub most_rms: f64,
    /// Largest relative deviation of the size.
    pub most_scale: f64,
    /// Least part of the surface which the camera should see that must have points.
    pub least_covered: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 5e-3, least_near: 0.8, most_rms: 0.8e-3, most_scale: 0.03, least_covered: 0.4 }
    }
}

/// How what is seen lies on the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Part of the points that lie on it.
    pub near: f64,
    /// Root mean square distance of these points, m.
    pub rms: f64,
    /// The same without the camera's noise, m.
    pub misfit: f64,
    /// Size of what is seen over that of the surface; NaN where it does not tell.
    pub scale: f64,
    /// Part of the surface which the camera should see that has points.
    pub covered: f64,
}

/// Why what is seen is not this patient.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Foreign {
    /// Too much lies elsewhere.
    #[error("{:.0} % of what is seen matches the surface (required: {:.0} %)", 100.0 * fit.near, 100.0 * needed)]
    Elsewhere {
        /// The best fit that was found.
        fit: Fit,
        /// Part needed.
        needed: f64,
    },
    /// The shape is another.
    #[error("what is seen differs from the surface by {:.2} mm RMS, at most {:.2} mm are this patient's", 1e3 * fit.misfit, 1e3 * most)]
    Shape {
        /// The best fit that was found.
        fit: Fit,
        /// The most, m.
        most: f64,
    },
    /// The size is another.
    #[error("what is seen has {:.1} % of the size of the surface", 100.0 * fit.scale)]
    Size {
        /// The best fit that was found.
        fit: Fit,
    },
    /// Too little of it is seen.
    #[error("{:.0} % of the surface that the camera should see have points, it takes {:.0} %", 100.0 * fit.covered, 100.0 * needed)]
    Hidden {
        /// The best fit that was found.
        fit: Fit,
        /// Part needed.
        needed: f64,
    },
    /// It is too far from the planned place.
    #[error("the surface fits {:.0} mm and {:.0} degrees from the planned place", 1e3 * shift, turn.to_degrees())]
    Far {
        /// The fit.
        fit: Fit,
        /// How far, m.
        shift: f64,
        /// How far turned, rad.
        turn: f64,
    },
    /// Nothing of it can be seen.
    #[error("the camera sees nothing of the surface")]
    Unseen,
}

impl Foreign {
    /// The best fit, if there is one.
    #[must_use]
    pub fn fit(&self) -> Option<&Fit> {
        match self {
            Self::Elsewhere { fit, .. }
            | Self::Shape { fit, .. }
            | Self::Size { fit }
            | Self::Hidden { fit, .. }
            | Self::Far { fit, .. } => Some(fit),
            Self::Unseen => None,
        }
    }
}

/// A patient that was found.
#[derive(Debug, Clone)]
pub struct Registered {
    /// Where the model is in the frame of the points.
    pub camera_from_model: Isometry3<f64>,
    /// What the camera sees of the model there, in the frame of the points, m.
    pub seen: Vec<Vector3<f64>>,
    /// How the points fit.
    pub fit: Fit,
}

/// A known surface and where it is planned to be.
#[derive(Debug, Clone)]
pub struct Planned {
    model: Model,
    /// Corners of the box in which the model was cut out, in its frame, m.
    region: [[f64; 3]; 2],
    params: SurfaceParams,
    limits: Limits,
    /// Where the model should be.
    camera_from_model: Isometry3<f64>,
}

impl Planned {
    /// A surface of points with normals (m), cut out within the corners of `region`. `camera_from_model` brings it to where
    /// the plan has it in the frame of the camera.
    ///
    /// # Errors
    /// Points that make no surface.
    pub fn new(
        points: &[(Vector3<f64>, Vector3<f64>)],
        region: [[f64; 3]; 2],
        camera_from_model: Isometry3<f64>,
        params: SurfaceParams,
        limits: Limits,
    ) -> Result<Self, SurfaceError> {
        Ok(Self { model: Model::new(points, &params)?, region, params, limits, camera_from_model })
    }

    /// Looks for the patient in points (m, finite, seen from the origin).
    ///
    /// # Errors
    /// Why what is seen is not this patient.
    pub fn register(&self, cloud: &[Vector3<f64>]) -> Result<Registered, Foreign> {
        let aligner = &mut Aligner::default();
        let surface = self.model.surface();
        let params = AlignParams { tolerance: self.limits.tolerance, least_sensitivity: 1e-4 };
        let wide = AlignParams { tolerance: WIDE, ..params };
        let cost = |pose: &Isometry3<f64>, cap: f64, points: usize| misfit(surface, cloud, pose, cap, points);
        let best = |mut poses: Vec<(f64, Isometry3<f64>)>, many: usize| {
            poses.sort_by(|a, b| a.0.total_cmp(&b.0));
            poses.truncate(many);
            poses
        };
        let starts = self.starts(cloud).map(|start| (cost(&start, CAP, POINTS), start)).collect();
        let followed = best(starts, FOLLOWED).into_iter().map(|(_, start)| {
            let end = aligner.approach(surface, cloud, &start, &wide, &ROUGH).surface_from_cloud;
            (cost(&end, 2.0 * params.tolerance, 4 * POINTS), end)
        });
        let followed = best(followed.collect(), FINISHED).into_iter().map(|(_, start)| {
            let near = aligner.approach(surface, cloud, &start, &params, &NEARER);
            let effort = Effort { scale: near.sd, ..FINE };
            let end = aligner
                .approach(surface, cloud, &near.surface_from_cloud, &params, &effort)
                .surface_from_cloud;
            (cost(&end, 2.0 * params.tolerance, JUDGED), end)
        });
        let (_, surface_from_cloud) = best(followed.collect(), 1).pop().ok_or(Foreign::Unseen)?;
        let model_from_cloud = Translation3::from(surface.centre()) * surface_from_cloud;
        self.judged(aligner, cloud, &model_from_cloud.inverse())
    }

    /// Starts around the planned place: turned, with the middle of what is seen on the middle of what should be seen.
    fn starts(&self, cloud: &[Vector3<f64>]) -> impl Iterator<Item = Isometry3<f64>> {
        let middle = cloud.iter().sum::<Vector3<f64>>() / cloud.len().max(1) as f64;
        let back = -middle.try_normalize(1e-9).unwrap_or(Vector3::z());
        let planned = self.camera_from_model.rotation.inverse();
        let angles = || TURNS.into_iter().map(f64::to_radians);
        let turns = angles().flat_map(move |x| {
            angles().flat_map(move |y| angles().map(move |z| UnitQuaternion::from_euler_angles(x, y, z)))
        });
        let centre = self.model.surface().centre();
        turns.filter(|turn| turn.angle().to_degrees() <= TURN_MOST).flat_map(move |turn| {
            let rotation = turn * planned;
            let to = self.model.middle_seen_from(&(rotation * back));
            let onto = to - centre - rotation * middle;
            NECKS.map(|neck| Isometry3::from_parts(Translation3::from(onto - Vector3::y() * neck), rotation))
        })
    }

    fn judged(
        &self,
        aligner: &mut Aligner,
        cloud: &[Vector3<f64>],
        camera_from_model: &Isometry3<f64>,
    ) -> Result<Registered, Foreign> {
        let limits = self.limits;
        let params = AlignParams { tolerance: limits.tolerance, least_sensitivity: 1e-4 };
        let seen = self.model.seen(camera_from_model);
        let reference = Surface::new(&seen, &self.params).map_err(|_| Foreign::Unseen)?;
        let start = Isometry3::from(-reference.centre());
        let near = aligner.approach(&reference, cloud, &start, &params, &NEARER);
        let effort = Effort { scale: near.sd, ..FINE };
        let aligned = aligner.align(&reference, cloud, &near.surface_from_cloud, &params, &effort);
        // The model is where the points lie on what is seen of it.
        let moved = (Translation3::from(reference.centre()) * aligned.surface_from_cloud).inverse();
        let camera_from_model = moved * camera_from_model;
        let fit = self.fit(
            &reference,
            cloud,
            &aligned.surface_from_cloud,
            &camera_from_model.inverse(),
            aligned.covered,
        );
        let planned = self.camera_from_model.inverse() * camera_from_model;
        let origin = (self.camera_from_model.inverse() * camera_from_model * Point3::origin()).coords;
        let (shift, turn) = (origin.norm(), planned.rotation.angle());
        if fit.near.is_nan() || fit.near < limits.least_near {
            return Err(Foreign::Elsewhere { fit, needed: limits.least_near });
        }
        if fit.covered < limits.least_covered {
            return Err(Foreign::Hidden { fit, needed: limits.least_covered });
        }
        if fit.misfit.is_nan() || fit.misfit > limits.most_rms {
            return Err(Foreign::Shape { fit, most: limits.most_rms });
        }
        if (fit.scale - 1.0).abs() > limits.most_scale {
            return Err(Foreign::Size { fit });
        }
        if shift > SHIFT_MOST || turn.to_degrees() > TURN_MOST {
            return Err(Foreign::Far { fit, shift, turn });
        }
        let seen = seen.iter().map(|p| (moved * Point3::from(*p)).coords).collect();
        Ok(Registered { camera_from_model, seen, fit })
    }

    fn fit(
        &self,
        surface: &Surface,
        cloud: &[Vector3<f64>],
        pose: &Isometry3<f64>,
        model_from_cloud: &Isometry3<f64>,
        covered: f64,
    ) -> Fit {
        let [least, greatest] = self.region;
        // Where the model was cut off, nothing can be said: the neck goes on.
        let is_within = |point: &Vector3<f64>| {
            let at = model_from_cloud * Point3::from(*point);
            (0..3).all(|i| (least[i]..=greatest[i]).contains(&at[i]))
        };
        let tolerance = self.limits.tolerance;
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let mut groups = vec![(0.0, 0.0_f64, 0.0_f64); surface.group_count()];
        let (mut used, mut near) = (0.0, 0.0);
        let count = cloud.len().min(JUDGED);
        for point in (0..count).map(|k| &cloud[k * cloud.len() / count]) {
            if !is_within(point) {
                continue;
            }
            let at = rotation * point + pose.translation.vector;
            let partner = surface.partner(&at);
            used += 1.0;
            let Some(partner) = partner else { continue };
            // Beyond the edge of what is seen of the model nothing can be said.
            let cosine = -partner.sightline.normal.dot(&(rotation * point)) / point.norm();
            if !partner.over && partner.place == Place::Edge || cosine < COSINE {
                used -= 1.0;
                continue;
            }
            let distance = partner.sightline.distance;
            if !partner.over || distance.abs() > 2.0 * tolerance {
                continue;
            }
            near += f64::from(u8::from(distance.abs() <= tolerance));
            if partner.place == Place::Inside {
                let group = &mut groups[partner.group];
                (group.0, group.1, group.2) =
                    (group.0 + 1.0, group.1 + distance, group.2 + distance * distance);
            }
        }
        let all = groups.iter().fold([0.0; 2], |[n, squares], g| [n + g.0, squares + g.2]);
        // The mean distance of a patch of surface is its misfit: the camera's noise is what varies about it.
        let (mut squares, mut weight) = (0.0, 0.0);
        for (n, sum, square) in groups.iter().filter(|g| g.0 >= 8.0) {
            let mean = sum / n;
            let variance = ((square / n - mean * mean) / (n - 1.0)).max(0.0);
            squares += (mean * mean - variance).max(0.0);
            weight += 1.0;
        }
        let axes = PartAxes::of(surface);
        let scale = agreement(surface, &axes, None, cloud, pose, tolerance, JUDGED).scale;
        Fit {
            near: near / f64::max(used, 1.0),
            rms: (all[1] / f64::max(all[0], 1.0)).sqrt(),
            misfit: (squares / weight).sqrt(),
            scale,
            covered,
        }
    }
}
