//! The head of the rigs, known from its CT, seen from anywhere near the planned place.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_patient::case::{Case, HEAD_SPACING_MM, Skin, head};
use stillpoint_patient::outline::{PatientSurface, Placing, outline};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::NoiseModel;
use stillpoint_rig::patient::view::{KINECT_V1, KINECT_V2, Kind, STRUCTURED, look};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::{Label, Scene};
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_samples::{Pose, PoseReport, PoseStatus};
use stillpoint_testing::{Run, run};
use stillpoint_track::planned::{Foreign, Limits, Planned, Registered};
use stillpoint_track::surface::SurfaceParams;

pub const SURFACE: SurfaceParams = SurfaceParams { spacing: 0.004, smoothing: 0.008 };
/// Corners of the region about the isocentre, m.
pub const LEAST: [f64; 3] = [-0.15; 3];
pub const GREATEST: [f64; 3] = [0.15; 3];

pub type Random = chacha20::ChaCha8Rng;

fn case_of(skin: &Head) -> Case {
    let (least, greatest) = skin.extent();
    let depth_mm = |at: [f64; 3]| 1e3 * skin.depth(at.map(|c| 1e-3 * c));
    let extent_mm = [least, greatest].map(|corner| (corner * 1e3).into());
    head(&Skin { depth_mm: &depth_mm, extent_mm }, 0, HEAD_SPACING_MM).unwrap()
}

fn surface_of(case: &Case) -> PatientSurface {
    let placing = Placing { isocentre_mm: case.isocentre_mm(), position: case.position() };
    PatientSurface { mesh: outline(case).unwrap(), placing }
}

/// The isocentre in the head's frame, m.
fn isocentre(case: &Case) -> Vector3<f64> {
    let [x, y, z] = case.isocentre_mm();
    Vector3::new(x, z, -y) * 1e-3
}

#[test]
fn the_outline_of_the_ct_is_the_skin_of_the_rigs_head() {
    let skin = Head::new(1.0).unwrap();
    let mesh = outline(&case_of(&skin)).unwrap();
    let off: Vec<f64> =
        mesh.vertices_mm.iter().map(|[x, y, z]| 1e3 * skin.depth([1e-3 * x, 1e-3 * z, -1e-3 * y])).collect();
    let n = off.len() as f64;
    let (mean, rms) = (off.iter().sum::<f64>() / n, (off.iter().map(|d| d * d).sum::<f64>() / n).sqrt());
    eprintln!("{n} vertices: mean {mean:.3} mm, RMS {rms:.3} mm");
    // The creases where parts of the head meet are rounder in the CT.
    assert!(mean.abs() < 0.05 && rms < 0.3, "{mean} {rms}");
}

/// A head whose parts were moved and stretched by chance, by about `amount`.
pub fn drawn(head: &Head, rng: &mut Random, amount: f64) -> Head {
    let mut part = |p: &Ellipsoid| {
        let mut within = |most: f64| rng.random_range(-most..most);
        let semi = p.semi_axes().map(|a| a * (1.0 + within(amount)));
        let shift = Translation3::new(within(0.05 * amount), within(0.05 * amount), within(0.05 * amount));
        Ellipsoid::new(shift * p.parent_from_shape(), semi).unwrap()
    };
    Head::of(head.parts().iter().map(&mut part).collect())
}

