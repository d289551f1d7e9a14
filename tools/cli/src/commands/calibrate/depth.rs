//! `stillpoint calibrate depth`

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_segment::extrinsic::depth_scale;

use super::images;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::quantity::within;

/// Check the unit of the depth by a flat plate at two distances.
///
/// The plate fills the middle half of the image in both sessions. Between them, plate or camera moves along the axis of the
/// camera by a known way, away from each other. The command exits with 1 if the measured way differs by more than the bound. A depth camera sees a
/// plane as a plane with any focal length; focal lengths show in the distances between balls of `calibrate camera`.
#[derive(Args)]
pub struct Depth {
    /// The session at the smaller distance.
    near: PathBuf,
    /// The session at the larger distance.
    far: PathBuf,
    /// Topic of depth images or clouds of the camera, in both sessions.
    #[arg(long, value_name = "TOPIC")]
    topic: String,
    /// The way between the two, such as 200mm.
    #[arg(long, value_name = "LENGTH")]
    moved: String,
    /// Largest difference of the way, in percent.
    #[arg(long, value_name = "PERCENT", default_value = "0.5")]
    bound: f64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Depth {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let moved = within("moved", &self.moved, "mm", [20.0, 3000.0])?;
        if !(0.01..=10.0).contains(&self.bound) {
            return Err(Failure::wrong(format!(
                "invalid bound: --bound {} (allowed: 0.01 to 10 percent)",
                self.bound
            )));
        }
        let still = |path: &PathBuf| {
            let images = images::read(path, &self.topic)?;
            images.images.still().map_err(|fault| Failure::wrong(format!("{}: {fault}", path.display())))
        };
        let (near, far) = (still(&self.near)?, still(&self.far)?);
        let found = depth_scale(&near, &far, 1e-3 * moved).map_err(Failure::failed)?;
        let is_met = (100.0 * found.scale).abs() <= self.bound;
        if self.json {
            print_json(&json!({
                "moved_mm": 1e3 * found.moved,
                "scale": found.scale,
                "distances_mm": found.distances.map(|m| 1e3 * m),
                "rms_mm": found.rms.map(|m| 1e3 * m),
                "bowl_mm": found.bowl.map(|m| 1e3 * m),
                "tilts_deg": found.tilts.map(f64::to_degrees),
                "turn_deg": found.turn.to_degrees(),
                "met": is_met,
            }))?;
        } else {
            for (which, i) in [("near", 0), ("far", 1)] {
                outln!(
                    "{which}: {:.2} mm away along the axis, tilted by {:.2} degrees, {:.2} mm rms from a plane, edge less centre {:+.2} mm",
                    1e3 * found.distances[i],
                    found.tilts[i].to_degrees(),
                    1e3 * found.rms[i],
                    1e3 * found.bowl[i]
                );
            }
            outln!("turned by {:.3} degrees", found.turn.to_degrees());
            outln!(
                "{}: moved by {:.2} mm, given {moved} mm: {:+.3} % (allowed: {} %)",
                if is_met { "pass" } else { "FAIL" },
                1e3 * found.moved,
                100.0 * found.scale,
                self.bound
            );
        }
        Ok(if is_met { Exit::Done } else { Exit::Failed })
    }
}
