//! Surfaces by two coordinates (3.16)-(3.18), (3.23)-(3.25), SCIENCE B4, B5.
//!
//! Charts are orthogonal; `(x, y, n)` is right-handed and `n` points outward. `alpha = (u, v)`.
//!
//! The contact equations use it, with which the tests of the plants compare their contacts.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Rotation3, Vector2, Vector3};

/// A contact leaves its chart for another before `|u|` exceeds this: at pi/2 is a pole.
pub const POLE: f64 = 1.2;

/// A surface, centred on its body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Surface {
    /// `z = 0`, outward along z; the chart's coordinates are x and y.
    Plane,
    /// A ball of this radius, m.
    Sphere { radius: f64 },
    /// An ellipsoid of revolution about z. It has one chart, which does not reach its poles.
    Spheroid {
        /// Semi-axis across z, m.
        equatorial: f64,
        /// Semi-axis along z, m.
        polar: f64,
    },
}

/// Where the poles of a sphere's chart are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Poles {
    /// On z, as (3.23) has them.
    #[default]
    AlongZ,
    AlongX,
}

/// A point of a surface by its coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChartPoint {
    /// `(u, v)`: rad, or m on a plane.
    pub alpha: Vector2<f64>,
    /// Which chart they belong to.
    pub poles: Poles,
}

/// What a contact needs of a surface at a point, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Local {
    /// The point, m.
    pub point: Vector3<f64>,
    /// `E = [x y]`: the chart's directions.
    pub tangents: Matrix3x2<f64>,
    /// `n`.
    pub normal: Vector3<f64>,
    /// Diagonal of `M`: length per coordinate.
    pub metric: Vector2<f64>,
    /// `K`, 1/m.
    pub curvature: Matrix2<f64>,
    /// `T`, 1/m.
    pub torsion: Vector2<f64>,
}

impl Poles {
    /// Turns the axes in which (3.23) is written into the body's.
    fn turn(self) -> Rotation3<f64> {
        match self {
            Self::AlongZ => Rotation3::identity(),
            // x to y, y to z, z to x.
            Self::AlongX => Rotation3::from_matrix_unchecked(Matrix3::new(
                0.0, 0.0, 1.0, //
                1.0, 0.0, 0.0, //
                0.0, 1.0, 0.0,
            )),
        }
    }
}

impl ChartPoint {
    /// In the chart with poles on z.
    pub fn new(u: f64, v: f64) -> Self {
        Self { alpha: Vector2::new(u, v), poles: Poles::AlongZ }
    }
}

impl Surface {
    /// The surface at a point. Not finite at a pole.
    pub fn at(&self, at: &ChartPoint) -> Local {
        let (u, v) = (at.alpha.x, at.alpha.y);
        match *self {
            Self::Plane => Local {
                point: Vector3::new(u, v, 0.0),
                tangents: Matrix3x2::identity(),
                normal: Vector3::z(),
                metric: Vector2::repeat(1.0),
                curvature: Matrix2::zeros(),
                torsion: Vector2::zeros(),
            },
            Self::Sphere { radius } => round(radius, radius, u, v, at.poles.turn()),
            Self::Spheroid { equatorial, polar } => round(equatorial, polar, u, v, Rotation3::identity()),
        }
    }

    /// Whether a point is so near a pole of its chart that it has to leave it.
    pub fn is_near_pole(&self, at: &ChartPoint) -> bool {
        matches!(self, Self::Sphere { .. }) && at.alpha.x.abs() > POLE
    }

    /// The same point of a sphere in its other chart, and the angle by which the chart's x turns about the outward
    /// normal: it adds to a contact's psi. Other surfaces have no other chart.
    pub fn switched(&self, at: &ChartPoint) -> Option<(ChartPoint, f64)> {
        let Self::Sphere { radius } = *self else { return None };
        let before = self.at(at);
        let poles = match at.poles {
            Poles::AlongZ => Poles::AlongX,
            Poles::AlongX => Poles::AlongZ,
        };
        let p = poles.turn().inverse() * before.point / radius;
        let alpha = Vector2::new(libm::asin(p.z.clamp(-1.0, 1.0)), libm::atan2(-p.y, p.x));
        let after = ChartPoint { alpha, poles };
        let x = self.at(&after).tangents.column(0).into_owned();
        let turned = libm::atan2(before.tangents.column(1).dot(&x), before.tangents.column(0).dot(&x));
        Some((after, turned))
    }
}

