//! How a contact wanders over a bladder and the head: Montana's equations (SCIENCE B4, in place of (3.19)-(3.22)).
//!
//! The contacts of the plants follow from the pose in closed form (`plant::rolling`). Their tests compare its motion
//! with these equations.

use nalgebra::{Matrix2, Vector2};

use super::chart::{ChartPoint, Local, Surface};
use super::se3::Twist;

/// A contact: a point of each surface, and the angle between their charts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// On the bladder, `alpha_1`.
    pub bladder: ChartPoint,
    /// On the head, `alpha_h`.
    pub head: ChartPoint,
    /// `psi`, rad.
    pub psi: f64,
}

/// The head's motion as its contact sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relative {
    /// Rolling, rad/s, in the head's chart.
    pub rolling: Vector2<f64>,
    /// Sliding, m/s, in the head's chart.
    pub sliding: Vector2<f64>,
    /// Spin about the head's normal, rad/s.
    pub spin: f64,
    /// Speed along the head's normal, m/s: 0 as long as the contact is kept.
    pub parting: f64,
}

/// How a contact moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactRate {
    /// `alpha_1'`.
    pub bladder: Vector2<f64>,
    /// `alpha_h'`.
    pub head: Vector2<f64>,
    /// `psi'`.
    pub psi: f64,
}

/// `R_psi`: symmetric, its own inverse, with determinant -1, because the two normals oppose (3.19).
pub fn chart_turn(psi: f64) -> Matrix2<f64> {
    let (s, c) = (libm::sin(psi), libm::cos(psi));
    Matrix2::new(c, -s, -s, -c)
}

/// What a twist does at a point of the head. The twist is the head's relative to the bladder in the head's own axes:
/// minus the spatial twist of the bladder's pose in the head's frame.
pub fn relative(head: &Local, twist: &Twist) -> Relative {
    let across = head.tangents.transpose();
    let speed = twist.w.cross(&head.point) + twist.v;
    Relative {
        rolling: across * head.normal.cross(&twist.w),
        sliding: across * speed,
        spin: head.normal.dot(&twist.w),
        parting: head.normal.dot(&speed),
    }
}

