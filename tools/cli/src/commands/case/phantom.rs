//! `stillpoint case phantom`

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use stillpoint_patient::case::{
    Case, HEAD_SPACING_MM, HEAD_SPACINGS_MM, Skin, head, lung, neck, phantom, varied_phantom, write,
};
use stillpoint_rig::head::Head;

use crate::exit::{Ended, Exit, Failure};
use crate::quantity::quantity;

/// Generate the case file of a synthetic patient from a seed.
#[derive(Args)]
pub struct Phantom {
    /// The folder in which the case file, `pelvis-SEED.case`, `head-SEED.case`, `neck-SEED.case` or `lung-SEED.case`, is written.
    #[arg(long)]
    out: PathBuf,
    /// The part of the body.
    #[arg(long, value_enum, default_value = "pelvis")]
    site: Site,
    /// Seed of the phantom. Plans without a case use the pelvis of seed 0.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also draw the site, side and shape of the target, a loop of bowel, and hip implants: `pelvis-varied-SEED.case`.
    #[arg(long)]
    varied: bool,
    /// Distance of the voxels of a head, from "1 mm" to "5 mm" (the default is "2 mm"): a coarse case is a small file.
    #[arg(long)]
    spacing: Option<String>,
}

/// A part of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Site {
    /// A male pelvis; every seed is another one.
    Pelvis,
    /// The head that the rigs show, with the same axes; every seed has another target.
    Head,
    /// A head and neck with tumours and lymph nodes of the throat; every seed is another one.
    Neck,
    /// A chest with a tumour in one lung; every seed is another one.
    Lung,
}

impl Phantom {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        if self.spacing.is_some() && self.site != Site::Head {
            return Err(Failure::wrong("--spacing is for --site head; leave it out for other sites"));
        }
        let case = match (self.site, self.varied) {
            (Site::Pelvis, false) => phantom(self.seed).map_err(Failure::failed)?,
            (Site::Pelvis, true) => varied_phantom(self.seed).map_err(Failure::failed)?,
            (Site::Head, false) => head_of_rig(self.seed, self.spacing_mm()?)?,
            (Site::Neck, false) => neck(self.seed).map_err(Failure::failed)?,
            (Site::Lung, false) => lung(self.seed).map_err(Failure::failed)?,
            (Site::Head | Site::Neck | Site::Lung, true) => {
                return Err(Failure::wrong("--varied draws pelves; leave it out for other sites"));
            }
        };
        let fault = |e| Failure::failed(format!("{}: {e}", self.out.display()));
        std::fs::create_dir_all(&self.out).map_err(fault)?;
        let path = self.out.join(format!("{}.case", case.name()));
        let hash = write(&case, &path).map_err(Failure::failed)?;
        outln!("{}: {}", path.display(), case.provenance());
        outln!("hash {hash}");
        Ok(Exit::Done)
    }

    fn spacing_mm(&self) -> Result<f64, Failure> {
        let Some(text) = &self.spacing else { return Ok(HEAD_SPACING_MM) };
        let spacing_mm = quantity(text, "mm", &format!("--spacing {text}"))?;
        if HEAD_SPACINGS_MM.contains(&spacing_mm) {
            return Ok(spacing_mm);
        }
        let (low, high) = (HEAD_SPACINGS_MM.start(), HEAD_SPACINGS_MM.end());
        Err(Failure::wrong(format!("--spacing {text}: give a distance from {low} mm to {high} mm")))
    }
}

/// The CT of the head that the rigs show.
fn head_of_rig(seed: u64, spacing_mm: f64) -> Result<Case, Failure> {
    let skin = Head::new(1.0).map_err(Failure::failed)?;
    let (least, greatest) = skin.extent();
    let depth_mm = |at_mm: [f64; 3]| 1e3 * skin.depth(at_mm.map(|c| 1e-3 * c));
    let extent_mm = [least, greatest].map(|corner| [corner.x, corner.y, corner.z].map(|c| 1e3 * c));
    head(&Skin { depth_mm: &depth_mm, extent_mm }, seed, spacing_mm).map_err(Failure::failed)
}
