//! Complete fluence problems from files.

use std::fs::File;
use std::io::BufReader;

use npyz::npz::NpzArchive;
use serde_json::Value;
use stillpoint_plan::Csc;
use stillpoint_plan::fluence::{Csr, Problem};
use stillpoint_testing::reference;

/// A fluence problem with what is known of it.
pub struct Case {
    /// The dose matrix.
    pub matrix: Csc,
    /// Dose goals and weights by row.
    pub hi: Vec<f64>,
    pub lo: Vec<f64>,
    pub over: Vec<f64>,
    pub under: Vec<f64>,
    /// Where each structure's rows start.
    pub row_start: Vec<i64>,
    /// What stands beside the arrays.
    pub about: Value,
}

impl Case {
    /// The problem.
    pub fn problem(&self) -> Problem {
        let matrix = Csr::from_columns(self.matrix.view());
        Problem::from_bounds(matrix, &self.hi, &self.lo, &self.over, &self.under).unwrap()
    }
}

/// Reads a problem, where the data is there.
pub fn case(name: &str) -> Option<Case> {
    let folder = reference::folder("planning")?;
    let about = serde_json::from_slice(&std::fs::read(folder.join(format!("{name}.json"))).unwrap()).unwrap();
    let mut npz = NpzArchive::open(folder.join(format!("{name}.npz"))).unwrap();
    let shape: Vec<i64> = array(&mut npz, "shape");
    let starts: Vec<i64> = array(&mut npz, "colptr");
    let row: Vec<i32> = array(&mut npz, "row");
    let value: Vec<f32> = array(&mut npz, "data");
    let matrix = Csc::new(
        shape[0] as usize,
        starts.iter().map(|s| *s as u64).collect(),
        row.iter().map(|r| *r as u32).collect(),
        value,
    )
    .unwrap();
    let row_start = array(&mut npz, "row_start");
    let mut numbers = |name| array::<f64>(&mut npz, name);
    let (hi, lo, over, under) = (numbers("hi"), numbers("lo"), numbers("wo"), numbers("wu"));
    Some(Case { matrix, hi, lo, over, under, row_start, about })
}

fn array<T: npyz::Deserialize>(npz: &mut NpzArchive<BufReader<File>>, name: &str) -> Vec<T> {
    npz.by_name(name).unwrap().unwrap_or_else(|| panic!("no array {name}")).into_vec().unwrap()
}
