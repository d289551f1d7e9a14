//! CPU time of a whole frame on one core: from the depth image over cloud, voxels, plane, clusters and head to the dense
//! pose and the check whose it is. By CPU time it can be read on a machine that does other work, too, if with a grain of salt.
//!
//! `cargo bench -p stillpoint-track --bench frame`
//!
//! Where the reference data is there, its rendered sequences are timed, too, and PCL's time for the same
//! frames, as the reference has it, stands beside.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::hint::black_box;
use std::path::{Path, PathBuf};

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::Vector3;
use rustix::time::{ClockId, clock_gettime};
use serde_json::Value;
use stillpoint_ingest::depth::{Intrinsics, decode_png, deproject};
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::setting::Setting;
use stillpoint_rig::trajectory::{Motion, Trajectory};
use stillpoint_samples::Proof;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, SegmentationStep};
use stillpoint_testing::reference;
use stillpoint_track::HeadTracker;
use stillpoint_track::identity::{self, Identity, Needed};

/// Times that each sequence is gone through.
const ROUNDS: usize = 5;
/// Cloud, the steps of the segmentation, pose, identity.
const STEPS: usize = SegmentationStep::NAMES.len() + 3;
/// What a pose needs: as `track.head` by default.
const NEEDED: Needed = Needed { overlap: 0.5, tolerance: 5e-3, may_hide: false };

struct Frame {
    name: String,
    counts: Vec<u16>,
}

struct Sequence {
    name: String,
    width: usize,
    camera: Intrinsics,
    frames: Vec<Frame>,
}

/// CPU time of this thread, ms.
fn now() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// A head that nods in a setting of the rig, 12 frames at 10 Hz.
fn rig(setting: Setting, noise: NoiseParams, name: &str) -> Result<Sequence, Box<dyn Error>> {
    let pinhole = Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480)?;
    let view_from = couch_from_camera(Vector3::new(0.0, -0.48, 0.59), [45_f64.to_radians(), 0.0, 0.0]);
    let mut renderer = Renderer::new(pinhole, &view_from, &setting.scene(1.0)?, Head::new(1.0)?)?;
    let mut sensor = DepthSensor::new(&pinhole, NoiseModel::new(noise)?);
    let script = Trajectory::new(Motion::Nods, 7, setting.rest(1.0));
    let mut frames = Vec::new();
    for number in 0..12_u64 {
        let view = renderer.render(&script.couch_from_head(10.0 + number as f64 * 0.1))?;
        let mut counts = vec![0; pinhole.pixels()];
        sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(number), &mut counts)?;
        frames.push(Frame { name: number.to_string(), counts });
    }
    let camera = Intrinsics { fx: 566.0, fy: 566.0, cx: 319.5, cy: 239.5, metres_per_count: 1e-4 };
    Ok(Sequence { name: format!("rig, {setting:?}, {name}"), width: 640, camera, frames })
}

fn json(path: &Path) -> Result<Value, Box<dyn Error>> {
    Ok(serde_json::from_slice(&std::fs::read(path)?)?)
}

/// A sensor's frames of a rendered sequence.
fn rendered(folder: &Path, sensor: &str) -> Result<Sequence, Box<dyn Error>> {
    let meta = json(&folder.join("meta.json"))?;
    let of = |key: &str| meta["sensors"][sensor][key].as_f64().unwrap_or(f64::NAN);
    let metres_per_count = meta["depth_unit_m"].as_f64().unwrap_or(f64::NAN);
    let camera = Intrinsics { fx: of("fx"), fy: of("fy"), cx: of("cx"), cy: of("cy"), metres_per_count };
    let mut names: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    names.sort();
    let mut frames = Vec::new();
    for path in names {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(sensor) && name.ends_with("_depth.png") {
            frames.push(Frame { name, counts: decode_png(&std::fs::read(&path)?)?.counts });
        }
    }
    let set = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Sequence { name: format!("{set}, {sensor}"), width: of("width") as usize, camera, frames })
}

/// PCL's CPU time from voxels to clusters for a frame of 5 mm voxels, ms.
fn pcl(reference: &Value, frame: &str) -> Option<f64> {
    let is = |r: &&Value| {
        r["input"] == frame && r["method"] == "mlesac" && r["params"]["voxel_leaf_m"].as_f64() == Some(0.005)
    };
    let result = reference["results"].as_array()?.iter().find(is)?;
    result["cpu_ms_median"]["total_voxel_to_cluster"].as_f64()
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}

