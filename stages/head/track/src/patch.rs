//! A small piece of a surface: a quadric fitted to the points around a place.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Points that a fit needs: twice its six unknowns.
const POINTS_LEAST: usize = 12;
/// Points farther than this many standard deviations from the first fit are left out of the second.
const OUTLIER: f64 = 2.5;
/// A place whose neighbours' mean lies farther off than this part of the radius is on an edge of the surface. (On the
/// edge of a half plane it is 4 / (3 pi) = 0.42 of it.)
const EDGE_OFFSET: f64 = 0.2;

/// Where a patch lies in its surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// There is surface all around.
    Inside,
    /// The surface ends within the radius of the fit.
    Edge,
}

/// h(u, v) = c0 u + c1 v + c2 u^2 + c3 u v + c4 v^2 over the plane through `position` with `normal`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// A point of the surface, m.
    pub position: Vector3<f64>,
    /// Unit normal of the plane that h is taken over, towards the viewpoint. (c0, c1) are the slopes over it.
    pub normal: Vector3<f64>,
    /// First axis of the plane, unit length.
    pub first: Vector3<f64>,
    /// Second axis: normal x first.
    pub second: Vector3<f64>,
    /// Coefficients of h: slopes without unit, curvatures in 1/m.
    pub shape: [f64; 5],
    /// Whether the surface ends here.
    pub place: Place,
    /// Standard deviation of the points about the fit, m.
    pub residual_sd: f64,
    /// Variance of the fitted slopes that the residuals leave, rad2.
    pub slope_variance: f64,
}

/// A point as a patch sees it.
#[derive(Debug, Clone, Copy)]
pub struct Sightline {
    /// Signed distance to the quadric along its normal, to first order, m.
    pub distance: f64,
    /// Unit normal of the quadric below the point.
    pub normal: Vector3<f64>,
    /// Squared distance from the patch's position along its plane, m2.
    pub aside: f64,
}

impl Patch {
    /// The same patch with its normal to the other side.
    #[must_use]
    pub fn turned(mut self) -> Self {
        let [a, b, c, e, f] = self.shape;
        (self.normal, self.second) = (-self.normal, -self.second);
        self.shape = [-a, b, -c, e, -f];
        self
    }

    /// How a point (m) lies to the quadric.
    #[inline]
    #[must_use]
    pub fn sightline(&self, point: &Vector3<f64>) -> Sightline {
        let d = point - self.position;
        let (u, v) = (d.dot(&self.first), d.dot(&self.second));
        let [a, b, c, e, f] = self.shape;
        let height = u * (a + c * u + e * v) + v * (b + f * v);
        let (slope_u, slope_v) = (a + 2.0 * c * u + e * v, b + e * u + 2.0 * f * v);
        let inverse = 1.0 / (1.0 + slope_u * slope_u + slope_v * slope_v).sqrt();
        Sightline {
            distance: (d.dot(&self.normal) - height) * inverse,
            normal: (self.normal - self.first * slope_u - self.second * slope_v) * inverse,
            aside: u * u + v * v,
        }
    }

    /// Fits a patch to the `points` within `radius` of `seed` (m), seen from the origin. `None` where they are too few
    /// or do not span a surface.
    #[must_use]
    pub fn fit(seed: &Vector3<f64>, points: &[Vector3<f64>], radius: f64) -> Option<Self> {
        if points.len() < POINTS_LEAST {
            return None;
        }
        let mean = points.iter().fold(Vector3::zeros(), |sum, p| sum + (p - seed)) / points.len() as f64;
        let (normal, first) = plane(seed, &mean, points)?;
        let second = normal.cross(&first);
        // Coordinates in units of the radius keep the equations' sizes alike.
        let local = |p: &Vector3<f64>| {
            let d = (p - seed) / radius;
            (d.dot(&first), d.dot(&second), d.dot(&normal))
        };
        let rough = quadric(points, local, f64::INFINITY, &SVector::zeros())?;
        let fine = quadric(points, local, OUTLIER * rough.sd, &rough.coefficients)?;
        let [offset, a, b, c, e, f]: [f64; 6] = fine.coefficients.into();
        let aside = mean.dot(&first).hypot(mean.dot(&second));
        Some(Self {
            position: seed + normal * (offset * radius),
            normal,
            first,
            second,
            shape: [a, b, c / radius, e / radius, f / radius],
            place: if aside > EDGE_OFFSET * radius { Place::Edge } else { Place::Inside },
            residual_sd: fine.sd * radius,
            slope_variance: fine.slope_variance,
        })
    }
}

/// Normal towards the origin and one axis of the plane of least squares.
fn plane(
    seed: &Vector3<f64>,
    mean: &Vector3<f64>,
    points: &[Vector3<f64>],
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let mut scatter = Matrix3::zeros();
    for point in points {
        let d = point - seed - mean;
        scatter += d * d.transpose();
    }
    let eigen = scatter.symmetric_eigen();
    let (least, most) = (eigen.eigenvalues.imin(), eigen.eigenvalues.imax());
    let middle = (0..3).find(|&i| i != least && i != most)?;
    // A thread of points has no plane.
    let spans = eigen.eigenvalues[middle] > 0.05 * eigen.eigenvalues[most];
    if !spans {
        return None;
    }
    let normal: Vector3<f64> = eigen.eigenvectors.column(least).normalize();
    let first: Vector3<f64> = eigen.eigenvectors.column(most).normalize();
    Some((if normal.dot(seed) > 0.0 { -normal } else { normal }, first))
}

struct Quadric {
    coefficients: SVector<f64, 6>,
    sd: f64,
    slope_variance: f64,
}

/// The quadric of least squares, points weighted by (1 - d^2)^2, those farther than `limit` from `before` left out.
fn quadric(
    points: &[Vector3<f64>],
    local: impl Fn(&Vector3<f64>) -> (f64, f64, f64),
    limit: f64,
    before: &SVector<f64, 6>,
) -> Option<Quadric> {
    let row = |u: f64, v: f64| SVector::<f64, 6>::from([1.0, u, v, u * u, u * v, v * v]);
    let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    let (mut heights, mut weights, mut used) = (0.0, 0.0, 0_usize);
    for point in points {
        let (u, v, h) = local(point);
        let x = row(u, v);
        let near = (1.0 - (u * u + v * v + h * h)).max(0.0);
        if near == 0.0 || (h - x.dot(before)).abs() > limit {
            continue;
        }
        let w = near * near;
        normal.syger(w, &x, &x, 1.0);
        right.axpy(w * h, &x, 1.0);
        heights += w * h * h;
        weights += w;
        used += 1;
    }
    if used < POINTS_LEAST {
        return None;
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let inverse = normal.cholesky()?.inverse();
    let coefficients = inverse * right;
    let share = used as f64 / (used as f64 - 6.0);
    let variance = ((heights - right.dot(&coefficients)) / weights).max(0.0) * share;
    // Weights lie between 0 and 1 with mean square over mean of 3/5: the variance of the slopes, about.
    let slope_variance = 0.5 * 0.6 * variance * (inverse[(1, 1)] + inverse[(2, 2)]);
    Some(Quadric { coefficients, sd: variance.sqrt(), slope_variance })
}