/// What a camera measures of a head on a couch, in its frame.
fn seen(
    head: &Head,
    kind: Kind,
    couch_from_camera: &Isometry3<f64>,
    pose: &Isometry3<f64>,
    rng: &mut Random,
) -> Vec<Vector3<f64>> {
    let camera = kind.pinhole().unwrap();
    let nothing = Scene::new(Vec::new(), -100.0);
    let mut renderer = Renderer::new(camera, couch_from_camera, &nothing, head.clone()).unwrap();
    let view = renderer.render(pose).unwrap().clone();
    let mut depth = vec![0; camera.pixels()];
    DepthSensor::new(&camera, NoiseModel::new((kind.noise)()).unwrap())
        .sense(&view, rng, &mut depth)
        .unwrap();
    let points = (0..camera.pixels()).filter(|i| view.label()[*i] == Label::Head as u8 && depth[*i] > 0);
    // What hangs over is not seen by the segmentation: the neck below the chin.
    let head_from_camera = pose.inverse() * couch_from_camera;
    let points = points
        .map(|i| camera.direction(i % camera.width(), i / camera.width()) * (f64::from(depth[i]) * 1e-4));
    points.filter(|p| (head_from_camera * Point3::from(*p)).y > -0.11).collect()
}

struct Trial {
    error: Option<[f64; 2]>,
    result: Result<Registered, Foreign>,
}

/// One head against the CT of another: `own` and `shown`, from a start drawn by chance.
fn trial(
    planned_surface: &PatientSurface,
    isocentre: &Vector3<f64>,
    shown: &Head,
    kind: Kind,
    rng: &mut Random,
) -> Trial {
    let mut unit = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64)).normalize();
    let (aside, about, from) = (unit(), unit(), unit());
    let rest = Isometry3::translation(0.0, -0.02, 0.131);
    let (far, angle) = (rng.random_range(0.0..0.15), rng.random_range(0.0..40.0_f64).to_radians());
    let turn = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(about), angle);
    // About the isocentre.
    let place = rest * Point3::from(*isocentre);
    let planned = rest * Translation3::from(*isocentre);
    let couch_from_iso = Isometry3::from_parts(Translation3::from(place.coords + far * aside), turn);
    let pose = couch_from_iso * Translation3::from(-isocentre);
    let near = ((kind.noise)().near + 0.2).max(0.75);
    let at = place.coords + near * Vector3::new(0.4 * from.x, -0.5 + 0.3 * from.y, 0.75).normalize();
    let couch_from_camera = look(at, place.coords, 0.0);
    let cloud = seen(shown, kind, &couch_from_camera, &pose, rng);
    let points = planned_surface.about_isocentre(LEAST, GREATEST);
    let camera_from_planned = couch_from_camera.inverse() * planned;
    let known =
        Planned::new(&points, [LEAST, GREATEST], camera_from_planned, SURFACE, Limits::default()).unwrap();
    let result = known.register(&cloud);
    let error = result.as_ref().ok().map(|found| {
        let found = couch_from_camera * found.camera_from_model;
        let shift = (found * Point3::origin() - couch_from_iso * Point3::origin()).norm();
        [1e3 * shift, found.rotation.angle_to(&couch_from_iso.rotation).to_degrees()]
    });
    Trial { error, result }
}

fn count(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default)
}

const KINDS: [Kind; 3] = [STRUCTURED, KINECT_V1, KINECT_V2];

/// `STILLPOINT_STARTS=1000` draws more, `STILLPOINT_SEED` others.
#[test]
fn the_head_is_registered_from_starts_within_150_mm_and_40_degrees() {
    let skin = Head::new(1.0).unwrap();
    let case = case_of(&skin);
    let surface = surface_of(&case);
    let starts = count("STILLPOINT_STARTS", 6);
    let mut rng = Random::seed_from_u64(count("STILLPOINT_SEED", 4_000) as u64);
    let (mut good, mut wrong) = (0, 0);
    for number in 0..starts {
        let kind = KINDS[number % KINDS.len()];
        let Trial { error, result } = trial(&surface, &isocentre(&case), &skin, kind, &mut rng);
        match (&error, &result) {
            (Some([mm, degrees]), Ok(found)) => {
                eprintln!("{number:3} {:10} {mm:.3} mm {degrees:.3} deg {:?}", kind.name, found.fit);
                *if *mm <= 0.5 && *degrees <= 0.3 { &mut good } else { &mut wrong } += 1;
            }
            (_, Err(why)) => eprintln!("{number:3} {:10} refused: {why} {:?}", kind.name, why.fit()),
            _ => {}
        }
    }
    eprintln!("{good} of {starts} registered within 0.5 mm and 0.3 degrees, {wrong} beyond");
    assert!(good as f64 >= (0.95 * starts as f64).floor(), "{good} of {starts}");
    assert_eq!(wrong, 0);
}

