//! Couch angles: a beam with a couch angle gives a patient what the beam without one gives the patient who is turned the
//! same way about the vertical axis.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{Anatomy, BeamAngles, DoseCache, DoseEngine, DoseParams, EngineName, Machine};

/// Isocentre, mm from the middle of the image.
const ISOCENTRE_MM: [f64; 3] = [5.0, 0.0, -10.0];
const SPACING_MM: f64 = 5.0;

/// What is at a place of the patient: nothing, tissue, or a block of bone off every axis.
#[derive(Clone, Copy, PartialEq)]
enum At {
    Nothing,
    Tissue,
    Bone,
    Target,
}

fn at([x, y, z]: [f64; 3]) -> At {
    let within = |value: f64, [low, high]: [f64; 2]| (low..high).contains(&value);
    let [a, b, c] = [0, 1, 2].map(|axis| [x, y, z][axis] - ISOCENTRE_MM[axis]);
    if a * a + b * b + c * c < 15.0 * 15.0 {
        At::Target
    } else if within(x, [22.0, 48.0]) && within(y, [-42.0, -8.0]) && within(z, [11.0, 52.0]) {
        At::Bone
    } else if (x / 82.0).powi(2) + (y / 61.0).powi(2) + (z / 93.0).powi(2) < 1.0 {
        At::Tissue
    } else {
        At::Nothing
    }
}

/// Where the couch takes a point, mm (x to the left, z to the head, seen from above against the clock).
fn carried([x, y, z]: [f64; 3], couch_deg: f64) -> [f64; 3] {
    let (sin, cos) = couch_deg.to_radians().sin_cos();
    [x * cos - z * sin, y, x * sin + z * cos]
}

/// The patient on a couch that was turned by this much, in a frame that did not turn with him.
fn engine(turned_deg: f64, engine: EngineName) -> DoseEngine {
    engine_of([44, 32, 44], turned_deg, engine)
}

/// The same in an image of so many voxels.
fn engine_of(counts: [usize; 3], turned_deg: f64, engine: EngineName) -> DoseEngine {
    let origin_mm = counts.map(|n| -0.5 * (n as f64 - 1.0) * SPACING_MM);
    let grid = Grid { counts, spacing_mm: [SPACING_MM; 3], origin_mm };
    let kinds: Vec<At> =
        (0..grid.len()).map(|i| at(carried(grid.centre_mm(grid.voxel(i)), -turned_deg))).collect();
    let hu: Vec<i16> = kinds
        .iter()
        .map(|kind| match kind {
            At::Nothing => -1000,
            At::Bone => 1200,
            At::Tissue | At::Target => 0,
        })
        .collect();
    let mask = |of: fn(At) -> bool| Mask::from_fn(grid.len(), |i| of(kinds[i]));
    let anatomy = Anatomy {
        grid,
        hu: &hu,
        external: &mask(|kind| kind != At::Nothing),
        target: &mask(|kind| kind == At::Target),
        isocentre_mm: carried(ISOCENTRE_MM, turned_deg),
    };
    let params = DoseParams { engine, grid, ..DoseParams::over(&grid, SPACING_MM) };
    DoseEngine::new(&anatomy, Machine::shipped().unwrap(), params).unwrap()
}

/// Dose of an oblong field off the axis, so that no symmetry of the field hides a sign.
fn dose(engine: &DoseEngine, angles: impl Into<BeamAngles>) -> Vec<f32> {
    let bixels_mm = [[-10.0, 0.0], [0.0, 0.0], [10.0, 0.0], [10.0, 10.0]];
    engine.weighted_bixels(angles, &bixels_mm, &[1.0, 2.0, 4.0, 3.0]).unwrap()
}

/// Root of the mean square of the difference at the places of the patient, over the largest dose. The dose of the turned
/// patient is read where the couch takes each place.
fn difference(engine: &DoseEngine, dose: &[f32], turned: &[f32], couch_deg: f64) -> f64 {
    let grid = &engine.params().grid;
    let largest = f64::from(dose.iter().copied().fold(0.0, f32::max));
    let (mut sum, mut count) = (0.0, 0);
    for (voxel, gray) in dose.iter().enumerate() {
        let place = grid.centre_mm(grid.voxel(voxel));
        if at(place) == At::Nothing {
            continue;
        }
        let other = grid.value_at(turned, carried(place, couch_deg));
        sum += (f64::from(other - gray) / largest).powi(2);
        count += 1;
    }
    (sum / f64::from(count)).sqrt()
}