/// A spheroid at (u, v); a sphere where both semi-axes are one.
fn round(equatorial: f64, polar: f64, u: f64, v: f64, turn: Rotation3<f64>) -> Local {
    let (su, cu, sv, cv) = (libm::sin(u), libm::cos(u), libm::sin(v), libm::cos(v));
    let (a, b) = (equatorial, polar);
    let along = libm::sqrt(a * a * su * su + b * b * cu * cu);
    let x = Vector3::new(-a * su * cv, a * su * sv, b * cu) / along;
    let y = Vector3::new(-sv, -cv, 0.0);
    Local {
        point: turn * Vector3::new(a * cu * cv, -a * cu * sv, b * su),
        tangents: Matrix3x2::from_columns(&[turn * x, turn * y]),
        normal: turn * (Vector3::new(b * cu * cv, -b * cu * sv, a * su) / along),
        metric: Vector2::new(along, a * cu),
        curvature: Matrix2::from_diagonal(&Vector2::new(a * b / (along * along * along), b / (a * along))),
        torsion: Vector2::new(0.0, -su / (along * cu)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn surface() -> impl Strategy<Value = Surface> {
        prop_oneof![
            Just(Surface::Plane),
            (0.02..0.3f64).prop_map(|radius| Surface::Sphere { radius }),
            (0.02..0.3f64, 0.02..0.3f64)
                .prop_map(|(equatorial, polar)| Surface::Spheroid { equatorial, polar }),
        ]
    }

    fn poles() -> impl Strategy<Value = Poles> {
        prop_oneof![Just(Poles::AlongZ), Just(Poles::AlongX)]
    }

    proptest! {
        /// The definitions (3.16)-(3.18) by finite differences.
        #[test]
        fn metric_curvature_and_torsion_are_those_of_the_surface(
            surface in surface(),
            poles in poles(),
            u in -1.1..1.1f64,
            v in -3.0..3.0f64,
        ) {
            let here = surface.at(&ChartPoint { alpha: Vector2::new(u, v), poles });
            let h = 1e-6;
            for axis in 0..2 {
                let mut step = Vector2::zeros();
                step[axis] = h;
                let near = |sign: f64| surface.at(&ChartPoint { alpha: Vector2::new(u, v) + step * sign, poles });
                let (more, less) = (near(1.0), near(-1.0));
                let along = (more.point - less.point) / (2.0 * h);
                prop_assert!((along - here.tangents.column(axis) * here.metric[axis]).amax() < 1e-7);
                let bend = (more.normal - less.normal) / (2.0 * h * here.metric[axis]);
                let expected = here.tangents * here.curvature.column(axis);
                prop_assert!((bend - expected).amax() < 1e-5, "{} {}", bend, expected);
                let twist = (more.tangents.column(0) - less.tangents.column(0)) / (2.0 * h * here.metric[axis]);
                let found = here.tangents.column(1).dot(&twist);
                prop_assert!((found - here.torsion[axis]).abs() < 1e-5, "{} {}", found, here.torsion[axis]);
            }
            let across = here.tangents.column(0).cross(&here.tangents.column(1));
            prop_assert!((across - here.normal).amax() < 1e-12);
        }

        #[test]
        fn another_chart_shows_the_same_point_turned(poles in poles(), u in 1.2..1.5f64, v in -3.0..3.0f64) {
            let sphere = Surface::Sphere { radius: 0.05 };
            let before = ChartPoint { alpha: Vector2::new(u, v), poles };
            let (after, turned) = sphere.switched(&before).unwrap();
            let (one, other) = (sphere.at(&before), sphere.at(&after));
            prop_assert!((one.point - other.point).amax() < 1e-12);
            let (s, c) = turned.sin_cos();
            let expected = one.tangents * Matrix2::new(c, -s, s, c);
            prop_assert!((other.tangents - expected).amax() < 1e-7, "{} {}", other.tangents, expected);
            prop_assert!(sphere.is_near_pole(&before) && !sphere.is_near_pole(&after));
        }
    }
}
