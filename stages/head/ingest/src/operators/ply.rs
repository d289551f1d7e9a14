//! `ingest.ply`: point cloud files, one per tick.

use stillpoint_operator::{Activation, Files, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Sample};

use super::files::{self, RecordedFile};
use super::points::send_cloud;
use super::turn::{AtEnd, Turn};
use super::unit::Unit;
use crate::checks::Fault;
use crate::ply;

const CLOUD: usize = 0;
/// Largest number of points of all clouds together: 1 GiB.
const MOST_POINTS: usize = (1 << 30) / size_of::<[f32; 3]>();

/// Parameters of `ingest.ply`.
#[derive(Clone, Debug, Params)]
pub struct PlyParams {
    /// PLY files (text or binary), in the order of their names: one file, a folder, or a pattern such as
    /// `scans/left_*.ply`.
    #[param(files = "*.ply")]
    pub files: String,
    /// Unit of the coordinates.
    #[param(default = "m")]
    pub unit: Unit,
    /// What follows the last file.
    #[param(default = "stop")]
    pub at_end: AtEnd,
    /// Refuses damaged files. Without it, they are left out and counted at the end of the run.
    #[param(default = false)]
    pub strict: bool,
    /// Largest number of points of a cloud: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_points: u32,
}

/// Sends the cloud of one file per tick.
pub struct IngestPly {
    /// Decoded, in metres: text takes longer to read than a tick lasts.
    clouds: Vec<Vec<[f32; 3]>>,
    turn: Turn,
}

impl Operator for IngestPly {
    type Params = PlyParams;
    const KIND: Kind = Kind {
        name: "ingest.ply",
        about: "Reads point cloud files (PLY), as scanners and mesh programs write them, one per tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud of the file; a row of the file's vertices.",
        }],
        timer: Timer::Required,
    };

    fn new(params: PlyParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let mut total = 0;
        let read = files::read(setup, &params.files, params.strict, |file| {
            let cloud = look(&params, file)?;
            total += cloud.len();
            if total > MOST_POINTS {
                return Err(Fault::Params(
                    "with it, the clouds take more than 1 GiB of memory: name fewer files".into(),
                ));
            }
            Ok(cloud)
        })?;
        let clouds: Vec<_> = read.into_iter().map(|(_, cloud)| cloud).collect();
        Ok(Self { turn: Turn::new(clouds.len(), params.at_end), clouds })
    }

    fn remarks(params: &PlyParams, files: &dyn Files) -> Vec<String> {
        files::remarks(files, &params.files, params.strict, |file| look(params, file))
    }

    fn finishes(params: &PlyParams) -> bool {
        params.at_end == AtEnd::Stop
    }

    fn capacities(params: &PlyParams) -> Vec<usize> {
        vec![params.max_points as usize]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(frame) = self.turn.take() else {
            outputs.finish();
            return Ok(());
        };
        let cloud = &self.clouds[frame];
        send_cloud(outputs, CLOUD, cloud.len(), 1, |points| {
            points.copy_from_slice(cloud);
            Ok(())
        })
    }
}

/// The cloud of a file, in metres.
fn look(params: &PlyParams, file: &RecordedFile) -> Result<Vec<[f32; 3]>, Fault> {
    let mut cloud = ply::read(&file.bytes).map_err(|e| Fault::Item(e.to_string()))?;
    files::at_most(params.max_points, cloud.len(), "points", "max_points")?;
    params.unit.check(&cloud)?;
    cloud.iter_mut().for_each(|point| *point = params.unit.in_metres(*point));
    Ok(cloud)
}