fn time(sequence: &Sequence, reference: Option<&Value>) -> Result<(), Box<dyn Error>> {
    let mut segmenter = FaceSegmenter::new(FaceParams::default())?;
    let mut tracker = HeadTracker::default();
    let mut identity = None;
    let mut steps: [Vec<f64>; STEPS] = Default::default();
    let (mut wholes, mut to_clusters, mut head) = (Vec::new(), Vec::new(), Vec::new());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut points, mut captured, mut posed) = (Vec::new(), false, 0);
    for round in 0..ROUNDS {
        for (number, frame) in sequence.frames.iter().enumerate() {
            let begin = now();
            points.resize(frame.counts.len(), [0.0; 3]);
            let height = frame.counts.len() / sequence.width;
            deproject(&frame.counts, sequence.width, height, &sequence.camera, &mut points)?;
            let mut last = now();
            let mut spent = [0.0; STEPS];
            spent[0] = last - begin;
            let mut ended = |step: SegmentationStep| {
                let time = now();
                spent[step as usize + 1] += time - last;
                last = time;
            };
            let cloud = Cloud { points: &points, width: sequence.width };
            let face = segmenter.segment_in_steps(cloud, &mut rng, &mut ended).face;
            let before = now();
            head.clear();
            if let Ok(face) = face {
                head.extend(face.iter().map(|&i| Vector3::from(points[i as usize].map(f64::from))));
            }
            let stamp = (round * sequence.frames.len() + number) as u64 * 100_000_000;
            if captured {
                let pose = tracker.track(&head, stamp);
                let tracked = now();
                spent[STEPS - 2] = tracked - before;
                if let (Ok(pose), Some(surface)) = (pose, tracker.surface()) {
                    posed += 1;
                    // A head that is not proven yet takes the longest.
                    let unproven = identity.take().filter(|of: &Identity| of.proof() == Proof::Waiting);
                    let identity = identity.insert(unproven.unwrap_or_else(|| Identity::new(surface, false)));
                    let checked = now();
                    let (alignment, motion) = (&pose.alignment, &pose.current_from_reference);
                    let frame =
                        identity::SeenFrame { cloud: &head, alignment, motion, time: stamp, cameras: 0 };
                    black_box(identity.judge(surface, &frame, &NEEDED));
                    spent[STEPS - 1] = now() - checked;
                }
                wholes.push(tracked - begin + spent[STEPS - 1]);
            } else {
                captured = tracker.capture(&head, stamp).is_ok();
                continue;
            }
            to_clusters.push(
                [
                    SegmentationStep::Voxel,
                    SegmentationStep::Plane,
                    SegmentationStep::Rise,
                    SegmentationStep::Cluster,
                ]
                .map(|s| spent[s as usize + 1])
                .iter()
                .sum::<f64>(),
            );
            steps.iter_mut().zip(spent).for_each(|(times, time)| times.push(time));
        }
    }
    let names =
        ["cloud"].into_iter().chain(SegmentationStep::NAMES.iter().copied()).chain(["pose", "identity"]);
    println!("{}: {posed} poses of {} frames", sequence.name, wholes.len());
    let shown = names.zip(steps.iter_mut()).map(|(name, times)| (name, median(times)));
    for (name, time) in shown.filter(|(_, time)| *time > 0.0) {
        println!("  {name:10} {time:7.2} ms");
    }
    let clusters = median(&mut to_clusters);
    let mut of_pcl: Vec<f64> =
        sequence.frames.iter().filter_map(|frame| pcl(reference?, &frame.name)).collect();
    let lateral = if of_pcl.is_empty() {
        String::new()
    } else {
        let pcl = median(&mut of_pcl);
        format!(", PCL 1.13 {pcl:.1} ms: {:.2} of it", clusters / pcl)
    };
    println!("  voxel to cluster {clusters:.2} ms{lateral}");
    let least = wholes.iter().copied().fold(f64::INFINITY, f64::min);
    println!("  whole frame: median {:.2} ms, least {least:.2} ms", median(&mut wholes));
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    for setting in [Setting::Pads, Setting::Patient] {
        time(&rig(setting, NoiseParams::structured_light(), "structured light")?, None)?;
        time(&rig(setting, NoiseParams::kinect_v1(), "kinect_v1")?, None)?;
    }
    let Some(root) = reference::folder("perception") else { return Ok(()) };
    for set in ["synth_fig411", "synth_random"] {
        let folder = root.join(set);
        let reference = json(&folder.join("pcl_reference.json"))?;
        for sensor in ["n35", "kinect_v1", "kinect_v2"] {
            time(&rendered(&folder, sensor)?, Some(&reference))?;
        }
    }
    Ok(())
}