/// How a contact between these surfaces moves under a twist of the head relative to the bladder (see [`relative`]).
/// `None` where the surfaces fit each other so well that no point is the contact, as flat on flat.
pub fn rate(bladder: &Surface, head: &Surface, contact: &Contact, twist: &Twist) -> Option<ContactRate> {
    let (on_bladder, on_head) = (bladder.at(&contact.bladder), head.at(&contact.head));
    let Relative { rolling, sliding, spin, .. } = relative(&on_head, twist);
    let turn = chart_turn(contact.psi);
    let curvature = turn * on_bladder.curvature * turn;
    let inverse = (on_head.curvature + curvature).try_inverse()?;
    // Lengths on both surfaces, M alpha'.
    let head_path = inverse * (rolling - curvature * sliding);
    let bladder_path = turn * inverse * (rolling + on_head.curvature * sliding);
    let rate = ContactRate {
        bladder: bladder_path.component_div(&on_bladder.metric),
        head: head_path.component_div(&on_head.metric),
        psi: spin + on_head.torsion.dot(&head_path) + on_bladder.torsion.dot(&bladder_path),
    };
    (rate.psi.is_finite() && rate.head.amax().is_finite() && rate.bladder.amax().is_finite()).then_some(rate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::chart::Poles;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    /// The bladder's pose in the head's frame by its contact: `R [E_1 R_psi, -n_1] = [E_h, n_h]`, `p = f_h - R f_1`.
    fn head_from_bladder(
        bladder: &Surface,
        head: &Surface,
        contact: &Contact,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        let (on_bladder, on_head) = (bladder.at(&contact.bladder), head.at(&contact.head));
        let turned = on_bladder.tangents * chart_turn(contact.psi);
        let from = frame(&turned, &-on_bladder.normal);
        let rotation = frame(&on_head.tangents, &on_head.normal) * from.transpose();
        (rotation, on_head.point - rotation * on_bladder.point)
    }

    fn frame(tangents: &nalgebra::Matrix3x2<f64>, normal: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::from_columns(&[tangents.column(0).into_owned(), tangents.column(1).into_owned(), *normal])
    }

    impl Contact {
        /// The same contact in charts whose poles are far from it: to be asked for before each step.
        fn away_from_poles(&self, bladder: &Surface, head: &Surface) -> Self {
            let mut contact = *self;
            for (surface, point) in [(bladder, &mut contact.bladder), (head, &mut contact.head)] {
                if surface.is_near_pole(point)
                    && let Some((other, turned)) = surface.switched(point)
                {
                    *point = other;
                    contact.psi += turned;
                }
            }
            contact
        }
    }

    const HEAD: Surface = Surface::Sphere { radius: 1.0 };

    fn round() -> impl Strategy<Value = Surface> {
        prop_oneof![
            (0.03..0.2f64).prop_map(|radius| Surface::Sphere { radius }),
            (0.03..0.2f64, 0.03..0.2f64)
                .prop_map(|(equatorial, polar)| Surface::Spheroid { equatorial, polar }),
        ]
    }

    fn heads() -> impl Strategy<Value = Surface> {
        prop_oneof![Just(Surface::Plane), round()]
    }

    proptest! {
        /// The pose is rebuilt from the contact a moment later and before; its twist must be the one that moved it.
        #[test]
        fn the_contact_that_moves_so_makes_the_pose_that_moved_it(
            bladder in round(),
            head in heads(),
            at in prop::array::uniform4(-1.0..1.0f64),
            psi in -3.0..3.0f64,
            w in prop::array::uniform3(-1.0..1.0f64),
            v in prop::array::uniform3(-0.2..0.2f64),
        ) {
            let contact = Contact {
                bladder: ChartPoint::new(at[0], at[1]),
                head: ChartPoint::new(at[2], at[3]),
                psi,
            };
            let on_head = head.at(&contact.head);
            let w = Vector3::from(w);
            // Without its part along the normal, the twist keeps the contact.
            let mut v = Vector3::from(v);
            v -= on_head.normal * on_head.normal.dot(&(w.cross(&on_head.point) + v));
            let moved = rate(&bladder, &head, &contact, &Twist { v, w }).unwrap();
            let h = 1e-6;
            let after = |s: f64| {
                let later = Contact {
                    bladder: ChartPoint { alpha: contact.bladder.alpha + moved.bladder * s, ..contact.bladder },
                    head: ChartPoint { alpha: contact.head.alpha + moved.head * s, ..contact.head },
                    psi: contact.psi + moved.psi * s,
                };
                head_from_bladder(&bladder, &head, &later)
            };
            let ((r0, p0), (r, p), (r1, p1)) = (after(-h), after(0.0), after(h));
            let spin = (r1 - r0) * r.transpose() / (2.0 * h);
            let omega = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
            let speed = (p1 - p0) / (2.0 * h);
            prop_assert!((-omega - w).amax() < 1e-6, "{} {}", -omega, w);
            prop_assert!((-(speed - omega.cross(&p)) - v).amax() < 1e-7, "{} {}", speed, v);
        }

        #[test]
        fn the_pose_is_the_same_in_every_chart(
            at in prop::array::uniform4(-1.45..1.45f64),
            psi in -3.0..3.0f64,
        ) {
            let bladder = Surface::Sphere { radius: 0.05 };
            let contact = Contact {
                bladder: ChartPoint::new(at[0], at[1]),
                head: ChartPoint { poles: Poles::AlongX, ..ChartPoint::new(at[2], at[3]) },
                psi,
            };
            let moved = contact.away_from_poles(&bladder, &HEAD);
            let (before, after) =
                (head_from_bladder(&bladder, &HEAD, &contact), head_from_bladder(&bladder, &HEAD, &moved));
            prop_assert!((before.0 - after.0).amax() < 1e-7 && (before.1 - after.1).amax() < 1e-7);
            prop_assert!(!bladder.is_near_pole(&moved.bladder) && !HEAD.is_near_pole(&moved.head));
        }

        /// (3.26) corrected: two unit spheres that roll.
        #[test]
        fn two_unit_spheres_roll_as_in_closed_form(
            at in prop::array::uniform4(-1.0..1.0f64),
            psi in -3.0..3.0f64,
            w in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let contact = Contact {
                bladder: ChartPoint::new(at[0], at[1]),
                head: ChartPoint::new(at[2], at[3]),
                psi,
            };
            let on_head = HEAD.at(&contact.head);
            let w = Vector3::from(w);
            let twist = Twist { v: -w.cross(&on_head.point), w };
            let Relative { rolling, spin, .. } = relative(&on_head, &twist);
            let (a, b) = (rolling.x, rolling.y);
            let (s, c) = psi.sin_cos();
            let (u1, uh) = (at[0], at[2]);
            let found = rate(&HEAD, &HEAD, &contact, &twist).unwrap();
            let head = Vector2::new(a / 2.0, b / uh.cos() / 2.0);
            let bladder = Vector2::new((a * c - b * s) / 2.0, -(a * s + b * c) / u1.cos() / 2.0);
            let turn = spin - b * uh.tan() / 2.0 + u1.tan() * (a * s + b * c) / 2.0;
            prop_assert!((found.head - head).amax() < 1e-10 && (found.bladder - bladder).amax() < 1e-10);
            prop_assert!((found.psi - turn).abs() < 1e-10);
        }

        /// (3.27)-(3.29) corrected: a ball on a plane that rolls, slides and spins.
        #[test]
        fn a_ball_on_a_plane_rolls_slides_and_spins_as_in_closed_form(
            radius in 0.02..0.2f64,
            u in -1.0..1.0f64,
            psi in -3.0..3.0f64,
            motion in prop::array::uniform5(-1.0..1.0f64),
        ) {
            let bladder = Surface::Sphere { radius };
            let contact = Contact { bladder: ChartPoint::new(u, 0.3), head: ChartPoint::new(0.0, 0.0), psi };
            // On a plane, omega_t is (-w_y, w_x).
            let [a, b, spin, slide_x, slide_y] = motion;
            let twist = Twist { v: Vector3::new(slide_x, slide_y, 0.0), w: Vector3::new(b, -a, spin) };
            let found = rate(&bladder, &Surface::Plane, &contact, &twist).unwrap();
            let (s, c) = psi.sin_cos();
            let head = Vector2::new(radius * a - slide_x, radius * b - slide_y);
            let rolled = Vector2::new(a * c - b * s, -(a * s + b * c) / u.cos());
            prop_assert!((found.head - head).amax() < 1e-10, "{} {}", found.head, head);
            prop_assert!((found.bladder - rolled).amax() < 1e-10, "{} {}", found.bladder, rolled);
            prop_assert!((found.psi - (spin + u.tan() * (a * s + b * c))).abs() < 1e-10);
        }
    }

    #[test]
    fn flat_on_flat_has_no_contact_point() {
        let contact =
            Contact { bladder: ChartPoint::new(0.0, 0.0), head: ChartPoint::new(0.0, 0.0), psi: 0.0 };
        let twist = Twist { v: Vector3::zeros(), w: Vector3::x() };
        assert_eq!(rate(&Surface::Plane, &Surface::Plane, &contact, &twist), None);
    }
}
