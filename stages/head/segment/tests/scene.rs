//! Frames of scenes of the virtual rig, with the label of each pixel.

#![allow(clippy::unwrap_used)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::Isometry3;
use stillpoint_ingest::depth::{Intrinsics, deproject};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::NoiseModel;
pub use stillpoint_rig::patient::view::{KINECT_V1, KINECT_V2, Kind, STRUCTURED};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::{Label, Scene};
use stillpoint_rig::sensor::DepthSensor;

/// What a camera measured, and which pixels are the head's.
pub struct Frame {
    pub cloud: Vec<[f32; 3]>,
    pub width: usize,
    pub head: Vec<bool>,
}

impl Frame {
    /// What a camera at `couch_from_camera` sees of a scene with a head of this scale at `couch_from_head`.
    pub fn of(
        kind: &Kind,
        couch_from_camera: &Isometry3<f64>,
        scene: &Scene,
        scale: f64,
        couch_from_head: &Isometry3<f64>,
        seed: u64,
    ) -> Self {
        Self::of_head(kind, couch_from_camera, scene, Head::new(scale).unwrap(), couch_from_head, seed)
    }

    /// The same of a head of one's own.
    pub fn of_head(
        kind: &Kind,
        couch_from_camera: &Isometry3<f64>,
        scene: &Scene,
        head: Head,
        couch_from_head: &Isometry3<f64>,
        seed: u64,
    ) -> Self {
        let [width, height] = kind.size;
        let (cx, cy) = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
        let pinhole = kind.pinhole().unwrap();
        let mut renderer = Renderer::new(pinhole, couch_from_camera, scene, head).unwrap();
        let view = renderer.render(couch_from_head).unwrap();
        let mut depth = vec![0; pinhole.pixels()];
        let mut sensor = DepthSensor::new(&pinhole, NoiseModel::new((kind.noise)()).unwrap());
        sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(seed), &mut depth).unwrap();
        let intrinsics = Intrinsics { fx: kind.focal, fy: kind.focal, cx, cy, metres_per_count: 1e-4 };
        let mut cloud = vec![[0.0; 3]; depth.len()];
        deproject(&depth, width, height, &intrinsics, &mut cloud).unwrap();
        let head = view.label().iter().map(|&label| label == Label::Head as u8).collect();
        Self { cloud, width, head }
    }

    /// Intersection over union of the face's pixels and those of the head that were measured.
    pub fn iou(&self, face: &[u32]) -> f64 {
        let mut in_face = vec![false; self.cloud.len()];
        for &i in face {
            in_face[i as usize] = true;
        }
        let (mut both, mut either) = (0.0, 0.0);
        for i in (0..in_face.len()).filter(|&i| self.cloud[i][2].is_finite()) {
            both += f64::from(u8::from(self.head[i] && in_face[i]));
            either += f64::from(u8::from(self.head[i] || in_face[i]));
        }
        both / either
    }
}
