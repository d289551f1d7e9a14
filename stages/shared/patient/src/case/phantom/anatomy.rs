//! Sizes drawn from the seed, and which tissue is where.
//!
//! Positions are millimetres in the DICOM patient frame; the origin lies in the prostate's middle plane, between the
//! femoral heads.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use super::variety::{Site, Variety};

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyPart {
    /// Outside the body.
    Air,
    /// Under the skin and around the organs.
    Fat,
    /// Muscle and other soft tissue.
    Muscle,
    /// Hard bone.
    Cortex,
    /// The inside of bones.
    Marrow,
    /// Urine and wall.
    Bladder,
    /// The wall of the rectum.
    RectumWall,
    /// What the rectum holds.
    Stool,
    /// Gas in the rectum.
    Gas,
    /// The prostate.
    Prostate,
    /// A target beyond the prostate.
    Tumour,
    /// Small bowel.
    Bowel,
    /// A hip implant.
    Metal,
}

/// An ellipsoid along the axes.
#[derive(Clone, Debug)]
pub struct Ellipsoid {
    /// Its centre.
    pub centre_mm: [f64; 3],
    /// Half of its extent along each axis.
    pub radii_mm: [f64; 3],
}

impl Ellipsoid {
    /// 1 on the surface, less inside.
    fn level(&self, point_mm: [f64; 3]) -> f64 {
        let part = |axis: usize| (point_mm[axis] - self.centre_mm[axis]) / self.radii_mm[axis];
        (0..3).map(|axis| part(axis) * part(axis)).sum()
    }
}

/// One man.
pub struct Anatomy {
    /// Half of the body's width and depth.
    body_mm: [f64; 2],
    /// Thickness of the fat under the skin, at the sides and in front.
    fat_mm: f64,
    prostate: Ellipsoid,
    bladder: Ellipsoid,
    /// Gas in the rectum: none, or a bubble.
    gas: Ellipsoid,
    rectum_radius_mm: f64,
    /// How far the rectum bends to a side and to the back.
    rectum_bend_mm: [f64; 2],
    rectum_y_mm: f64,
    /// Middle of the femoral heads: distance from the midline, y and z.
    hip_mm: [f64; 3],
    hip_radius_mm: f64,
    /// The target beyond the prostate.
    tumour: Vec<Ellipsoid>,
    /// Whether the prostate is (a part of) the target.
    prostate_is_target: bool,
    /// Sides with a hip implant: 1 left, -1 right.
    implants: Vec<f64>,
    bowel: Option<Ellipsoid>,
}

impl Anatomy {
    /// The man of this seed.
    pub fn of_seed(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut between = |low: f64, high: f64| {
            let unit = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            low + (high - low) * unit
        };
        let body_mm = [between(170.0, 205.0), between(98.0, 122.0)];
        let prostate_radii = [between(21.0, 29.0), between(16.0, 22.0), between(19.0, 26.0)];
        let prostate_y = between(-2.0, 8.0);
        let bladder_radii = [between(34.0, 50.0), between(26.0, 38.0), between(24.0, 40.0)];
        let rectum_radius_mm = between(13.0, 18.0);
        let gas_radius = between(0.0, 9.0);
        // The rectum lies against the prostate, the bladder upon it.
        let rectum_y_mm = prostate_y + prostate_radii[1] + rectum_radius_mm - between(0.5, 2.5);
        Self {
            body_mm,
            fat_mm: between(16.0, 34.0),
            prostate: Ellipsoid {
                centre_mm: [between(-4.0, 4.0), prostate_y, 0.0],
                radii_mm: prostate_radii,
            },
            bladder: Ellipsoid {
                centre_mm: [
                    between(-6.0, 6.0),
                    prostate_y - between(6.0, 14.0),
                    prostate_radii[2] + bladder_radii[2] - between(6.0, 10.0),
                ],
                radii_mm: bladder_radii,
            },
            gas: Ellipsoid {
                centre_mm: [0.0, -0.3 * rectum_radius_mm, between(-20.0, 50.0)],
                radii_mm: [gas_radius, 0.7 * gas_radius, 1.8 * gas_radius],
            },
            rectum_radius_mm,
            rectum_bend_mm: [between(-7.0, 7.0), between(6.0, 16.0)],
            rectum_y_mm,
            hip_mm: [between(82.0, 96.0), between(-6.0, 8.0), between(0.0, 16.0)],
            hip_radius_mm: between(22.5, 26.5),
            tumour: Vec::new(),
            prostate_is_target: true,
            implants: Vec::new(),
            bowel: None,
        }
    }

