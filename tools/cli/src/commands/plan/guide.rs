//! The priors of beams that the command line names.

use clap::ValueEnum;
use stillpoint_network::Judgement;
use stillpoint_patient::case::Case;
use stillpoint_plan::beams::{ClassAngles, Geometry, Mixture, Prior, Ring, Uniform, pelvis_solutions};

use crate::exit::Failure;

/// A prior of beams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Guide {
    /// All beams are alike.
    Uniform,
    /// Prices beside the beams that stay; this takes solves of smaller sets.
    Price,
    /// Ways through the body and through organs, from the image alone.
    Geometry,
    /// The usual angles for the pelvis with 5 or 7 beams.
    Class,
    /// A trained network over the geometry of the case: the one that comes with stillpoint, or that of `--network`.
    Network,
}

/// The mixture of the named priors but for prices; none if none is left.
pub fn mixture(
    guides: &[Guide],
    case: &Case,
    ring: Ring,
    beams: usize,
    learned: impl Fn() -> Result<Judgement, Failure>,
) -> Result<Option<Mixture<'static>>, Failure> {
    let mut parts: Vec<(f64, Box<dyn Prior>)> = Vec::new();
    for guide in guides {
        parts.push(match guide {
            Guide::Price => continue,
            Guide::Network => (1.0, Box::new(learned()?)),
            Guide::Uniform => (1.0, Box::new(Uniform)),
            Guide::Geometry => (1.0, Box::new(Geometry::of_case(case, ring))),
            Guide::Class => {
                let degrees = pelvis_solutions(beams).into_iter().next().ok_or_else(|| {
                    Failure::wrong(format!(
                        "--prior class: there are no usual angles for {beams} beams, only for 5 and 7"
                    ))
                })?;
                (1.0, Box::new(ClassAngles { degrees }))
            }
        });
    }
    Ok((!parts.is_empty()).then_some(Mixture { parts }))
}
