//! The texts of new pipelines: the default pipeline and an example with other names, and a reader of recordings.

use std::path::Path;

use serde_json::Value;

use crate::exit::Failure;
use crate::pipeline_file::EMBEDDED;

/// Name of the key, next to the pipeline.
pub const KEY: &str = "rig.key";

const READING: &str = include_str!("reading.yaml");
const CAMERA: &str = include_str!("../../../../../examples/ros2-camera.yaml");

/// How each kind of file is read.
const IMAGES: &str = "  # One image per tick, in the order of the names: `every` is the period of your camera. `camera` is its calibration:
  # focal lengths and principal point in pixels, and the depth of one count (1 mm for most depth cameras).
  cloud:
    use: ingest.depth
    every: 100 ms
    frame: camera
    params: { files: FILES, camera: { fx: 283 px, fy: 283 px, cx: 159.5 px, cy: 119.5 px, depth_unit: 0.1 mm } }
";
const CLOUDS: &str = "  # One cloud per tick, in the order of the names: `every` is the period of your camera. `unit` is that of coordinates.
  cloud: { use: KIND, every: 100 ms, frame: camera, params: { files: FILES, unit: m } }
";
const BAG: &str = "  # The messages of one topic, at their recorded pace: `every` is at most the shortest time between two of them.
  cloud: { use: ingest.mcap, every: 5 ms, frame: camera, params: { file: FILES, topic: TOPIC, pace: recorded } }
";

/// A pipeline that holds the simulated rig, with its key next to it.
pub fn rig(name: &str) -> String {
    let begin = "# The dissertation's system with three degrees of freedom (section 4.3), closed from camera to valve.";
    let from = EMBEDDED.find(" A simulated rig").unwrap_or(0);
    format!("{begin}{}", &EMBEDDED[from..])
        .replace("name: head-3dof\n", &format!("name: {name}\n"))
        .replace(
            "This key is\n  # public; a rig of your own needs a key of its own (docs/guide/actuation.md).",
            "The key\n  # was drawn for this folder: keep it secret.",
        )
        .replace("examples/data/rig.key", KEY)
}

/// A pipeline that takes depth images from ROS 2.
pub fn camera(name: &str, topic: &str) -> String {
    let begin =
        "# A depth camera that ROS 2 drives: its images become the pose of a head, which ROS 2 gets back.
#
#   ros2 run rmw_zenoh_cpp rmw_zenohd        # the router of ROS 2
#   stillpoint run                           # needs the program stillpoint-bridge
#   stillpoint echo camera.diagnostics       # what came, and what was refused
";
    let from = CAMERA.find("stillpoint: 1\n").unwrap_or(0);
    format!("{begin}{}", &CAMERA[from..])
        .replace("name: ros2-camera\n", &format!("name: {name}\n"))
        .replace(" `recording` is what a run without ROS 2 plays; `ros2 bag record` makes one.", "")
        .replace(", recording: data/camera.mcap", "")
        .replace("topic: /camera/depth/image_raw,", &format!("topic: {},", quoted(topic)))
}

/// A pipeline that reads recorded files.
///
/// # Errors
/// The files are of no kind that a pipeline reads, or a recording has no topic.
pub fn reading(name: &str, files: &Path, topic: Option<&str>) -> Result<String, Failure> {
    let extension = files.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let source = match (extension.as_str(), topic) {
        ("png", None) => IMAGES.to_owned(),
        ("pcd", None) => CLOUDS.replace("KIND", "ingest.pcd"),
        ("ply", None) => CLOUDS.replace("KIND", "ingest.ply"),
        ("mcap", Some(topic)) => BAG.replace("TOPIC", &quoted(topic)),
        ("mcap", None) => {
            let help = "add `--topic TOPIC`; `stillpoint info FILE` lists the topics";
            return Err(Failure::wrong(format!("{}: a recording has many topics: {help}", files.display())));
        }
        ("png" | "pcd" | "ply", Some(_)) => {
            return Err(Failure::wrong(format!(
                "{}: files of this kind have no topics: remove --topic",
                files.display()
            )));
        }
        _ => {
            let allowed = "allowed: files or a pattern that ends in .png, .pcd, .ply or .mcap";
            return Err(Failure::wrong(format!(
                "{}: unknown kind of recording ({allowed})",
                files.display()
            )));
        }
    };
    let source = source.replace("FILES", &quoted(&files.to_string_lossy()));
    Ok(READING.replace("name: NAME\n", &format!("name: {name}\n")).replace("SOURCE\n", &source))
}

/// A text in quotes, as YAML and JSON both read it.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}
