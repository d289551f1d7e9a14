//! `stillpoint case import`

use std::path::{Path, PathBuf};

use clap::Args;
use stillpoint_dicom::{Request, import_folder};
use stillpoint_patient::case::intake::Scale;
use stillpoint_patient::case::{
    Imported, NameTable, PatientPosition, Prescription, Uid, import_described_as, write,
};

use crate::exit::{Ended, Exit, Failure};
use crate::quantity::quantity;

/// Make a case file from a DICOM folder (CT and RTSTRUCT), or from NRRD volumes with their JSON.
///
/// The case file keeps UIDs, but no name, ID or birth date of the patient.
#[derive(Args)]
pub struct Import {
    /// A folder with a CT series and its RTSTRUCT, or the JSON next to NRRD volumes, or a folder with one such JSON.
    from: PathBuf,
    /// The case file to write.
    #[arg(long)]
    out: PathBuf,
    /// JSON table of structure names; its entries take precedence over the built-in table.
    #[arg(long)]
    names: Option<PathBuf>,
    /// DICOM: name of the case. Choose a name that does not identify the patient.
    #[arg(long)]
    name: Option<String>,
    /// DICOM: UID of the CT series, if the folder holds several.
    #[arg(long)]
    series: Option<String>,
    /// DICOM: total dose of a target over all fractions, such as `PTV=78Gy`; give it once for each target.
    #[arg(long)]
    prescribe: Vec<String>,
    /// DICOM: number of fractions.
    #[arg(long)]
    fractions: Option<u32>,
    /// DICOM: isocentre in the patient's frame, such as `1.5mm,0mm,-20mm`. Default: the centroid of the targets with a
    /// prescription, or of all targets if none has one.
    #[arg(long, allow_hyphen_values = true)]
    isocentre: Option<String>,
    /// DICOM: the position of the patient, where the images do not say it: HFS, HFP, FFS or FFP.
    #[arg(long)]
    position: Option<String>,
    /// Take values that are not Hounsfield units of a patient: a phantom of other materials, or images in other units.
    #[arg(long)]
    any_hounsfield: bool,
    /// DICOM: resample images that are unevenly spaced or of a tilted gantry to even slices across the patient. It changes
    /// values between images, and says so.
    #[arg(long)]
    resample: bool,
    /// Refuse what would be left out: empty contours, regions of another frame of reference, files and keys that cannot be
    /// read.
    #[arg(long)]
    strict: bool,
    /// DICOM: volume of an organ that may lie beyond the end of the images, such as `12.5cm3`. Without it, an organ that is
    /// cut is refused. A target that is cut is always refused.
    #[arg(long)]
    allow_cut: Option<String>,
}

