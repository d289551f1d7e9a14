//! Superposition against Monte Carlo at the places where pencil beams are wrong, and pencil beams there.

use super::phantoms::{Computed, DEPTHS, Reference, VOXEL_MM, computed, reference};
use stillpoint_plan::dose::EngineName;

/// Largest sigma of a point that is judged, as a part of its dose.
const SIGMA: f64 = 0.01;

/// Greatest deviation on the axis between two depths (mm), by the reference at the depth, or by its greatest dose.
fn worst(ours: &Computed, reference: &Reference, [from, to]: [f64; 2], by_greatest: bool) -> f64 {
    let greatest = reference.axis.iter().copied().fold(0.0, f64::max);
    let is_judged = |y: &usize| {
        let depth_mm = (*y as f64 + 0.5) * VOXEL_MM;
        (from..to).contains(&depth_mm) && reference.axis_sigma[*y] <= SIGMA * reference.axis[*y]
    };
    let judged: Vec<usize> = (0..DEPTHS).filter(is_judged).collect();
    assert!(!judged.is_empty(), "no point between {from} and {to} mm");
    let off = |y: &usize| {
        let by = if by_greatest { greatest } else { reference.axis[*y] };
        (ours.axis[*y] - reference.axis[*y]).abs() / by
    };
    judged.iter().map(off).fold(0.0, f64::max)
}

/// Root of the mean square of the deviations on the axis and the profiles, without the noise of the reference, as a part of
/// the greatest dose. Air and the first two millimetres are left out.
fn rms(phantom: char, ours: &Computed, reference: &Reference) -> f64 {
    let greatest = reference.axis.iter().copied().fold(0.0, f64::max);
    let (mut sum, mut count) = (0.0, 0);
    let mut add = |ours: f64, theirs: f64, sigma: f64| {
        if theirs > 0.1 * greatest {
            sum += ((ours - theirs) / greatest).powi(2) - (sigma / greatest).powi(2);
            count += 1;
        }
    };
    let is_left_out = |y: usize| y == 0 || phantom == 'd' && (8..16).contains(&y);
    for y in (0..DEPTHS).filter(|y| !is_left_out(*y)) {
        add(ours.axis[y], reference.axis[y], reference.axis_sigma[y]);
    }
    for (key, lateral) in &reference.lateral {
        if !is_left_out((key.parse::<f64>().unwrap() * 10.0 / VOXEL_MM) as usize) {
            for (i, dose) in lateral.dose.iter().enumerate() {
                add(ours.lateral[key][i], *dose, lateral.sigma[i]);
            }
        }
    }
    (sum / f64::from(count)).max(0.0).sqrt()
}

fn both(phantom: char, field_cm: u32) -> (Reference, Computed) {
    let reference = reference(phantom, field_cm);
    let computed = computed(phantom, field_cm, EngineName::Superposition, &reference);
    (reference, computed)
}

#[test]
fn depth_doses_in_water_are_those_of_monte_carlo() {
    for field_cm in [2, 5] {
        let (reference, ours) = both('a', field_cm);
        let worst = worst(&ours, &reference, [5.0, 250.0], true);
        assert!(worst < 0.025, "{field_cm} cm: {worst}");
        let rms = rms('a', &ours, &reference);
        assert!(rms < 0.011, "{field_cm} cm: {rms}");
    }
}

#[test]
fn walls_behind_air_are_those_of_monte_carlo() {
    let (reference, ours) = both('d', 2);
    let behind = worst(&ours, &reference, [40.0, 45.0], false);
    assert!(behind < 0.06, "{behind}");
    let rms = rms('d', &ours, &reference);
    assert!(rms < 0.012, "{rms}");
}

#[test]
fn lung_and_the_tumour_in_it_are_those_of_monte_carlo() {
    let (reference, ours) = both('b', 2);
    assert!(worst(&ours, &reference, [30.0, 130.0], false) < 0.08);
    assert!(worst(&ours, &reference, [130.0, 250.0], false) < 0.05);
    assert!(rms('b', &ours, &reference) < 0.026);
    let (reference, ours) = both('e', 2);
    assert!(worst(&ours, &reference, [30.0, 90.0], false) < 0.08);
    assert!(worst(&ours, &reference, [90.0, 110.0], false) < 0.05);
    assert!(worst(&ours, &reference, [110.0, 120.0], false) < 0.10);
    assert!(worst(&ours, &reference, [120.0, 230.0], false) < 0.08);
    assert!(rms('e', &ours, &reference) < 0.027);
}

#[test]
fn pencil_beams_are_wrong_behind_air_and_in_lung() {
    let pencil = |phantom| {
        let reference = reference(phantom, 2);
        let computed = computed(phantom, 2, EngineName::Pencil, &reference);
        (reference, computed)
    };
    // In water, they are near: what follows is not a matter of scale.
    let (reference, ours) = pencil('a');
    assert!(worst(&ours, &reference, [20.0, 150.0], true) < 0.06);
    for (phantom, place, wrong) in
        [('d', [40.0, 42.5], 0.4..0.8), ('b', [60.0, 130.0], 0.3..0.6), ('e', [90.0, 92.5], 0.15..0.4)]
    {
        let (reference, ours) = pencil(phantom);
        let worst = worst(&ours, &reference, place, false);
        assert!(wrong.contains(&worst), "{phantom}: {worst}");
    }
}

/// `cargo test --workspace --test superposition table -- --ignored --nocapture`
#[test]
#[ignore = "prints the table of docs/results/dose.md"]
fn table() {
    let places: [(char, &str, [f64; 2]); 9] = [
        ('a', "water, 10 cm", [100.0, 102.5]),
        ('b', "lung, 8 cm", [80.0, 82.5]),
        ('b', "first voxel of water behind lung", [130.0, 132.5]),
        ('c', "in bone, 6 cm", [60.0, 62.5]),
        ('d', "first voxel behind air", [40.0, 42.5]),
        ('d', "second voxel behind air", [42.5, 45.0]),
        ('e', "lung before the tumour, 7.6 cm", [75.0, 77.5]),
        ('e', "first voxel of the tumour", [90.0, 92.5]),
        ('e', "centre of the tumour", [100.0, 102.5]),
    ];
    for phantom in ['a', 'b', 'c', 'd', 'e'] {
        for field_cm in [1, 2, 5].into_iter().filter(|field| phantom != 'c' || *field > 1) {
            let reference = reference(phantom, field_cm);
            let [ours, pencil] = [EngineName::Superposition, EngineName::Pencil]
                .map(|name| computed(phantom, field_cm, name, &reference));
            println!(
                "{phantom} {field_cm} cm: rms {:.1} % (pencil {:.1} %)",
                100.0 * rms(phantom, &ours, &reference),
                100.0 * rms(phantom, &pencil, &reference)
            );
            for (_, place, [from, _]) in places.iter().filter(|(of, ..)| *of == phantom) {
                let y = (from / VOXEL_MM) as usize;
                let off = |of: &Computed| 100.0 * (of.axis[y] / reference.axis[y] - 1.0);
                println!(
                    "  {place}: {:+.1} % (pencil {:+.1} %), sigma {:.1} %",
                    off(&ours),
                    off(&pencil),
                    100.0 * reference.axis_sigma[y] / reference.axis[y]
                );
            }
        }
    }
}