    /// The man of this seed with a variety.
    pub fn varied(seed: u64, variety: &Variety) -> Self {
        let mut man = Self::of_seed(seed);
        man.body_mm = [0, 1].map(|axis| man.body_mm[axis] * variety.body[axis]);
        man.fat_mm *= variety.fat;
        let [prostate, bladder, rectum] = variety.organs;
        // The rectum stays against the prostate, the bladder upon it.
        let behind = (prostate - 1.0) * man.prostate.radii_mm[1] + (rectum - 1.0) * man.rectum_radius_mm;
        man.rectum_y_mm += behind;
        man.bladder.centre_mm[2] +=
            (prostate - 1.0) * man.prostate.radii_mm[2] + (bladder - 1.0) * man.bladder.radii_mm[2];
        man.prostate.radii_mm = man.prostate.radii_mm.map(|r| prostate * r);
        man.bladder.radii_mm = man.bladder.radii_mm.map(|r| bladder * r);
        man.rectum_radius_mm *= rectum;
        man.tumour = variety.target(&man.prostate, &man.bladder, man.rectum_y_mm);
        man.prostate_is_target = matches!(variety.site, Site::Prostate | Site::Vesicles);
        man.implants.clone_from(&variety.implants);
        man.bowel.clone_from(&variety.bowel);
        man
    }

    /// Whether a part belongs to the clinical target.
    pub fn is_target(&self, part: BodyPart) -> bool {
        part == BodyPart::Tumour || (part == BodyPart::Prostate && self.prostate_is_target)
    }

    /// Sides with a hip implant: 1 left, -1 right.
    pub fn implants(&self) -> &[f64] {
        &self.implants
    }

    /// Half of the body's width and depth, at its widest.
    pub fn half_widths_mm(&self) -> [f64; 2] {
        self.body_mm
    }

    /// Whether a place is in the femoral head of a side: 1 left, -1 right.
    pub fn femoral_head(&self, side: f64, point_mm: [f64; 3]) -> bool {
        distance(point_mm, self.hip(side)) <= self.hip_radius_mm
    }

    /// What is at a place.
    pub fn part(&self, point_mm: [f64; 3]) -> BodyPart {
        let depth = self.depth_mm(point_mm);
        if depth <= 0.0 {
            return BodyPart::Air;
        }
        if self.tumour.iter().any(|part| part.level(point_mm) <= 1.0) {
            return BodyPart::Tumour;
        }
        if self.prostate.level(point_mm) <= 1.0 {
            return BodyPart::Prostate;
        }
        if let Some(part) = self.rectum(point_mm) {
            return part;
        }
        if self.bladder.level(point_mm) <= 1.0 {
            return BodyPart::Bladder;
        }
        if self.bowel.as_ref().is_some_and(|bowel| bowel.level(point_mm) <= 1.0) {
            return BodyPart::Bowel;
        }
        if self.implants.iter().any(|side| self.implant(*side, point_mm)) {
            return BodyPart::Metal;
        }
        if let Some(part) = self.bone(point_mm) {
            return part;
        }
        // The back carries less fat than the belly, and the space around the organs is fat.
        let skin = self.fat_mm * if point_mm[1] > 0.0 { 0.8 } else { 1.0 };
        let pelvis = Ellipsoid { centre_mm: [0.0, 5.0, 25.0], radii_mm: [68.0, 62.0, 75.0] };
        match depth < skin || pelvis.level(point_mm) <= 1.0 {
            true => BodyPart::Fat,
            false => BodyPart::Muscle,
        }
    }

    /// Depth under the skin along the way to the axis, about; negative outside.
    fn depth_mm(&self, [x, y, z]: [f64; 3]) -> f64 {
        // Widest at the hips; the back is flatter than the belly.
        let narrowing = 1.0 - 0.04 * ((z - 10.0) / 90.0) * ((z - 10.0) / 90.0);
        let a = self.body_mm[0] * narrowing;
        let b = self.body_mm[1] * narrowing * if y > 0.0 { 0.94 } else { 1.0 };
        let power = 2.5;
        let level = libm::pow(libm::pow((x / a).abs(), power) + libm::pow((y / b).abs(), power), 1.0 / power);
        let radius = libm::sqrt(x * x + y * y);
        if level == 0.0 { b } else { radius * (1.0 / level - 1.0) }
    }

    fn rectum(&self, [x, y, z]: [f64; 3]) -> Option<BodyPart> {
        if !(-60.0..=85.0).contains(&z) {
            return None;
        }
        // Along the sacrum: it leaves the prostate backwards above, and bends to a side.
        let up = ((z - 5.0) / 70.0).max(-1.0);
        let centre = [
            self.rectum_bend_mm[0] * libm::sin(core::f64::consts::PI * up),
            self.rectum_y_mm + self.rectum_bend_mm[1] * up.max(0.0) * up.max(0.0),
        ];
        let radius = self.rectum_radius_mm * (1.0 - 0.25 * (-up).max(0.0) + 0.1 * libm::sin(5.0 * up));
        let inner = [x - centre[0], y - centre[1]];
        let from_axis = libm::sqrt(inner[0] * inner[0] + inner[1] * inner[1]);
        if from_axis > radius {
            None
        } else if from_axis > radius - 3.5 {
            Some(BodyPart::RectumWall)
        } else if self.gas.level([inner[0], inner[1], z]) <= 1.0 {
            Some(BodyPart::Gas)
        } else {
            Some(BodyPart::Stool)
        }
    }

