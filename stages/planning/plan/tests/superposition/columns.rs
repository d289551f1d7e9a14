//! Columns of bixels against the beams that they make.

use super::beams::engine;
use stillpoint_plan::dose::{DoseEngine, Machine};

/// Weights of bixels by their places.
type Weights = fn([f64; 2]) -> f64;

/// Deviation of the weighted columns from the weighted beam, root mean square and 99th percentile, as parts of the greatest
/// dose: everywhere above a tenth of it, and near the field's edge.
fn deviation(engine: &DoseEngine, gantry_deg: f64, weight: Weights) -> [f64; 3] {
    let beam = engine.beam(gantry_deg).unwrap();
    let weights: Vec<f64> = beam.bixels_mm.iter().map(|bixel| weight(*bixel)).collect();
    let mut sum = vec![0.0; engine.rows()];
    for (column, weight) in weights.iter().enumerate() {
        let (rows, values) = beam.dose.view().column(column);
        rows.iter().zip(values).for_each(|(row, value)| sum[*row as usize] += weight * f64::from(*value));
    }
    let whole = engine.weighted_beam(gantry_deg, &weights).unwrap();
    let greatest = whole.iter().fold(0.0, |a: f64, b| a.max(f64::from(*b)));
    let half =
        beam.bixels_mm.iter().fold(0.0, |a: f64, b| a.max(b[0])) + 0.5 * engine.params().bixels.width_mm;
    let grid = engine.params().grid;
    let off: Vec<(f64, bool)> = whole
        .iter()
        .enumerate()
        .filter(|(_, dose)| f64::from(**dose) > 0.1 * greatest)
        .map(|(row, dose)| {
            let [x, y, z] = grid.centre_mm(grid.voxel(row));
            let edge = |mm: f64| (mm.abs() * 1000.0 / (1000.0 + y) - half).abs() < 5.0;
            (((sum[row] - f64::from(*dose)) / greatest).abs(), edge(x) || edge(z))
        })
        .collect();
    let rms = |off: &[f64]| (off.iter().map(|o| o * o).sum::<f64>() / off.len() as f64).sqrt();
    let mut all: Vec<f64> = off.iter().map(|(off, _)| *off).collect();
    let edge: Vec<f64> = off.iter().filter(|(_, edge)| *edge).map(|(off, _)| *off).collect();
    assert!(all.len() > 1000 && edge.len() > 200, "{} {}", all.len(), edge.len());
    all.sort_by(f64::total_cmp);
    [rms(&all), all[all.len() * 99 / 100], rms(&edge)]
}

/// A number between 0 and 1 for each place.
fn random([x, z]: [f64; 2]) -> f64 {
    let place = libm::sin(12.9898 * x + 78.233 * z) * 43758.547;
    place - place.floor()
}

fn stripes([x, _]: [f64; 2]) -> f64 {
    if (x / 10.0).round() as i64 % 2 == 0 { 1.0 } else { 0.0 }
}

fn open(_: [f64; 2]) -> f64 {
    1.0
}

#[test]
fn weighted_columns_are_the_weighted_beam_in_lung_and_at_field_edges() {
    let engine = engine(5.0, 10.0, true, Machine::shipped().unwrap()).unwrap();
    for (name, weight) in [("open", open as Weights), ("random", random), ("stripes", stripes)] {
        let [rms, p99, edge] = deviation(&engine, 0.0, weight);
        println!("{name}: rms {rms:.5}, p99 {p99:.5}, edge {edge:.5}");
        assert!(rms < 0.004 && edge < 0.004 && p99 < 0.01, "{name}: {rms} {p99} {edge}");
    }
}

/// Finer voxels, and bixels of 5 and 10 mm.
#[test]
#[ignore = "a minute: for .ci/soak"]
fn weighted_columns_are_the_weighted_beam_on_fine_grids() {
    for bixel_mm in [5.0, 10.0] {
        let engine = engine(2.5, bixel_mm, true, Machine::shipped().unwrap()).unwrap();
        for (angle, weight) in [(0.0, random as Weights), (37.0, stripes)] {
            let [rms, p99, edge] = deviation(&engine, angle, weight);
            println!("{bixel_mm} mm, {angle}: rms {rms:.5}, p99 {p99:.5}, edge {edge:.5}");
            assert!(
                rms < 0.004 && p99 < 0.01 && edge < 0.004,
                "{bixel_mm} mm at {angle}: {rms} {p99} {edge}"
            );
        }
    }
}

/// Processor time of this process, seconds.
pub fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

/// `cargo test --workspace --release --test superposition cost -- --ignored --nocapture --test-threads 1`
#[test]
#[ignore = "prints the costs of docs/results/dose.md"]
fn cost() {
    for (spacing_mm, bixel_mm) in [(2.5, 10.0), (2.5, 5.0), (5.0, 10.0)] {
        let engine = engine(spacing_mm, bixel_mm, true, Machine::shipped().unwrap()).unwrap();
        let before = cpu_s();
        let beam = engine.beam(37.0).unwrap();
        let columns = cpu_s() - before;
        let weights = vec![1.0; beam.bixels_mm.len()];
        let before = cpu_s();
        engine.weighted_beam(37.0, &weights).unwrap();
        println!(
            "{spacing_mm} mm, {} bixels of {bixel_mm} mm, {} voxels: columns {columns:.1} s with {} entries, beam {:.1} s",
            beam.bixels_mm.len(),
            engine.rows(),
            beam.dose.view().value.len(),
            cpu_s() - before
        );
    }
}