/// `STILLPOINT_FOREIGN=200` draws more, `STILLPOINT_SEED` others.
#[test]
fn a_foreign_head_is_refused() {
    let skin = Head::new(1.0).unwrap();
    let case = case_of(&skin);
    let surface = surface_of(&case);
    let heads = count("STILLPOINT_FOREIGN", 4);
    let mut rng = Random::seed_from_u64(1_000 + count("STILLPOINT_SEED", 4_000) as u64);
    let (mut foreign, mut accepted) = (0, 0);
    let mut number = 0;
    while foreign < heads {
        let amount = rng.random_range(0.02..0.2);
        let other = drawn(&skin, &mut rng, amount);
        let differs = difference(&surface, &other);
        number += 1;
        if differs < 2.0 {
            continue;
        }
        foreign += 1;
        let kind = KINDS[number % KINDS.len()];
        let Trial { result, .. } = trial(&surface, &isocentre(&case), &other, kind, &mut rng);
        match &result {
            Ok(found) => {
                accepted += 1;
                eprintln!("{number:3} {:10} {differs:.2} mm ACCEPTED {:?}", kind.name, found.fit);
            }
            Err(why) => eprintln!("{number:3} {:10} {differs:.2} mm: {why}", kind.name),
        }
    }
    eprintln!("{accepted} of {foreign} foreign heads accepted");
    assert_eq!(accepted, 0);
}

/// RMS distance of the skin of a head (above the chin) from the surface, mm, in the pose in which it is least: by turns of
/// least squares from the same pose.
pub fn difference(surface: &PatientSurface, other: &Head) -> f64 {
    let isocentre = Vector3::from(surface.placing.isocentre_mm);
    let iso = Vector3::new(isocentre.x, isocentre.z, -isocentre.y) * 1e-3;
    let points: Vec<(Vector3<f64>, Vector3<f64>)> = surface
        .about_isocentre(LEAST, GREATEST)
        .into_iter()
        .step_by(40)
        .filter(|(at, _)| (at + iso).y > -0.10)
        .collect();
    // Depth of a point of the surface below the other's skin, and how it changes with a small movement.
    let mut pose = Isometry3::identity();
    let mut rms = f64::INFINITY;
    for _ in 0..8 {
        let (mut a, mut b, mut squares) = (nalgebra::Matrix6::zeros(), nalgebra::Vector6::zeros(), 0.0);
        for (at, normal) in &points {
            let moved = (pose * Point3::from(*at)).coords;
            let depth = other.depth((moved + iso).into());
            let out = pose.rotation * normal;
            let turn = moved.cross(&out);
            let row = nalgebra::Vector6::new(out.x, out.y, out.z, turn.x, turn.y, turn.z);
            // Moving outwards makes it less deep.
            a += row * row.transpose();
            b += row * depth;
            squares += depth * depth;
        }
        rms = 1e3 * (squares / points.len() as f64).sqrt();
        let Some(step) = a.cholesky().map(|c| c.solve(&b)) else { break };
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
        pose = Isometry3::from_parts(Translation3::new(step[0], step[1], step[2]), turn) * pose;
    }
    rms
}

