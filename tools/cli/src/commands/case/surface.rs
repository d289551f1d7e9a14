//! `stillpoint case surface`

use std::io::{BufWriter, Write};
use std::path::PathBuf;

use clap::Args;
use stillpoint_patient::case::read;
use stillpoint_patient::outline::{Placing, outline, write_ply, write_stl};

use crate::exit::{Ended, Exit, Failure};
use crate::private;

/// Write the outline of a case as a mesh of triangles, in mm in the DICOM patient frame. The file holds the isocentre.
#[derive(Args)]
pub struct Surface {
    /// The case file.
    case: PathBuf,
    /// The file to write: `.ply` or `.stl`. It shows the patient's face as the case does: keep it as you keep the case.
    #[arg(long)]
    out: PathBuf,
}

impl Surface {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let extension = self.out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let is_ply = match extension.as_deref() {
            Some("ply") => true,
            Some("stl") => false,
            _ => {
                let out = self.out.display();
                return Err(Failure::wrong(format!("{out}: end the name in .ply or .stl")));
            }
        };
        let case = read(&self.case).map_err(Failure::wrong)?;
        let mesh = outline(&case).map_err(|e| Failure::failed(format!("{}: {e}", self.case.display())))?;
        let placing = Placing { isocentre_mm: case.isocentre_mm(), position: case.position() };
        let fault = |e: std::io::Error| Failure::failed(format!("{}: {e}", self.out.display()));
        let mut file = BufWriter::new(private::create(&self.out).map_err(fault)?);
        match is_ply {
            true => write_ply(&mesh, &placing, &mut file).map_err(fault)?,
            false => write_stl(&mesh, &placing, &mut file).map_err(fault)?,
        }
        file.flush().map_err(fault)?;
        outln!(
            "{}: {} triangles, {:.0} cm2, {:.0} cm3",
            self.out.display(),
            mesh.triangles.len(),
            mesh.area_cm2(),
            mesh.volume_cm3()
        );
        Ok(Exit::Done)
    }
}
