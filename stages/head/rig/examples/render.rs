//! Renders frames of a scripted motion and writes them as pictures to look at.
//!
//! `cargo run --release -p stillpoint-rig --example render -- FOLDER [still|steps|nods|sweep] [SECONDS]`

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use chacha20::ChaCha8Rng;
use nalgebra::Vector3;
use png::{BitDepth, ColorType, Encoder};
use rand::SeedableRng;
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::Scene;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::trajectory::{Motion, Trajectory, rest_on_pad};
use stillpoint_rig::view::RenderedView;

const FRAMES_TIMED: u32 = 300;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("name the folder to write to")?);
    let motion = match arguments.next().as_deref() {
        None | Some("still") => Motion::Still,
        Some("steps") => Motion::Steps,
        Some("nods") => Motion::Nods,
        Some("sweep") => Motion::Sweep,
        Some(other) => return Err(format!("no motion is called {other}").into()),
    };
    let t: f64 = arguments.next().map_or(Ok(0.0), |seconds| seconds.parse())?;
    std::fs::create_dir_all(&folder)?;

    let camera = Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480)?;
    let pose = couch_from_camera(Vector3::new(0.0, -0.48, 0.59), [45f64.to_radians(), 0.0, 0.0]);
    let mut renderer = Renderer::new(camera, &pose, &Scene::treatment_couch()?, Head::new(1.0)?)?;
    let script = Trajectory::new(motion, 7, rest_on_pad());
    let mut depth = vec![0u16; camera.pixels()];

    for (name, params) in [
        ("structured_light", NoiseParams::structured_light()),
        ("kinect_v1", NoiseParams::kinect_v1()),
        ("kinect_v2", NoiseParams::kinect_v2()),
    ] {
        let mut sensor = DepthSensor::new(&camera, NoiseModel::new(params)?);
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let view = renderer.render(&script.couch_from_head(t))?;
        sensor.sense(view, &mut rng, &mut depth)?;
        let bytes: Vec<u8> = depth.iter().flat_map(|value| value.to_be_bytes()).collect();
        write(&folder.join(format!("{name}_depth.png")), &camera, BitDepth::Sixteen, &bytes)?;
        write(
            &folder.join(format!("{name}_shaded.png")),
            &camera,
            BitDepth::Eight,
            &relief(&depth, &camera),
        )?;
        time(name, &mut renderer, &mut sensor, &script, &mut depth)?;
    }
    let view = renderer.render(&script.couch_from_head(t))?;
    write(&folder.join("label.png"), &camera, BitDepth::Eight, view.label())?;
    write(&folder.join("shaded.png"), &camera, BitDepth::Eight, &shade(view))?;
    Ok(())
}

fn time(
    name: &str,
    renderer: &mut Renderer,
    sensor: &mut DepthSensor,
    script: &Trajectory,
    depth: &mut [u16],
) -> Result<(), Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut rendering, mut sensing) = (Vec::new(), Vec::new());
    for frame in 0..FRAMES_TIMED {
        let start = Instant::now();
        let view = renderer.render(&script.couch_from_head(f64::from(frame) * 0.1))?;
        rendering.push(start.elapsed());
        let start = Instant::now();
        sensor.sense(view, &mut rng, depth)?;
        sensing.push(start.elapsed());
    }
    rendering.sort();
    sensing.sort();
    for (quantile, at) in [("least", 0), ("median", FRAMES_TIMED as usize / 2)] {
        eprintln!("{name}: {quantile} render {:?}, sense {:?}", rendering[at], sensing[at]);
    }
    Ok(())
}

/// Brighter where the surface faces the camera, and by label.
fn shade(view: &RenderedView) -> Vec<u8> {
    let of_label = [60.0, 110.0, 150.0, 180.0, 255.0, 200.0];
    let pixels = view.label().iter().zip(view.cosine()).zip(view.depth_m());
    pixels
        .map(
            |((&label, &cosine), &z)| {
                if z.is_finite() { (of_label[usize::from(label)] * cosine * cosine) as u8 } else { 0 }
            },
        )
        .collect()
}

/// Lit from the upper left, from the measured depths alone; black where nothing was measured.
fn relief(depth: &[u16], camera: &Pinhole) -> Vec<u8> {
    let width = camera.width();
    let mut picture = vec![0u8; depth.len()];
    for pixel in 2 * width + 2..depth.len() {
        let (z, left, up) = (depth[pixel], depth[pixel - 2], depth[pixel - 2 * width]);
        if z > 0 && left > 0 && up > 0 {
            let per_pixel = f32::from(z) / camera.fx() as f32 * 2.0;
            let slope = |to: u16| (f32::from(z) - f32::from(to)) / per_pixel;
            let normal = Vector3::new(slope(left), slope(up), -1.0).normalize();
            let light = Vector3::new(0.5, 0.4, -0.77);
            picture[pixel] = (20.0 + 235.0 * normal.dot(&light).max(0.0)) as u8;
        }
    }
    picture
}

fn write(path: &Path, camera: &Pinhole, bits: BitDepth, bytes: &[u8]) -> Result<(), Box<dyn Error>> {
    let mut encoder =
        Encoder::new(BufWriter::new(File::create(path)?), camera.width() as u32, camera.height() as u32);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(bits);
    encoder.write_header()?.write_image_data(bytes)?;
    Ok(())
}
