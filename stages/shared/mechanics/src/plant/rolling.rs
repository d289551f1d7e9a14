//! Contacts that move over head and bladders: the kinematics of chapter 3 in a plant (SCIENCE B4, B8, C2).
//!
//! The surface of the head around each contact is a sphere that is fixed on the head. A bladder is a sphere about a
//! centre that is fixed over the couch, clipped by the head where it touches. The contact lies on the line through both
//! centres, so its place on both surfaces, which the contact equations (3.16)-(3.22) give as rates, follows from the pose in
//! closed form: no drift, no poles of a chart.
//!
//! With the head's rotation `R = Rz(yaw) Ry(roll) Rx(pitch)`, the centre of its sphere at `a` from its origin, and that
//! of the bladder at `c`: `gap = h + |x + R a - c| - r_h`, and the normal is that of the line. The bladder's coordinates
//! are its shear in two directions, its height, which is the gap, and its twist.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::contact::forward::contact_map;
use crate::contact::grasp::Touch;
use crate::dynamics::reduced::{Carried, Terms};
use crate::shell::Shell;

/// Density of rubber, kg/m^3.
const RUBBER: f64 = 1100.0;

/// Where the contacts of a plant are and what moves with them.
#[derive(Debug, Clone, PartialEq)]
pub struct Rolling<const D: usize, const B: usize> {
    /// Which of x, y, z, pitch, roll, yaw each coordinate is.
    pub channels: [usize; D],
    /// Centre of the head's sphere at each contact, from the head's origin in the head's axes, m.
    pub head: [Vector3<f64>; B],
    /// Centre of each bladder in the axes of the couch, from where the head's origin is at `q = 0`, m.
    pub bladder: [Vector3<f64>; B],
    /// Radius of the head's spheres, m.
    pub radius: f64,
    /// Distance of a bladder's centre from the plate on its far side, m.
    pub half: f64,
    /// Moments of inertia of the head about its x, y and z, kg m^2.
    pub moments: Vector3<f64>,
    /// Mass of a bladder's wall that moves with its height, kg.
    pub wall: f64,
}

/// A head at some coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Its origin, m.
    pub place: Vector3<f64>,
    /// `couch_from_head`.
    pub turn: Matrix3<f64>,
    /// The axes about which pitch, roll and yaw turn it, in the axes of the couch.
    pub axes: [Vector3<f64>; 3],
}

/// All contacts at some coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Met<const D: usize, const B: usize> {
    pub placed: Placed,
    pub meetings: [Meeting; B],
    /// The gap of each bladder, m.
    pub gaps: SVector<f64, B>,
    /// How the gaps change with the coordinates: the rows of the heights in `H`.
    pub slopes: SMatrix<f64, B, D>,
}

/// A contact at some coordinates, in the axes of the couch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meeting {
    /// From the head's origin to the centre of the head's sphere, m.
    pub arm: Vector3<f64>,
    /// From the bladder to the head: the head's inward normal.
    pub normal: Vector3<f64>,
    /// Distance of the centres, m.
    pub length: f64,
}

impl<const D: usize, const B: usize> Rolling<D, B> {
    /// Contacts that lie at `places` from the head's origin, each with the direction in which its bladder pushes, where
    /// `q = 0` and the plates of each bladder are `gap` m apart. `radius` is that of the head at the contacts.
    pub fn new(
        channels: [usize; D],
        places: &[(Vector3<f64>, Vector3<f64>); B],
        radius: f64,
        gap: f64,
        moments: Vector3<f64>,
        shell: &Shell,
    ) -> Self {
        let half = 0.5 * gap;
        let cube = |radius: f64| radius * radius * radius;
        let volume = 4.0 / 3.0 * core::f64::consts::PI * (cube(shell.outer) - cube(shell.inner));
        Self {
            channels,
            head: places.map(|(arm, push)| arm + push * radius),
            bladder: places.map(|(arm, push)| arm - push * half),
            radius,
            half,
            moments,
            // The wall moves from nothing at the far side to the rate of the gap at the head: a third, as of a spring.
            wall: RUBBER * volume / 3.0,
        }
    }