    fn hip(&self, side: f64) -> [f64; 3] {
        [side * self.hip_mm[0], self.hip_mm[1], self.hip_mm[2]]
    }

    /// Whether a place is in the implant of a side: a ball in the socket, and a stem down the thigh.
    pub fn implant(&self, side: f64, point_mm: [f64; 3]) -> bool {
        let head = self.hip(side);
        let out = |x: f64, y: f64, z: f64| [head[0] + side * x, head[1] + y, head[2] + z];
        let ball = distance(point_mm, head) - 0.9 * self.hip_radius_mm;
        let neck = from_rod(point_mm, head, out(40.0, 6.0, -28.0)) - 8.0;
        let stem = from_rod(point_mm, out(40.0, 6.0, -28.0), out(38.0, 4.0, -140.0)) - 8.0;
        ball.min(neck).min(stem) <= 0.0
    }

    fn bone(&self, point_mm: [f64; 3]) -> Option<BodyPart> {
        let side = if point_mm[0] < 0.0 { -1.0 } else { 1.0 };
        let head = self.hip(side);
        let r = self.hip_radius_mm;
        // Below zero is inside; the least of all is how deep.
        let out = |x: f64, y: f64, z: f64| [head[0] + side * x, head[1] + y, head[2] + z];
        let femur = (distance(point_mm, head) - r)
            .min(from_rod(point_mm, head, out(44.0, 6.0, -32.0)) - 0.62 * r)
            .min(from_rod(point_mm, out(46.0, 6.0, -28.0), out(38.0, 4.0, -140.0)) - 15.0)
            .min(distance(point_mm, out(52.0, 12.0, -22.0)) - 17.0);
        if femur <= 0.0 {
            return Some(shell(femur, 3.5));
        }
        // The socket embraces the head from within and above; a gap of cartilage lies between.
        let from_head = distance(point_mm, head);
        let within = side * (point_mm[0] - head[0]) < 0.35 * r;
        let socket = match within && point_mm[2] - head[2] > -0.75 * r {
            true => (from_head - (r + 15.0)).max(r + 3.0 - from_head),
            false => f64::INFINITY,
        };
        let mirror = [side * point_mm[0], point_mm[1], point_mm[2]];
        let pubis = from_rod(
            mirror,
            [8.0, -44.0, -18.0],
            [self.hip_mm[0] - 16.0, self.hip_mm[1] - 14.0, self.hip_mm[2] - 4.0],
        ) - 9.0;
        let ischium = from_rod(
            mirror,
            [self.hip_mm[0] - 14.0, self.hip_mm[1] + 24.0, self.hip_mm[2] - 14.0],
            [52.0, 36.0, -70.0],
        ) - 13.0;
        let ilium = from_rod(
            mirror,
            [self.hip_mm[0] + 2.0, self.hip_mm[1] + 16.0, self.hip_mm[2] + 36.0],
            [92.0, 46.0, 110.0],
        ) - 13.0;
        // The sacrum bends forward to the coccyx.
        let back = self.sacrum_y_mm();
        let sacrum = (from_rod(mirror, [0.0, back, 34.0], [0.0, back - 4.0, 110.0]) - 17.0)
            .min(from_rod(mirror, [20.0, back, 55.0], [44.0, back - 6.0, 110.0]) - 14.0)
            .min(from_rod(mirror, [0.0, back, 34.0], [0.0, back - 6.0, 4.0]) - 7.0);
        let bone = socket.min(pubis).min(ischium).min(ilium).min(sacrum);
        (bone <= 0.0).then(|| shell(bone, 3.0))
    }

    /// The middle of the sacrum: behind the rectum, within the back.
    fn sacrum_y_mm(&self) -> f64 {
        (self.rectum_y_mm + self.rectum_bend_mm[1] + self.rectum_radius_mm + 12.0)
            .min(0.94 * self.body_mm[1] - 30.0)
    }
}

fn shell(depth: f64, thickness: f64) -> BodyPart {
    if depth > -thickness { BodyPart::Cortex } else { BodyPart::Marrow }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    libm::sqrt((0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum())
}

/// Distance from the line between two points.
fn from_rod(point: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let along = |p: [f64; 3]| (0..3).map(|axis| (p[axis] - a[axis]) * (b[axis] - a[axis])).sum::<f64>();
    let t = (along(point) / along(b)).clamp(0.0, 1.0);
    distance(point, [0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis])))
}
