//! The reference surface: what a camera saw of a head when the reference was captured, as patches.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::buckets::Buckets;
use crate::movable::Movable;
use crate::nearest::NearestTable;
use crate::patch::{Patch, Place, Sightline};

/// A reference longer than this is no head.
const EXTENT_MOST: f64 = 1.0;
/// How far around the surface partners are looked for, m.
const MARGIN: f64 = 0.03;
/// Points that a fit should have; where the cloud is thin, the radius grows until it has.
const POINTS_PER_FIT: f64 = 40.0;
/// A patch whose points scatter this many times more than those of most patches, and more than this part of the spacing,
/// bridges a gap: it is no surface.
const ROUGH: f64 = 3.0;
const ROUGH_LEAST: f64 = 0.25;
/// Patches seen more obliquely than this (cosine) are left out.
const COSINE_LEAST: f64 = 0.2;
/// Patches inside that a reference needs.
const PATCHES_LEAST: usize = 30;
/// Width over which residuals are taken to be correlated, in units of the spacing.
const GROUP_WIDTH: f64 = 3.0;

/// How a cloud becomes a surface, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceParams {
    /// Distance between patches.
    pub spacing: f64,
    /// Radius of the points that a patch is fitted to.
    pub smoothing: f64,
}

/// Why a cloud makes no reference.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SurfaceError {
    /// It has no points, or too few to hold a surface.
    #[error(
        "the cloud holds {found} pieces of surface, a reference needs {needed}: come closer, or raise `smoothing`"
    )]
    TooLittle {
        /// Patches found.
        found: usize,
        /// Patches needed.
        needed: usize,
    },
    /// It is larger than any head.
    #[error("the cloud is {extent:.2} m long, a head at most {most} m: narrow the segmentation")]
    TooLarge {
        /// Its longest side, m.
        extent: f64,
        /// The most, m.
        most: f64,
    },
}

/// A piece of the surface as the alignment reads it.
#[derive(Debug, Clone, Copy)]
pub struct Partner {
    /// How the point lies to it.
    pub sightline: Sightline,
    /// Whether the surface ends there.
    pub place: Place,
    /// Number of the patch.
    pub patch: usize,
    /// Number of the group of patches whose residuals are taken as one.
    pub group: usize,
    /// The point lies over the patch, not beside it.
    pub over: bool,
}

/// A reference surface. Its coordinates are the capture's, about [`centre`](Self::centre).
#[derive(Debug, Clone)]
pub struct Surface {
    patches: Vec<Patch>,
    groups: Vec<u32>,
    group_count: usize,
    firm_groups: usize,
    table: NearestTable,
    /// Largest squared distance from a patch at which it still represents the surface, m2.
    reach: f64,
    centre: Vector3<f64>,
    centroid: Vector3<f64>,
    length: f64,
    noise_sd: f64,
    slope_variance: f64,
    /// Mean of all points of the frame from which it was made, with the neck, m, in the capture's frame.
    whole: Vector3<f64>,
    skin: Skin,
}

/// What of a surface moves by itself.
#[derive(Debug, Clone, Default)]
struct Skin {
    /// Movement of each patch, m; empty where no table lies on the surface. Zero where no face is.
    movable: Vec<f64>,
    /// Whether each patch lies on the face of the table.
    on_face: Vec<bool>,
    /// Patches that move by less carry the pose, and those that move by less than the second count as seen, m.
    rigid: f64,
    firm: f64,
    /// Unit normal towards the neck, and how far along it the neck begins, m.
    neck: Option<(Vector3<f64>, f64)>,
}

/// Movements up to which patches are rigid, m: the first at which enough of them are.
const RIGID: [f64; 3] = [0.4e-3, 0.8e-3, 1.6e-3];
const RIGID_PATCHES: usize = 150;
/// Patches that move by less count as seen where they lie within the tolerance, m.
const FIRM: f64 = 0.9e-3;
/// Movement at which a patch has half its weight, m, at least.
const HALF: f64 = 0.3e-3;
/// Where the skin is the neck's, m.
const NECK: f64 = 4.5e-3;

impl Surface {
    /// Lays a table of movements on the surface.
    pub fn lay(&mut self, movable: &Movable) {
        let found: Vec<Option<f64>> = self.patches.iter().map(|p| movable.at(&p.position)).collect();
        let on_face = found.iter().map(Option::is_some).collect();
        let movements: Vec<f64> = found.into_iter().map(|m| m.unwrap_or(0.0)).collect();
        let count = |limit: f64| movements.iter().filter(|m| **m < limit).count();
        let rigid = RIGID.into_iter().find(|limit| count(*limit) >= RIGID_PATCHES).unwrap_or(f64::INFINITY);
        let firm = FIRM.max(rigid);
        let mut groups: Vec<u32> = self
            .patches
            .iter()
            .zip(&movements)
            .zip(&self.groups)
            .filter_map(|((_, m), g)| (*m < firm).then_some(*g))
            .collect();
        groups.sort_unstable();
        groups.dedup();
        self.firm_groups = groups.len();
        self.skin = Skin { movable: movements, on_face, rigid, firm, neck: Some(movable.neck()) };
    }