impl Import {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let names = self.name_table()?;
        let scale = if self.any_hounsfield { Scale::Any } else { Scale::OfPatients };
        let Imported { case, notes, left_out } = match described(&self.from)? {
            Some(json) => {
                self.refuse_for_json(&json)?;
                import_described_as(&json, &names, scale).map_err(Failure::failed)?
            }
            None => import_folder(&self.from, &self.request(&names, scale)?).map_err(Failure::failed)?,
        };
        if self.strict && !left_out.is_empty() {
            let from = self.from.display();
            return Err(Failure::failed(format!(
                "{from}: `--strict` refuses what cannot be read:\n  {}",
                left_out.join("\n  ")
            )));
        }
        for note in left_out.into_iter().chain(notes) {
            outln!("note: {note}");
        }
        if let Some(folder) = self.out.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|e| Failure::failed(format!("{}: {e}", folder.display())))?;
        }
        let hash = write(&case, &self.out).map_err(Failure::failed)?;
        let targets: Vec<_> = case.targets().map(|t| t.name.as_str()).collect();
        outln!(
            "{}: {}, {} structures, targets {}",
            self.out.display(),
            case.name(),
            case.structures().len(),
            targets.join(", ")
        );
        outln!("hash {hash}");
        if case.prescription().is_empty() {
            outln!("note: the case has no prescription; a plan needs one (`--prescribe PTV=78Gy`)");
        }
        Ok(Exit::Done)
    }

    fn name_table(&self) -> Result<NameTable, Failure> {
        let shipped = NameTable::shipped().map_err(Failure::failed)?;
        let Some(path) = &self.names else { return Ok(shipped) };
        let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|e| fault(&e))?;
        Ok(NameTable::parse(&text).map_err(|e| fault(&e))?.before(shipped))
    }

    fn refuse_for_json(&self, json: &Path) -> Result<(), Failure> {
        let given = [
            ("--name", self.name.is_some()),
            ("--series", self.series.is_some()),
            ("--prescribe", !self.prescribe.is_empty()),
            ("--fractions", self.fractions.is_some()),
            ("--isocentre", self.isocentre.is_some()),
            ("--allow-cut", self.allow_cut.is_some()),
            ("--position", self.position.is_some()),
            ("--resample", self.resample),
        ];
        match given.iter().find(|(_, given)| *given) {
            Some((option, _)) => {
                Err(Failure::wrong(format!("{option} is for DICOM: change it in {}", json.display())))
            }
            None => Ok(()),
        }
    }

    fn request<'a>(&self, names: &'a NameTable, scale: Scale) -> Result<Request<'a>, Failure> {
        let prescription = self.prescribe.iter().map(|text| prescription(text)).collect::<Result<_, _>>()?;
        let isocentre_mm = match &self.isocentre {
            None => None,
            Some(text) => {
                let parts: Vec<f64> =
                    text.split(',').map(|part| quantity(part, "mm", text)).collect::<Result<_, _>>()?;
                let three = <[f64; 3]>::try_from(parts);
                Some(three.map_err(|_| {
                    Failure::wrong(format!("{text:?}: give three lengths, like 1.5mm,0mm,-20mm"))
                })?)
            }
        };
        let series = match &self.series {
            None => None,
            Some(text) => Some(Uid::parse(text).map_err(Failure::wrong)?),
        };
        let position = match &self.position {
            None => None,
            Some(text) => Some(PatientPosition::of_term(&text.to_ascii_uppercase()).ok_or_else(|| {
                Failure::wrong(format!("invalid position: {text:?} (allowed: HFS, HFP, FFS, FFP)"))
            })?),
        };
        let allowed_cut_cm3 = match &self.allow_cut {
            None => 0.0,
            Some(text) => match quantity(text, "cm3", text)? {
                size if size >= 0.0 => size,
                _ => return Err(Failure::wrong(format!("{text:?}: the size of a cut cannot be negative"))),
            },
        };
        Ok(Request {
            names,
            name: self.name.clone(),
            series,
            prescription,
            fractions: self.fractions,
            isocentre_mm,
            allowed_cut_cm3,
            position,
            scale,
            resample: self.resample,
        })
    }
}

/// `NAME=DOSE Gy`.
fn prescription(text: &str) -> Result<Prescription, Failure> {
    let Some((name, dose)) = text.rsplit_once('=') else {
        return Err(Failure::wrong(format!("{text:?}: give a target and its dose, like PTV=78Gy")));
    };
    Ok(Prescription { structure: name.trim().to_owned(), dose_gy: quantity(dose, "Gy", text)? })
}

/// The JSON of NRRD volumes, if the path names one.
fn described(from: &Path) -> Result<Option<PathBuf>, Failure> {
    let fault = |e| Failure::failed(format!("{}: {e}", from.display()));
    if !std::fs::metadata(from).map_err(fault)?.is_dir() {
        return Ok(Some(from.to_owned()));
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(from).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        if path.extension().is_some_and(|e| e == "json") {
            found.push(path);
        }
    }
    found.sort();
    match found.len() {
        0 | 1 => Ok(found.pop()),
        n => {
            let first = found[0].display();
            Err(Failure::wrong(format!("{} holds {n} JSON files: name one, like {first}", from.display())))
        }
    }
}
