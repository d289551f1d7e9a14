//! Frames: named coordinate systems and the rigid transforms between them.

use std::collections::BTreeMap;

/// A rigid transform `to_from_from`: `p_to = rotation * p_from + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// Translation, m.
    pub translation: [f64; 3],
    /// Rotation, row by row.
    pub rotation: [[f64; 3]; 3],
}

impl Rigid {
    /// The identity.
    pub const IDENTITY: Self =
        Self { translation: [0.0; 3], rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    /// A transform from a translation (m) and rotations (rad) about the fixed x, then y, then z axis.
    pub fn from_angles(translation: [f64; 3], angles: [f64; 3]) -> Self {
        let [(sx, cx), (sy, cy), (sz, cz)] = angles.map(|a| (libm::sin(a), libm::cos(a)));
        Self {
            translation,
            rotation: [
                [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
                [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
                [-sy, cy * sx, cy * cx],
            ],
        }
    }

    /// The image of a point, m.
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let r = self.rotate(p);
        std::array::from_fn(|i| r[i] + self.translation[i])
    }

    /// The image of a direction.
    pub fn rotate(&self, v: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
    }

    /// The transform the other way.
    pub fn inverse(&self) -> Self {
        let r = self.rotation;
        let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
        let back = Self { translation: [0.0; 3], rotation };
        Self { translation: back.rotate(self.translation).map(|x| -x), rotation }
    }

    /// The rotation as a unit quaternion, scalar first, scalar not negative.
    pub fn quaternion(&self) -> [f64; 4] {
        let r = self.rotation;
        let trace = r[0][0] + r[1][1] + r[2][2];
        // Shepperd's choice: divide by the largest of the four.
        let squares = [trace, r[0][0], r[1][1], r[2][2]];
        let best = (0..4).fold(0, |b, i| if squares[i] > squares[b] { i } else { b });
        let q = match best {
            0 => [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]],
            1 => [r[2][1] - r[1][2], 1.0 + r[0][0] - r[1][1] - r[2][2], r[0][1] + r[1][0], r[0][2] + r[2][0]],
            2 => [r[0][2] - r[2][0], r[0][1] + r[1][0], 1.0 - r[0][0] + r[1][1] - r[2][2], r[1][2] + r[2][1]],
            _ => [r[1][0] - r[0][1], r[0][2] + r[2][0], r[1][2] + r[2][1], 1.0 - r[0][0] - r[1][1] + r[2][2]],
        };
        let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
        let sign = if q[0] < 0.0 { -norm } else { norm };
        q.map(|x| x / sign)
    }

    /// `self` after `first`.
    pub fn after(&self, first: &Self) -> Self {
        let (a, b) = (self.rotation, first.rotation);
        Self {
            translation: self.apply(first.translation),
            rotation: std::array::from_fn(|i| {
                std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
            }),
        }
    }
}

/// A frame that the config places in another.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The frame that it is placed in.
    pub parent: String,
    /// `parent_from_frame`.
    pub parent_from_frame: Rigid,
    /// Day of the measurement, `YYYY-MM-DD`, where the config gives it.
    pub measured: Option<String>,
    /// Residual of the measurement, m.
    pub residual: Option<f64>,
}

/// The frames of a pipeline: a forest, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frames {
    /// Frames that are placed in another; a name that only stands as a parent is a root.
    pub placed: BTreeMap<String, Frame>,
}

impl Frames {
    /// Whether the name is a frame of the pipeline.
    pub fn knows(&self, name: &str) -> bool {
        self.placed.contains_key(name) || self.placed.values().any(|f| f.parent == name)
    }

    /// The transform `to_from_from`, where both frames hang on one root.
    pub fn transform(&self, to: &str, from: &str) -> Option<Rigid> {
        let (root_a, a) = self.to_root(from)?;
        let (root_b, b) = self.to_root(to)?;
        (root_a == root_b).then(|| b.inverse().after(&a))
    }

    /// The placed frames on the path between two frames: those whose places the transform between them is made of.
    pub fn between<'a>(&'a self, a: &'a str, b: &'a str) -> Vec<&'a str> {
        let (up, down) = (self.placed_above(a), self.placed_above(b));
        let only = |of: &[&'a str], not: &[&str]| -> Vec<&'a str> {
            of.iter().copied().filter(|name| !not.contains(name)).collect()
        };
        [only(&up, &down), only(&down, &up)].concat()
    }

    /// A frame and those that it hangs on, without the root.
    fn placed_above<'a>(&'a self, name: &'a str) -> Vec<&'a str> {
        let mut found = Vec::new();
        let mut at = name;
        while let Some(frame) = self.placed.get(at).filter(|_| found.len() < self.placed.len()) {
            found.push(at);
            at = &frame.parent;
        }
        found
    }

    /// Root of a frame and `root_from_frame`. `None` where parents run in a circle.
    fn to_root<'a>(&'a self, name: &'a str) -> Option<(&'a str, Rigid)> {
        let (mut at, mut sum) = (name, Rigid::IDENTITY);
        for _ in 0..=self.placed.len() {
            match self.placed.get(at) {
                None => return Some((at, sum)),
                Some(f) => {
                    sum = f.parent_from_frame.after(&sum);
                    at = &f.parent;
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_there_and_back_is_identity() {
        let mut frames = Frames::default();
        let f = |parent: &str, t, a| Frame {
            parent: parent.into(),
            parent_from_frame: Rigid::from_angles(t, a),
            measured: None,
            residual: None,
        };
        frames.placed.insert("camera".into(), f("couch", [0.1, -0.4, 0.5], [0.7, 0.2, -0.3]));
        frames.placed.insert("head".into(), f("couch", [0.0, 0.2, 0.1], [0.0, 0.1, 0.4]));
        let there = frames.transform("camera", "head").unwrap();
        let back = frames.transform("head", "camera").unwrap();
        let p = back.apply(there.apply([0.3, -0.2, 0.9]));
        for (a, b) in p.iter().zip([0.3, -0.2, 0.9]) {
            assert!((a - b).abs() < 1e-15);
        }
        assert!(frames.transform("camera", "elsewhere").is_none());
    }

    #[test]
    fn the_path_between_two_frames_has_each_placed_frame_of_it() {
        let mut frames = Frames::default();
        for (name, parent) in [("camera", "arm"), ("arm", "room"), ("couch", "room"), ("head", "couch")] {
            let frame = Frame {
                parent: parent.into(),
                parent_from_frame: Rigid::IDENTITY,
                measured: None,
                residual: None,
            };
            frames.placed.insert(name.into(), frame);
        }
        assert_eq!(frames.between("camera", "couch"), ["camera", "arm", "couch"]);
        assert_eq!(frames.between("head", "couch"), ["head"]);
        assert_eq!(frames.between("couch", "camera"), ["couch", "camera", "arm"]);
        assert_eq!(frames.between("couch", "couch"), [""; 0]);
    }
}