#[test]
fn a_quarter_turn_of_the_couch_is_one_of_the_patient_to_the_bit_nearly() {
    // Superposition divides the axes of its cones about the beam, so it turns with the couch, too.
    for name in EngineName::ALL {
        let still = engine(0.0, name);
        for (couch_deg, gantry_deg) in [(90.0, 40.0), (-90.0, 40.0), (180.0, 310.0)] {
            let turned = engine(couch_deg, name);
            let (expected, found) = (dose(&turned, gantry_deg), dose(&still, [gantry_deg, couch_deg]));
            let off = difference(&still, &found, &expected, couch_deg);
            println!("{name}, gantry {gantry_deg}, couch {couch_deg}: {off:.1e}");
            assert!(off < 2e-4, "{name}, gantry {gantry_deg}, couch {couch_deg}: {off}");
            // The other sign is another dose: the test can tell them apart.
            if couch_deg.abs() < 100.0 {
                let wrong = dose(&still, [gantry_deg, -couch_deg]);
                assert!(difference(&still, &wrong, &expected, couch_deg) > 0.03);
            }
        }
    }
}

/// Without density beyond the last image, such a beam would begin at the cut face: too much dose, and nothing would say so.
#[test]
fn a_beam_that_enters_by_the_end_of_the_images_is_refused_and_other_beams_are_not() {
    for name in EngineName::ALL {
        let cut = engine_of([44, 32, 28], 0.0, name);
        let along = BeamAngles::from([90.0, 90.0]);
        let refused =
            [cut.beam(along).map(|_| ()), cut.weighted_bixels(along, &[[0.0, 0.0]], &[1.0]).map(|_| ())];
        for refused in refused {
            let text = refused.unwrap_err().to_string();
            assert!(text.contains("90@90") && text.contains("by the end of the images"), "{text}");
        }
        assert!(cut.weighted_bixels(along, &[[0.0, 0.0]], &[0.0]).is_ok(), "nothing is delivered");
        // It passes the last image beside the patient, who may be wider beyond it, and enters him from the side.
        assert!(cut.weighted_bixels([90.0, 45.0], &[[0.0, 0.0]], &[1.0]).is_err());
        assert!(cut.weighted_bixels([90.0, 20.0], &[[0.0, 0.0]], &[1.0]).is_ok(), "far beside him");
        assert!(cut.beam([0.0, 90.0]).is_ok() && cut.beam(90.0).is_ok());
        let whole = engine(0.0, name).beam(along).map(|_| ());
        assert!(whole.is_ok(), "the whole patient is in the images: {whole:?}");
    }
}

#[test]
fn any_turn_of_the_couch_is_one_of_the_patient_as_far_as_voxels_say() {
    let still = engine(0.0, EngineName::Pencil);
    for (gantry_deg, couch_deg) in [(72.0, 30.0), (300.0, -47.5), (0.0, 13.37)] {
        let expected = dose(&engine(couch_deg, EngineName::Pencil), gantry_deg);
        let off = |angle: f64| {
            let found = dose(&still, [gantry_deg, angle]);
            difference(&still, &found, &expected, couch_deg)
        };
        println!(
            "gantry {gantry_deg}, couch {couch_deg}: {:.4}, mirrored {:.4}",
            off(couch_deg),
            off(-couch_deg)
        );
        assert!(off(couch_deg) < 0.02, "{}", off(couch_deg));
        assert!(off(-couch_deg) > 2.0 * off(couch_deg), "{}", off(-couch_deg));
    }
}

#[test]
fn bixels_turn_with_the_couch() {
    let (still, turned) = (engine(0.0, EngineName::Pencil), engine(90.0, EngineName::Pencil));
    let of = |engine: &DoseEngine, angles: BeamAngles| engine.bixels_mm(angles).unwrap();
    assert_eq!(of(&still, [40.0, 90.0].into()), of(&turned, 40.0.into()));
}

#[test]
fn a_couch_at_zero_gives_the_bytes_of_a_beam_without_one() {
    let engine = engine(0.0, EngineName::Pencil);
    let plain = engine.beam_file(40.0).unwrap();
    assert_eq!(plain, engine.beam_file([40.0, 0.0]).unwrap());
    assert_eq!(&plain[..8], b"SPDOSE02");
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    assert_eq!(cache.file(&engine, 40.0), cache.file(&engine, [40.0, 0.0]));
    assert_ne!(cache.file(&engine, 40.0), cache.file(&engine, [40.0, 10.0]));
    // A dose with a couch angle is kept and found under its angles alone.
    let made = cache.beam(&engine, [40.0, 10.0]).unwrap();
    let found = cache.beam(&engine, [40.0, 10.0]).unwrap();
    assert_eq!((made.beam.bytes(), found.beam.angles()), (found.beam.bytes(), [40.0, 10.0].into()));
    assert_ne!(made.beam.dose(), cache.beam(&engine, 40.0).unwrap().beam.dose());
}

#[test]
fn a_couch_angle_out_of_range_is_refused() {
    let engine = engine(0.0, EngineName::Pencil);
    for wrong in [180.1, -200.0, f64::NAN, f64::INFINITY] {
        let fault = engine.beam([40.0, wrong]).unwrap_err().to_string();
        assert!(fault.contains("couch angle"), "{fault}");
    }
}
