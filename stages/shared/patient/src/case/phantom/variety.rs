//! Pelves that differ in what decides the beams: size, site and shape of the target, its side, nearby organs, and implants.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use super::anatomy::Ellipsoid;

/// A stream of its own, beside those of the anatomy and of the texture.
const STREAM: u64 = 2;

/// Where the target of a varied pelvis lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// The prostate.
    Prostate,
    /// The prostate with the seminal vesicles.
    Vesicles,
    /// Lymph nodes at the wall of the pelvis, on one side.
    Nodes,
    /// A part of the bladder, on one side.
    Bladder,
    /// In front of the sacrum, around the rectum.
    Presacral,
}

impl Site {
    /// The word for people.
    pub fn word(self) -> &'static str {
        match self {
            Self::Prostate => "prostate",
            Self::Vesicles => "prostate and seminal vesicles",
            Self::Nodes => "nodes at the pelvic wall",
            Self::Bladder => "part of the bladder",
            Self::Presacral => "presacral space",
        }
    }
}

/// What a seed draws beyond the ordinary sizes.
#[derive(Clone, Debug)]
pub struct Variety {
    /// Factors of the body's half width and half depth.
    pub body: [f64; 2],
    /// Factor of the fat under the skin.
    pub fat: f64,
    /// Factors of the prostate, the bladder, and the rectum's radius.
    pub organs: [f64; 3],
    /// Where the target lies.
    pub site: Site,
    /// The side of a target that has one: 1 left, -1 right.
    pub side: f64,
    /// Place and size of a target beyond the prostate: six numbers from 0 to 1.
    pub shape: [f64; 6],
    /// Sides with a hip implant.
    pub implants: Vec<f64>,
    /// A loop of bowel near the target.
    pub bowel: Option<Ellipsoid>,
}

impl Variety {
    /// The variety of this seed.
    pub fn of_seed(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(STREAM);
        let mut between = |low: f64, high: f64| {
            let unit = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            low + (high - low) * unit
        };
        let body = [between(0.88, 1.12), between(0.88, 1.12)];
        let fat = between(0.5, 1.4);
        let organs = [between(0.8, 1.3), between(0.65, 1.2), between(0.85, 1.25)];
        let site = match between(0.0, 1.0) {
            u if u < 0.3 => Site::Prostate,
            u if u < 0.5 => Site::Vesicles,
            u if u < 0.7 => Site::Nodes,
            u if u < 0.85 => Site::Bladder,
            _ => Site::Presacral,
        };
        let side = if between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
        let shape = [0.0; 6].map(|_| between(0.0, 1.0));
        let implants = [1.0, -1.0].into_iter().filter(|_| between(0.0, 1.0) < 0.15).collect();
        let loops = Ellipsoid {
            centre_mm: [between(-40.0, 40.0), between(-45.0, -10.0), between(35.0, 65.0)],
            radii_mm: [between(24.0, 48.0), between(18.0, 34.0), between(18.0, 32.0)],
        };
        let bowel = (between(0.0, 1.0) < 0.5).then_some(loops);
        Self { body, fat, organs, site, side, shape, implants, bowel }
    }

    /// The parts of the target beyond the prostate.
    pub fn target(&self, prostate: &Ellipsoid, bladder: &Ellipsoid, rectum_y_mm: f64) -> Vec<Ellipsoid> {
        let at = |place: usize, low: f64, high: f64| low + (high - low) * self.shape[place];
        let side = self.side;
        match self.site {
            Site::Prostate => Vec::new(),
            Site::Vesicles => [1.0, -1.0]
                .map(|of| Ellipsoid {
                    centre_mm: [
                        prostate.centre_mm[0] + of * at(0, 12.0, 18.0),
                        prostate.centre_mm[1] + 0.6 * prostate.radii_mm[1],
                        prostate.radii_mm[2] + at(1, -4.0, 4.0),
                    ],
                    radii_mm: [at(2, 12.0, 20.0), at(3, 6.0, 10.0), at(4, 8.0, 14.0)],
                })
                .to_vec(),
            Site::Nodes => vec![Ellipsoid {
                centre_mm: [side * at(0, 46.0, 66.0), at(1, -20.0, 18.0), at(2, 10.0, 50.0)],
                radii_mm: [at(3, 11.0, 22.0), at(4, 14.0, 30.0), at(5, 18.0, 36.0)],
            }],
            Site::Bladder => vec![Ellipsoid {
                centre_mm: [
                    bladder.centre_mm[0] + side * at(0, 0.4, 0.8) * bladder.radii_mm[0],
                    bladder.centre_mm[1] + at(1, -0.6, 0.6) * bladder.radii_mm[1],
                    bladder.centre_mm[2] + at(2, -0.4, 0.4) * bladder.radii_mm[2],
                ],
                radii_mm: [at(3, 14.0, 26.0), at(4, 14.0, 26.0), at(5, 14.0, 26.0)],
            }],
            Site::Presacral => vec![Ellipsoid {
                centre_mm: [side * at(0, 0.0, 18.0), rectum_y_mm + at(1, -4.0, 8.0), at(2, 0.0, 45.0)],
                radii_mm: [at(3, 18.0, 40.0), at(4, 10.0, 18.0), at(5, 18.0, 36.0)],
            }],
        }
    }
}