    /// Whether the surface is that of a face whose parts are known.
    #[must_use]
    pub fn has_face(&self) -> bool {
        !self.skin.movable.is_empty()
    }

    /// Whether a place, m, about the centre, is below the line from chin to occiput.
    #[inline]
    #[must_use]
    pub fn is_neck(&self, at: &Vector3<f64>) -> bool {
        self.skin.neck.is_some_and(|(normal, begins)| normal.dot(at) > begins)
    }

    /// Whether a patch lies on a face, and is no hand or cushion.
    #[must_use]
    pub fn is_on_face(&self, patch: usize) -> bool {
        self.skin.on_face.get(patch) == Some(&true)
    }

    #[inline]
    fn movement(&self, patch: usize) -> f64 {
        self.skin.movable.get(patch).copied().unwrap_or(0.0)
    }

    /// Weight of a patch in a fit, by how far it moves.
    #[inline]
    #[must_use]
    pub fn weight(&self, patch: usize) -> f64 {
        let part = self.movement(patch) / HALF.max(0.5 * self.noise_sd);
        1.0 / (1.0 + part * part)
    }

    /// Whether a patch follows the skull.
    #[inline]
    #[must_use]
    pub fn is_rigid(&self, patch: usize) -> bool {
        self.skin.movable.is_empty() || self.movement(patch) < self.skin.rigid
    }

    /// Whether a patch stays within the tolerance of where the skull is, whatever the face does.
    #[inline]
    #[must_use]
    pub fn is_firm(&self, patch: usize) -> bool {
        self.skin.movable.is_empty() || self.movement(patch) < self.skin.firm
    }

    /// Whether a patch is of the part of a face that moves, and not of its neck.
    #[inline]
    #[must_use]
    pub fn is_mimic(&self, patch: usize) -> bool {
        !self.is_rigid(patch) && self.movement(patch) < NECK
    }

    /// Number of groups with patches that are firm.
    #[must_use]
    pub fn firm_groups(&self) -> usize {
        self.firm_groups
    }

    /// Mean of all points of the frame from which it was made, with the neck, m, in the capture's frame.
    #[must_use]
    pub fn whole(&self) -> Vector3<f64> {
        self.whole
    }

    /// Notes the mean of all points of the frame of which this is a part.
    pub fn part_of(&mut self, whole: Vector3<f64>) {
        self.whole = whole;
    }

    /// The surface of a cloud of finite points (m), seen from the origin of its frame.
    ///
    /// # Errors
    /// A cloud that is too large for a head, or holds too little surface.
    pub fn new(cloud: &[Vector3<f64>], params: &SurfaceParams) -> Result<Self, SurfaceError> {
        let mut patches = fitted(cloud, params)?;
        drop_what_is_no_surface(&mut patches, ROUGH_LEAST * params.spacing);
        patches.retain(|p| -p.normal.dot(&p.position) / p.position.norm() >= COSINE_LEAST);
        Self::of(patches, cloud, params)
    }

    /// The surface of points (m) whose unit normals say which side is outside: one that is seen from anywhere.
    ///
    /// # Errors
    /// As of [`new`](Self::new).
    pub fn oriented(
        points: &[Vector3<f64>],
        normals: &[Vector3<f64>],
        params: &SurfaceParams,
    ) -> Result<Self, SurfaceError> {
        let mut patches = fitted(points, params)?;
        drop_what_is_no_surface(&mut patches, ROUGH_LEAST * params.spacing);
        // The sum of the normals around a patch.
        let table = NearestTable::new(
            &patches.iter().map(|p| p.position).collect::<Vec<_>>(),
            params.spacing,
            params.spacing,
        );
        let mut outward = vec![Vector3::zeros(); patches.len()];
        for (point, normal) in points.iter().zip(normals) {
            if let Some(patch) =
                table.as_ref().and_then(|t| t.nearest(point)).and_then(|p| outward.get_mut(p))
            {
                *patch += normal;
            }
        }
        let turned = patches.into_iter().zip(outward);
        let patches = turned.map(|(p, out)| if p.normal.dot(&out) < 0.0 { p.turned() } else { p }).collect();
        Self::of(patches, points, params)
    }

    fn of(
        mut patches: Vec<Patch>,
        cloud: &[Vector3<f64>],
        params: &SurfaceParams,
    ) -> Result<Self, SurfaceError> {
        let inside = patches.iter().filter(|p| p.place == Place::Inside).count();
        if inside < PATCHES_LEAST {
            return Err(SurfaceError::TooLittle { found: inside, needed: PATCHES_LEAST });
        }
        let too_little = SurfaceError::TooLittle { found: 0, needed: PATCHES_LEAST };
        let centroid = mean(cloud).ok_or(too_little.clone())?;
        let centre = nearest_to_normals(&patches, &centroid);
        for patch in &mut patches {
            patch.position -= centre;
        }
        let positions: Vec<_> = patches.iter().map(|p| p.position).collect();
        let table = NearestTable::new(&positions, MARGIN, 1.25 * params.spacing).ok_or(too_little)?;
        let n = patches.len() as f64;
        let length = (patches.iter().map(|p| p.position.norm_squared()).sum::<f64>() / n).sqrt();
        let noise_sd = median(patches.iter().map(|p| p.residual_sd));
        let slope_variance = median(patches.iter().map(|p| p.slope_variance));
        let (groups, group_count) = Buckets::new(&positions, GROUP_WIDTH * params.spacing).numbers();
        // Farther than one and a half spacings from the nearest patch there is none: the surface has ended.
        let reach = (1.5 * params.spacing) * (1.5 * params.spacing);
        Ok(Self {
            patches,
            groups,
            group_count,
            firm_groups: group_count,
            table,
            reach,
            centre,
            centroid,
            length,
            noise_sd,
            slope_variance,
            whole: centroid,
            skin: Skin::default(),
        })
    }