    fn spread(&self, position: &SVector<f64, D>) -> [f64; 6] {
        let mut all = [0.0; 6];
        for (channel, value) in self.channels.iter().zip(position) {
            all[*channel] = *value;
        }
        all
    }

    /// The head at these coordinates.
    pub fn placed(&self, position: &SVector<f64, D>) -> Placed {
        let [x, y, z, pitch, roll, yaw] = self.spread(position);
        let (sp, cp) = (libm::sin(pitch), libm::cos(pitch));
        let (sr, cr) = (libm::sin(roll), libm::cos(roll));
        let (sy, cy) = (libm::sin(yaw), libm::cos(yaw));
        let about_z = Matrix3::new(cy, -sy, 0.0, sy, cy, 0.0, 0.0, 0.0, 1.0);
        let about_y = Matrix3::new(cr, 0.0, sr, 0.0, 1.0, 0.0, -sr, 0.0, cr);
        let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cp, -sp, 0.0, sp, cp);
        let outer = about_z * about_y;
        Placed {
            place: Vector3::new(x, y, z),
            turn: outer * about_x,
            axes: [outer.column(0).into_owned(), about_z.column(1).into_owned(), Vector3::z()],
        }
    }

    /// All contacts of a head at these coordinates.
    pub fn met(&self, position: &SVector<f64, D>) -> Met<D, B> {
        let placed = self.placed(position);
        let meetings: [Meeting; B] = core::array::from_fn(|j| {
            let arm = placed.turn * self.head[j];
            let apart = placed.place + arm - self.bladder[j];
            let length = apart.norm();
            Meeting { arm, normal: apart / length, length }
        });
        let gaps = SVector::from_fn(|j, _| self.half + meetings[j].length - self.radius);
        let slopes = SMatrix::from_fn(|j, i| meetings[j].normal.dot(&self.by(&placed, &meetings[j].arm, i)));
        Met { placed, meetings, gaps, slopes }
    }

    /// Where a contact touches the head.
    pub fn touch(&self, meeting: &Meeting) -> Touch {
        Touch { arm: meeting.arm - meeting.normal * self.radius, normal: meeting.normal }
    }

    /// Velocity and angular velocity of the head by the rates of its coordinates, in the axes of the couch.
    pub fn twists(&self, placed: &Placed) -> SMatrix<f64, 6, D> {
        let mut twists = SMatrix::<f64, 6, D>::zeros();
        for (i, channel) in self.channels.iter().enumerate() {
            match channel.checked_sub(3) {
                None => twists[(*channel, i)] = 1.0,
                Some(turn) => twists.fixed_view_mut::<3, 1>(3, i).copy_from(&placed.axes[turn % 3]),
            }
        }
        twists
    }

    /// What the forces of bladder `j` at its contact do to the coordinates, and, transposed, what the coordinates do to the
    /// bladder (`H = J^-1 G^T`): two directions across the normal, the normal, and the torque about it.
    pub fn map(&self, met: &Met<D, B>, j: usize) -> SMatrix<f64, D, 4> {
        self.twists(&met.placed).transpose() * contact_map(&self.touch(&met.meetings[j]))
    }

    /// How a point at `arm` from the origin of the head moves with coordinate `i`.
    fn by(&self, placed: &Placed, arm: &Vector3<f64>, i: usize) -> Vector3<f64> {
        match self.channels[i] {
            0 => Vector3::x(),
            1 => Vector3::y(),
            2 => Vector3::z(),
            turn => placed.axes[(turn - 3) % 3].cross(arm),
        }
    }

    /// Second derivatives of the gap of a contact by the coordinates: how its row of `H` moves while the contact moves
    /// over head and bladder.
    pub fn gap_bends(&self, met: &Met<D, B>, j: usize) -> SMatrix<f64, D, D> {
        let (placed, Meeting { arm, normal, length }) = (&met.placed, met.meetings[j]);
        let slopes: [Vector3<f64>; D] = core::array::from_fn(|i| self.by(placed, &arm, i));
        SMatrix::from_fn(|i, k| {
            let along = normal.dot(&slopes[i]) * normal.dot(&slopes[k]);
            let mut bend = (slopes[i].dot(&slopes[k]) - along) / length;
            // Yaw turns what roll turned, and roll what pitch turned.
            let (outer, inner) =
                (self.channels[i].max(self.channels[k]), self.channels[i].min(self.channels[k]));
            if inner >= 3 {
                let inside = placed.axes[(inner - 3) % 3].cross(&arm);
                bend += normal.dot(&placed.axes[(outer - 3) % 3].cross(&inside));
            }
            bend
        })
    }

    /// How the heights of the bladders follow the coordinates.
    pub fn carried(&self, met: &Met<D, B>, rate: &SVector<f64, D>) -> Carried<D, B> {
        let mut map_rate = SMatrix::<f64, B, D>::zeros();
        for j in 0..B {
            map_rate.row_mut(j).copy_from(&(self.gap_bends(met, j) * rate).transpose());
        }
        Carried { map: met.slopes, map_rate }
    }

    /// Mass and velocity matrices of the head (3.58), with its masses along the coordinates that are no angles. Of its
    /// three moments of inertia those about its own axes count, wherever it is turned.
    pub fn head_terms(
        &self,
        masses: &SVector<f64, D>,
        position: &SVector<f64, D>,
        rate: &SVector<f64, D>,
    ) -> Terms<D> {
        let ([_, _, _, pitch, roll, _], rates) = (self.spread(position), self.spread(rate));
        let (sp, cp) = (libm::sin(pitch), libm::cos(pitch));
        let (sr, cr) = (libm::sin(roll), libm::cos(roll));
        // Angular velocity in the head's axes by the rates of pitch, roll and yaw, and how that changes.
        let turn = Matrix3::new(1.0, 0.0, -sr, 0.0, cp, sp * cr, 0.0, -sp, cp * cr);
        let (dp, dr) = (rates[3], rates[4]);
        let turn_rate = Matrix3::new(
            0.0,
            0.0,
            -cr * dr,
            0.0,
            -sp * dp,
            cp * cr * dp - sp * sr * dr,
            0.0,
            -cp * dp,
            -sp * cr * dp - cp * sr * dr,
        );
        let inertia = Matrix3::from_diagonal(&self.moments);
        let spin = turn * Vector3::new(dp, dr, rates[5]);
        let mass = turn.transpose() * inertia * turn;
        let velocity = turn.transpose() * (inertia * turn_rate - (inertia * spin).cross_matrix() * turn);
        let part = |all: &Matrix3<f64>, i: usize, k: usize| {
            let [row, column] = [i, k].map(|i| self.channels[i].checked_sub(3));
            row.zip(column).map(|(row, column)| all[(row % 3, column % 3)])
        };
        Terms {
            mass: SMatrix::from_fn(|i, k| {
                let along = if i == k { masses[i] } else { 0.0 };
                part(&mass, i, k).unwrap_or(along)
            }),
            velocity: SMatrix::from_fn(|i, k| part(&velocity, i, k).unwrap_or(0.0)),
            load: SVector::zeros(),
        }
    }

    /// The walls as bodies: what they push with is in the forces on them.
    pub fn walls(&self) -> Terms<B> {
        let mass = SMatrix::<f64, B, B>::from_diagonal_element(self.wall);
        Terms { mass, velocity: SMatrix::zeros(), load: SVector::zeros() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::chart::{ChartPoint, Surface};
    use crate::contact::rolling::{Contact, rate};
    use crate::contact::se3::Twist;
    use crate::plant::layouts::{SixDof, ThreeDof, rolling};
    use nalgebra::{Matrix2, Vector2, Vector6};
    use proptest::prelude::*;

    const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

    fn eight() -> Rolling<6, 8> {
        rolling(&ALL, 5.0, &Shell::rig()).unwrap()
    }

    fn pose() -> impl Strategy<Value = SVector<f64, 6>> {
        (prop::array::uniform3(-0.02..0.02f64), prop::array::uniform3(-0.3..0.3f64))
            .prop_map(|([x, y, z], [a, b, c])| Vector6::new(x, y, z, a, b, c))
    }

    fn motion() -> impl Strategy<Value = SVector<f64, 6>> {
        (prop::array::uniform3(-0.2..0.2f64), prop::array::uniform3(-2.0..2.0f64))
            .prop_map(|([x, y, z], [a, b, c])| Vector6::new(x, y, z, a, b, c))
    }

    /// A point of a sphere by its direction from the centre.
    fn chart(direction: &Vector3<f64>) -> ChartPoint {
        ChartPoint::new(libm::asin(direction.z), libm::atan2(-direction.y, direction.x))
    }

    /// Contact `j` in the coordinates of both charts (3.16)-(3.19).
    fn coordinates(rolling: &Rolling<6, 8>, met: &Met<6, 8>, j: usize) -> (Surface, Surface, Contact) {
        let Meeting { normal, length, .. } = met.meetings[j];
        let bladder = Surface::Sphere { radius: length - rolling.radius };
        let head = Surface::Sphere { radius: rolling.radius };
        let turn = met.placed.turn;
        let (at_bladder, at_head) = (chart(&normal), chart(&(turn.transpose() * -normal)));
        let (e_1, e_h) = (bladder.at(&at_bladder).tangents, head.at(&at_head).tangents);
        let psi: Matrix2<f64> = e_1.transpose() * turn * e_h;
        let contact =
            Contact { bladder: at_bladder, head: at_head, psi: libm::atan2(-psi[(0, 1)], psi[(0, 0)]) };
        (bladder, head, contact)
    }

    proptest! {
        #[test]
        fn slopes_and_bends_are_the_derivatives_of_the_gaps(q in pose()) {
            let rolling = eight();
            let met = rolling.met(&q);
            let h = 1e-6;
            for i in 0..6 {
                let mut step = Vector6::zeros();
                step[i] = h;
                let (more, less) = (rolling.met(&(q + step)), rolling.met(&(q - step)));
                let slope = (more.gaps - less.gaps) / (2.0 * h);
                prop_assert!((slope - met.slopes.column(i)).amax() < 1e-8);
                let bend = (more.slopes - less.slopes) / (2.0 * h);
                for j in 0..8 {
                    let expected = rolling.gap_bends(&met, j);
                    prop_assert!((bend.row(j).transpose() - expected.column(i)).amax() < 1e-6, "{} {}", i, j);
                }
            }
        }

        #[test]
        fn the_contact_of_the_closed_form_moves_by_the_contact_equations(
            q in pose(), rates in motion(), j in 0..8usize,
        ) {
            let rolling = eight();
            let met = rolling.met(&q);
            let (bladder, head, contact) = coordinates(&rolling, &met, j);
            prop_assume!(contact.bladder.alpha.x.abs() < 1.2 && contact.head.alpha.x.abs() < 1.2);
            // The head has not come beyond the centre of the bladder.
            prop_assume!(met.gaps[j] > rolling.half + 5e-3);
            // The head relative to the bladder, about the centre of its sphere and in its own axes.
            let twist = rolling.twists(&met.placed) * rates;
            let (v, w) = (twist.fixed_rows::<3>(0), twist.fixed_rows::<3>(3).into_owned());
            let back = met.placed.turn.transpose();
            let relative = Twist { v: back * (v + w.cross(&met.meetings[j].arm)), w: back * w };
            let found = rate(&bladder, &head, &contact, &relative).unwrap();
            let h = 1e-6;
            let after = |s: f64| coordinates(&rolling, &rolling.met(&(q + rates * s)), j).2;
            let (more, less) = (after(h), after(-h));
            let turned = |a: f64| libm::remainder(a, core::f64::consts::TAU) / (2.0 * h);
            let change = |a: Vector2<f64>| a.map(turned);
            let due = change(more.bladder.alpha - less.bladder.alpha);
            prop_assert!((found.bladder - due).amax() < 1e-5, "{} {}", found.bladder, due);
            let due = change(more.head.alpha - less.head.alpha);
            prop_assert!((found.head - due).amax() < 1e-5, "{} {}", found.head, due);
            let due = turned(more.psi - less.psi);
            prop_assert!((found.psi - due).abs() < 1e-5, "{} {}", found.psi, due);
        }

        #[test]
        fn the_map_of_a_contact_is_the_motion_of_the_touched_point(
            q in pose(), rates in motion(), j in 0..8usize,
        ) {
            let rolling = eight();
            let met = rolling.met(&q);
            let normal = met.meetings[j].normal;
            let map = rolling.map(&met, j);
            let bladder = map.transpose() * rates;
            prop_assert!((map.column(2).transpose() - met.slopes.row(j)).amax() < 1e-12);
            // The point of the head that touches now.
            let point = met.placed.turn.transpose() * rolling.touch(&met.meetings[j]).arm;
            let h = 1e-6;
            let at = |s: f64| {
                let placed = rolling.placed(&(q + rates * s));
                (placed.place + placed.turn * point, placed.turn)
            };
            let ((p1, r1), (p0, r0)) = (at(h), at(-h));
            let speed = (p1 - p0) / (2.0 * h);
            let [first, second] = crate::contact::forward::across(&normal);
            for (found, direction) in bladder.iter().zip([first, second, normal]) {
                prop_assert!((found - direction.dot(&speed)).abs() < 1e-7);
            }
            let spin = (r1 - r0) * met.placed.turn.transpose() / (2.0 * h);
            let w = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
            prop_assert!((bladder[3] - normal.dot(&w)).abs() < 1e-6);
        }

        #[test]
        fn the_velocity_terms_of_the_head_do_no_work(q in pose(), rates in motion()) {
            let (rolling, masses) = (eight(), Vector6::repeat(5.0));
            let terms = rolling.head_terms(&masses, &q, &rates);
            let h = 1e-6;
            let mass = |s: f64| rolling.head_terms(&masses, &(q + rates * s), &rates).mass;
            let mass_rate = (mass(h) - mass(-h)) / (2.0 * h);
            let work = rates.dot(&((mass_rate - terms.velocity * 2.0) * rates));
            prop_assert!(work.abs() < 1e-7, "{}", work);
            // Kinetic energy of a body that turns about its own axes.
            let placed = rolling.placed(&q);
            let twist = rolling.twists(&placed) * rates;
            let spin = placed.turn.transpose() * twist.fixed_rows::<3>(3);
            let due = 2.5 * rates.fixed_rows::<3>(0).norm_squared()
                + 0.5 * spin.dot(&rolling.moments.component_mul(&spin));
            prop_assert!((0.5 * rates.dot(&(terms.mass * rates)) - due).abs() < 1e-12);
        }
    }

    #[test]
    fn where_the_coordinates_are_zero_the_contacts_are_those_that_stay() {
        let (plant, contacts) = (SixDof::rig(5.0), eight());
        let met = contacts.met(&SVector::zeros());
        assert!((met.slopes - plant.jacobian).amax() < 1e-12);
        assert!((met.gaps - plant.gap_at_zero).amax() < 1e-12);
        let (plant, contacts) =
            (ThreeDof::rig(5.0), rolling::<3, 3>(&[2, 3, 4], 5.0, &Shell::rig()).unwrap());
        let met = contacts.met(&SVector::zeros());
        assert!((met.slopes - plant.jacobian).amax() < 1e-12);
        assert!((met.gaps - plant.gap_at_zero).amax() < 1e-12);
        assert_eq!(rolling::<1, 1>(&[2], 5.0, &Shell::rig()), None);
    }
}