/// A camera over the rig's head at rest, whose reference is the surface of a case.
fn run_with(case: &Case, isocentre: &Vector3<f64>) -> Run {
    let [x, y, z]: [f64; 3] = (*isocentre).into();
    let text = format!(
        "
stillpoint: 1
name: planned
seed: 3
frames:
  camera: {{ parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] }}
operators:
  rig: {{ use: rig.camera, every: 100 ms, frame: camera, params: {{ motion: nods }} }}
  cloud: {{ use: ingest.depth, inputs: {{ image: rig.depth }}, frame: camera }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }}, params: {{ body: waived }} }}
  head: {{ use: track.head, inputs: {{ face: face.face }}, frame: couch, params: {{ reference: {{ surface: head.case, isocentre: [{x} m, {y} m, {z} m] }} }} }}
"
    );
    let mut files = MemoryFiles::default();
    files.files.insert("head.case".into(), stillpoint_patient::case::to_bytes(case).unwrap().0);
    let registry = Registry::new(&[
        stillpoint_rig::STAGES,
        stillpoint_ingest::STAGES,
        stillpoint_segment::STAGES,
        stillpoint_track::STAGES,
    ]);
    let run = run(&text, &registry, &files, 1000).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    run
}

fn pose(element: &stillpoint_samples::PoseElement) -> Isometry3<f64> {
    stillpoint_pose::isometry(element.position, element.orientation)
}

/// Statuses of the frames.
fn statuses(run: &Run) -> Vec<PoseStatus> {
    let reports = run.samples::<PoseReport>("head.report");
    reports.iter().filter_map(|r| PoseStatus::from_number(r.first()?.status)).collect()
}

#[test]
fn the_first_pose_against_the_planning_ct_is_the_error_of_the_set_up_at_the_isocentre() {
    let case = case_of(&Head::new(1.0).unwrap());
    let iso = isocentre(&case);
    // The plan wants the isocentre 7 mm from where the head at rest has it.
    let rest = Vector3::new(0.0, -0.02, 0.131);
    let requested = rest + iso + Vector3::new(0.004, -0.003, 0.005);
    let run = run_with(&case, &requested);
    let seen = statuses(&run);
    let first = run.samples::<PoseReport>("head.report");
    let first = first[0].first().unwrap();
    assert_eq!(seen[0], PoseStatus::Captured, "{seen:?} {first:?}");
    assert!(seen[1..].iter().all(|s| *s == PoseStatus::Tracked), "{seen:?}");
    let truths = run.samples::<Pose>("rig.truth");
    let poses = run.samples::<Pose>("head.pose");
    assert_eq!(poses.len(), seen.len());
    for sample in &poses {
        let truth = truths.iter().find(|t| t.header.stamp == sample.header.origin).unwrap();
        let truth = pose(truth.first().unwrap()) * Translation3::from(iso);
        let element = sample.first().unwrap();
        let found = pose(element);
        let mm = 1e3 * (found.translation.vector - truth.translation.vector).norm();
        let degrees = found.rotation.angle_to(&truth.rotation).to_degrees();
        assert!(mm < 0.5 && degrees < 0.3, "{mm} mm, {degrees} degrees");
        let set_up = found.translation.vector - requested;
        assert!((set_up.norm() - 7e-3).abs() < 2e-3, "{set_up}");
        assert!((0..6).all(|i| element.covariance[7 * i] > 0.0 && element.covariance[7 * i] < 1e-6));
    }
}

#[test]
fn a_capture_of_another_patient_is_refused_with_its_numbers() {
    let mut rng = Random::seed_from_u64(6_000);
    let other = drawn(&Head::new(1.0).unwrap(), &mut rng, 0.15);
    let case = case_of(&other);
    let run = run_with(&case, &(Vector3::new(0.0, -0.02, 0.131) + isocentre(&case)));
    assert!(statuses(&run).iter().all(|s| *s == PoseStatus::CaptureRefused), "{:?}", statuses(&run));
    assert!(run.samples::<Pose>("head.pose").is_empty());
    let reports = run.samples::<PoseReport>("head.report");
    let last = reports.last().unwrap().first().unwrap();
    assert!(last.residual_rms > 0.8e-3 || last.overlap < 0.8, "{last:?}");
}