    /// What is nearest to a point (m, about the centre). `None` far from the surface.
    #[inline]
    #[must_use]
    pub fn partner(&self, point: &Vector3<f64>) -> Option<Partner> {
        let number = self.table.nearest(point)?;
        let patch = self.patches.get(number)?;
        let sightline = patch.sightline(point);
        let group = self.groups[number] as usize;
        let over = sightline.aside <= self.reach;
        Some(Partner { sightline, place: patch.place, patch: number, group, over })
    }

    /// Distance of the farthest patch from the centre, m.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.patches.iter().map(|p| p.position.norm()).fold(0.0, f64::max)
    }

    /// The patches, about the centre.
    #[must_use]
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// Number of the group that a patch is in.
    #[inline]
    #[must_use]
    pub fn group(&self, patch: usize) -> usize {
        self.groups.get(patch).map_or(0, |group| *group as usize)
    }

    /// Number of groups of patches.
    #[must_use]
    pub fn group_count(&self) -> usize {
        self.group_count
    }

    /// The point nearest to all normals, in the capture's frame, m: a sphere's centre; a head's lies inside it.
    #[must_use]
    pub fn centre(&self) -> Vector3<f64> {
        self.centre
    }

    /// Mean of the cloud's points, in the capture's frame, m.
    #[must_use]
    pub fn centroid(&self) -> Vector3<f64> {
        self.centroid
    }

    /// Root mean square distance of the surface from its centre, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Standard deviation of the cloud's points about most patches, m.
    #[must_use]
    pub fn noise_sd(&self) -> f64 {
        self.noise_sd
    }

    /// Variance of most normals that noise leaves, on each of their two axes, rad2. It makes a sphere seem to constrain its rotation.
    #[must_use]
    pub fn slope_variance(&self) -> f64 {
        self.slope_variance
    }
}

/// A patch for each cell of `spacing` metres that has points.
fn fitted(cloud: &[Vector3<f64>], params: &SurfaceParams) -> Result<Vec<Patch>, SurfaceError> {
    let first = cloud.first().copied().unwrap_or_default();
    let (least, greatest) = cloud.iter().fold((first, first), |(a, b), p| (a.inf(p), b.sup(p)));
    let extent = (greatest - least).max();
    let fits = extent <= EXTENT_MOST;
    if !fits {
        return Err(SurfaceError::TooLarge { extent, most: EXTENT_MOST });
    }
    let seeds = Buckets::new(cloud, params.spacing).means();
    let density = cloud.len() as f64 / (seeds.len().max(1) as f64 * params.spacing * params.spacing);
    let radius = params.smoothing.max((POINTS_PER_FIT / (core::f64::consts::PI * density)).sqrt());
    let neighbours = Buckets::new(cloud, radius);
    let mut near = Vec::new();
    let mut patches = Vec::with_capacity(seeds.len());
    for seed in &seeds {
        neighbours.within(seed, radius, &mut near);
        patches.extend(Patch::fit(seed, &near, radius));
    }
    Ok(patches)
}

/// Drops patches that bridge a gap.
fn drop_what_is_no_surface(patches: &mut Vec<Patch>, rough_least: f64) {
    let rough = rough_least.max(ROUGH * median(patches.iter().map(|p| p.residual_sd)));
    patches.retain(|p| p.residual_sd <= rough);
}

/// The middle value; zero of none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn mean(cloud: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let first = cloud.first()?;
    let sum: Vector3<f64> = cloud.iter().map(|p| p - first).sum();
    Some(first + sum / cloud.len() as f64)
}

/// The point c of least sum |(p - c) x n|^2: the one about which the surface constrains rotations least. Directions
/// that the normals leave open (a plane's, a cylinder's axis) are the centroid's.
fn nearest_to_normals(patches: &[Patch], centroid: &Vector3<f64>) -> Vector3<f64> {
    let n = patches.len() as f64;
    let (mut left, mut right) = (Matrix3::identity() * (2e-3 * n), Vector3::zeros());
    for patch in patches {
        let [slope_u, slope_v, ..] = patch.shape;
        let normal = (patch.normal - patch.first * slope_u - patch.second * slope_v).normalize();
        let across = Matrix3::identity() - normal * normal.transpose();
        left += across;
        right += across * (patch.position - centroid);
    }
    left.cholesky().map_or(*centroid, |c| centroid + c.solve(&right))
}
