//! Writes the small recordings of `examples/data`: the project's own head, seen by the project's own camera.
//!
//! `cargo run --release -p stillpoint-tests --example make_data`

use std::collections::BTreeMap;
use std::error::Error;
use std::io::BufWriter;
use std::path::Path;

use stillpoint_ingest::pcd::write_binary;
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_recorder::{Closing, Compression, Opening, PartWriter, Role, RosMessage, TopicInfo};
use stillpoint_samples::{DepthImage, HEADER_SIZE, Intrinsics, Pieces, PointCloud, Sample};
use stillpoint_testing::run;
use zerocopy::IntoBytes;

const TEXT: &str = "
stillpoint: 1
name: make-data
seed: 7
frames: { camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] } }
operators:
  rig: { use: rig.camera, every: 2 s, frame: camera, params: { motion: sweep, width: 320 px, height: 240 px, focal_length: 283 px } }
  cloud: { use: ingest.depth, inputs: { image: rig.depth }, frame: camera }
  far: { use: rig.camera, every: 2 s, frame: camera, params: { motion: sweep, width: 192 px, height: 144 px, focal_length: 170 px } }
  coarse: { use: ingest.depth, inputs: { image: far.depth }, frame: camera }
";

/// A camera of ROS 2: depth in whole millimetres, 16 frames at 10 Hz.
const CAMERA: &str = "
stillpoint: 1
name: make-camera
seed: 7
frames: { camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] } }
operators:
  rig: { use: rig.camera, every: 100 ms, frame: camera, params: { motion: sweep, noise: structured_light, width: 192 px, height: 144 px, focal_length: 170 px } }
";
const IMAGES: (&str, RosMessage) = ("/camera/depth/image_raw", RosMessage::Image);
const INFOS: (&str, RosMessage) = ("/camera/depth/camera_info", RosMessage::CameraInfo);

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/data"));
    let registry = Registry::new(&[stillpoint_rig::STAGES, stillpoint_ingest::STAGES]);
    let run = run(TEXT, &registry, &MemoryFiles::default(), 12_000)?;
    std::fs::create_dir_all(folder.join("depth"))?;
    std::fs::create_dir_all(folder.join("grey"))?;
    std::fs::create_dir_all(folder.join("clouds"))?;
    for (number, image) in run.samples::<DepthImage>("rig.depth").iter().enumerate() {
        let file = std::fs::File::create(folder.join(format!("depth/{number:03}.png")))?;
        let mut encoder = png::Encoder::new(file, image.body.width, image.body.height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_compression(png::Compression::High);
        let bytes: Vec<u8> = image.elements.iter().flat_map(|count| count.to_be_bytes()).collect();
        encoder.write_header()?.write_image_data(&bytes)?;
        let file = std::fs::File::create(folder.join(format!("grey/{number:03}.png")))?;
        let mut encoder = png::Encoder::new(file, image.body.width, image.body.height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_compression(png::Compression::High);
        encoder.write_header()?.write_image_data(&shaded(image.elements, image.body.width as usize))?;
    }
    let clouds = run.samples::<PointCloud>("coarse.cloud");
    for (number, cloud) in clouds.iter().take(2).enumerate() {
        let points: Vec<[f32; 3]> = cloud.elements.iter().map(|p| p.xyz).collect();
        std::fs::write(
            folder.join(format!("clouds/{number:03}.pcd")),
            write_binary(&points, cloud.body.width as usize),
        )?;
    }
    record(&run, &folder.join("clouds.mcap"))?;
    let run = stillpoint_testing::run(CAMERA, &registry, &MemoryFiles::default(), 1_550)?;
    record_camera(&run, &folder.join("camera.mcap"))
}

/// What a lamp at the camera makes of a depth image in counts of 0.1 mm: bright where the surface faces it.
fn shaded(counts: &[u16], width: usize) -> Vec<u8> {
    let slope = |count: u16, next: Option<&u16>| match next {
        // A pixel is as wide as its depth over the focal length.
        Some(&next) if count > 0 && next > 0 => {
            (f64::from(next) - f64::from(count)) * 283.0 / f64::from(count)
        }
        _ => f64::INFINITY,
    };
    let shade = |(at, &count): (usize, &u16)| {
        let (x, y) = (slope(count, counts.get(at + 1)), slope(count, counts.get(at + width)));
        (230.0 / (1.0 + x * x + y * y).sqrt()) as u8
    };
    counts.iter().enumerate().map(shade).collect()
}

/// Records three clouds as any session does: a topic of `sensor_msgs/msg/PointCloud2`.
fn record(run: &stillpoint_testing::Run, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut part = PartWriter::new(std::fs::File::create(path)?, Compression::Zstd, &Opening::default())?;
    let topic = part.add_topic(TopicInfo {
        name: "coarse.cloud".to_string(),
        operator: "coarse".to_string(),
        kind: PointCloud::KIND,
        frame: Some("camera".to_string()),
        role: Role::Source,
    })?;
    for owned in run.owned_samples("coarse.cloud").take(3) {
        part.write(topic, owned.pieces(), owned.header().stamp)?;
    }
    part.finish(&Closing::default())?;
    Ok(())
}

/// Records depth images as `ros2 bag record` does, with counts of 1 mm.
fn record_camera(run: &stillpoint_testing::Run, path: &Path) -> Result<(), Box<dyn Error>> {
    let options = mcap::WriteOptions::new().profile("ros2").compression(Some(mcap::Compression::Zstd));
    let mut writer = options.create(BufWriter::new(std::fs::File::create(path)?))?;
    for (number, owned) in run.owned_samples("rig.depth").enumerate() {
        let image = owned.pieces().view::<DepthImage>()?;
        let counts: Vec<u16> = image
            .elements
            .iter()
            .map(|c| (f64::from(*c) * image.body.depth_unit * 1e3).round() as u16)
            .collect();
        let body = Intrinsics { depth_unit: 1e-3, ..*image.body };
        let meta = [&owned.pieces().meta[..HEADER_SIZE], body.as_bytes()].concat();
        let sample = Pieces { meta: &meta, payload: counts.as_bytes() };
        for (topic, message) in [INFOS, IMAGES] {
            let (name, text) = message.schema();
            let schema = writer.add_schema(name, "ros2msg", text.as_bytes())?;
            let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
            let mut data = Vec::new();
            if !message.encode(DepthImage::KIND, &sample, "camera_depth_optical_frame", "", &mut data) {
                return Err("a frame is not a message".into());
            }
            let time = owned.header().stamp;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: number as u32,
                log_time: time,
                publish_time: time,
            };
            writer.write_to_known_channel(&header, &data)?;
        }
    }
    writer.finish()?;
    Ok(())
}
