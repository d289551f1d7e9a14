//! `stillpoint case show`

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_patient::case::{Case, Structure, content_hash, read};

use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::picture::{COLOURS, Plane, draw};

/// Show the structures of a case and draw its central slices.
#[derive(Args)]
pub struct Show {
    /// The case file.
    case: PathBuf,
    /// Folder for pictures of the slices through the isocentre, in three planes.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Show {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let case = read(&self.case).map_err(Failure::wrong)?;
        let hash = content_hash(&case).map_err(Failure::failed)?.to_string();
        match self.json {
            true => print_json(&reported(&case, &hash))?,
            false => print(&case, &hash),
        }
        if let Some(folder) = &self.out {
            let fault = |path: &PathBuf, e: &dyn std::fmt::Display| {
                Failure::failed(format!("{}: {e}", path.display()))
            };
            std::fs::create_dir_all(folder).map_err(|e| fault(folder, &e))?;
            for plane in Plane::ALL {
                let path = folder.join(format!("{}.png", plane.name()));
                let file = std::fs::File::create(&path).map_err(|e| fault(&path, &e))?;
                draw(&case, plane).write(std::io::BufWriter::new(file)).map_err(|e| fault(&path, &e))?;
                if !self.json {
                    outln!("{}", path.display());
                }
            }
        }
        Ok(Exit::Done)
    }
}

/// The least and greatest positions of voxel centres, mm.
fn extent_mm(case: &Case, structure: &Structure) -> Option<[[f64; 2]; 3]> {
    let mut extent = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for index in structure.mask.indices() {
        let centre = case.grid().centre_mm(case.grid().voxel(index));
        for (range, c) in extent.iter_mut().zip(centre) {
            *range = [range[0].min(c), range[1].max(c)];
        }
    }
    (!structure.mask.is_empty()).then_some(extent)
}

fn reported(case: &Case, hash: &str) -> serde_json::Value {
    let structure = |s: &Structure| json!({ "name": s.name, "role": s.role, "voxels": s.mask.count(), "volume_cm3": case.volume_cm3(s), "extent_mm": extent_mm(case, s) });
    json!({
        "name": case.name(),
        "hash": hash,
        "counts": case.grid().counts,
        "spacing_mm": case.grid().spacing_mm,
        "origin_mm": case.grid().origin_mm,
        "position": case.position(),
        "isocentre_mm": case.isocentre_mm(),
        "structures": case.structures().iter().map(structure).collect::<Vec<_>>(),
        "prescription": case.prescription(),
        "fractions": case.fractions(),
        "reference_dose": case.reference_dose_gy().is_some(),
        "uids": case.uids(),
        "provenance": case.provenance(),
    })
}

fn print(case: &Case, hash: &str) {
    let grid = case.grid();
    let three = |values: [f64; 3]| values.map(|v| format!("{v:.1}")).join(", ");
    outln!("{}: {}", case.name(), case.provenance());
    outln!("hash {hash}");
    let [x, y, z] = grid.counts;
    outln!(
        "{x} x {y} x {z} voxels of {} mm, the first at {} mm",
        three(grid.spacing_mm),
        three(grid.origin_mm)
    );
    outln!("patient {}", case.position());
    outln!("isocentre {} mm", three(case.isocentre_mm()));
    for p in case.prescription() {
        let fractions = case.fractions().map_or_else(String::new, |n| format!(" in {n} fractions"));
        outln!("prescribed {} Gy to {}{fractions}", p.dose_gy, p.structure);
    }
    if case.reference_dose_gy().is_some() {
        outln!("the case contains a reference dose");
    }
    if let Some(uids) = case.uids() {
        outln!(
            "study {}\nseries {}\nframe of reference {}",
            uids.study,
            uids.series,
            uids.frame_of_reference
        );
        outln!("structure set {}", uids.structure_set);
    }
    outln!();
    let left = ["structure", "role"].map(|name| (Side::Left, name));
    let right = ["cm3", "left mm", "back mm", "head mm"].map(|name| (Side::Right, name));
    let mut table = Columns::new(left.into_iter().chain(right).chain([(Side::Left, "colour")]));
    for (place, structure) in case.structures().iter().enumerate() {
        let [left, back, head] = match extent_mm(case, structure) {
            Some(extent) => extent.map(|[low, high]| format!("{low:.1} to {high:.1}")),
            None => ["-"; 3].map(str::to_owned),
        };
        table.row([
            structure.name.clone(),
            structure.role.word().to_owned(),
            format!("{:.3}", case.volume_cm3(structure)),
            left,
            back,
            head,
            COLOURS[place % COLOURS.len()].0.to_owned(),
        ]);
    }
    out!("{table}");
}
