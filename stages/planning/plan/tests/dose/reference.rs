//! The dose of two beams against pyRadPlan 0.5.0.

use npyz::npz::NpzArchive;
use serde_json::Value;
use std::path::Path;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{NameTable, import_described};
use stillpoint_plan::dose::{BixelCentre, BixelSpec, DoseEngine, DoseParams, Machine};
use stillpoint_testing::reference;

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn vector(value: &Value) -> [f64; 3] {
    [0, 1, 2].map(|axis| value[axis].as_f64().unwrap())
}

fn engine(planning: &Path, sample: &Value, centre: BixelCentre) -> DoseEngine {
    let described = planning.join("pelvis_000/pelvis_000.json");
    let case = import_described(&described, &NameTable::shipped().unwrap()).unwrap().case;
    let dose_grid = &sample["dose_grid"];
    let params = DoseParams {
        grid: Grid {
            counts: vector(&dose_grid["size_xyz"]).map(|count| count as usize),
            spacing_mm: vector(&dose_grid["spacing_mm"]),
            origin_mm: vector(&dose_grid["origin_mm"]),
        },
        bixels: BixelSpec { centre, ..BixelSpec::of_width(sample["bixel_mm"].as_f64().unwrap()) },
        cutoff_mm: sample["geometric_lateral_cutoff_mm"].as_f64().unwrap(),
        ..DoseParams::over(case.grid(), 5.0)
    };
    let machine = std::fs::read_to_string(planning.join("photons_generic_6mv.json")).unwrap();
    DoseEngine::of_case(&case, Machine::from_json(&machine).unwrap(), params).unwrap()
}

#[test]
fn two_beams_on_a_pelvis_agree_with_the_reference() {
    let Some(planning) = reference::folder("planning") else { return };
    let sample = json(&planning.join("dij_pelvis_000_dev.json"));
    let mut npz = NpzArchive::open(planning.join("dij_pelvis_000_dev.npz")).unwrap();
    let engine = engine(&planning, &sample, BixelCentre::Offset);

    for (reference, prefix) in sample["beams"].as_array().unwrap().iter().zip(["b000", "b048"]) {
        let beam = engine.beam(reference["gantry_deg"].as_f64().unwrap()).unwrap();
        let positions: Vec<[f64; 2]> = serde_json::from_value(reference["ray_xz_bev_mm"].clone()).unwrap();
        assert_eq!(beam.bixels_mm, positions);

        let dose = beam.dose.view();
        let starts: Vec<i64> = npz.by_name(&format!("{prefix}_colptr")).unwrap().unwrap().into_vec().unwrap();
        let rows: Vec<i32> = npz.by_name(&format!("{prefix}_row")).unwrap().unwrap().into_vec().unwrap();
        let values: Vec<f32> = npz.by_name(&format!("{prefix}_data")).unwrap().unwrap().into_vec().unwrap();
        for (retained, column) in reference["kept_columns"].as_array().unwrap().iter().enumerate() {
            let range = starts[retained] as usize..starts[retained + 1] as usize;
            let mut difference = vec![None; dose.rows];
            for (&row, &value) in rows[range.clone()].iter().zip(&values[range.clone()]) {
                difference[row as usize] = Some(f64::from(value));
            }
            let maximum = values[range].iter().fold(0.0_f64, |most, &value| most.max(value.into()));
            let (rows, values) = dose.column(column.as_u64().unwrap() as usize);
            for (&row, &value) in rows.iter().zip(values) {
                *difference[row as usize].get_or_insert(0.0) -= f64::from(value);
            }
            let squares: Vec<f64> = difference.into_iter().flatten().map(|d| d * d).collect();
            let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            assert!(rms <= 0.001 * maximum, "{prefix}, bixel {column}: rms {rms}, maximum {maximum}");
        }

        let ones: Vec<f32> = npz.by_name(&format!("{prefix}_ones_sum")).unwrap().unwrap().into_vec().unwrap();
        let mut sum = vec![0.0; dose.rows];
        dose.row.iter().zip(dose.value).for_each(|(&row, &value)| sum[row as usize] += f64::from(value));
        let maximum = ones.iter().fold(0.0_f32, |most, &value| most.max(value));
        for (row, &expected) in ones.iter().enumerate().filter(|(_, value)| **value > 0.1 * maximum) {
            let expected = f64::from(expected);
            assert!(
                (sum[row] - expected).abs() <= 0.003 * expected,
                "{prefix}, row {row}: {} {expected}",
                sum[row]
            );
        }
    }
}

#[test]
fn centring_the_bixels_changes_more_than_the_reference_differs() {
    let Some(planning) = reference::folder("planning") else { return };
    let sample = json(&planning.join("dij_pelvis_000_dev.json"));
    let [centred, offset] = [BixelCentre::Centred, BixelCentre::Offset].map(|centre| {
        let beam = engine(&planning, &sample, centre).beam(0.0).unwrap();
        let mut column = vec![0.0; beam.dose.view().rows];
        let (rows, values) = beam.dose.view().column(42);
        rows.iter().zip(values).for_each(|(&row, &value)| column[row as usize] = f64::from(value));
        column
    });
    let maximum = offset.iter().copied().fold(0.0, f64::max);
    let squares: Vec<f64> =
        centred.iter().zip(&offset).filter(|(_, o)| **o > 0.0).map(|(c, o)| (c - o) * (c - o)).collect();
    assert!((squares.iter().sum::<f64>() / squares.len() as f64).sqrt() > 0.002 * maximum);
}
