//! `ingest.pcd`: point cloud files, one per tick.

use stillpoint_operator::{Activation, Files, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Sample};

use super::files::{self, RecordedFile};
use super::points::send_cloud;
use super::turn::{AtEnd, Turn};
use super::unit::Unit;
use crate::checks::Fault;
use crate::pcd;

const CLOUD: usize = 0;

/// Parameters of `ingest.pcd`.
#[derive(Clone, Debug, Params)]
pub struct PcdParams {
    /// PCD files (ascii, binary or compressed), in the order of their names: one file, a folder, or a pattern such as
    /// `scans/left_*.pcd`.
    #[param(files = "*.pcd")]
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
pub struct IngestPcd {
    /// As they are on disk: compressed ones stay small.
    files: Vec<RecordedFile>,
    turn: Turn,
    unit: Unit,
}

impl Operator for IngestPcd {
    type Params = PcdParams;
    const KIND: Kind = Kind {
        name: "ingest.pcd",
        about: "Reads point cloud files (PCD), one per tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::Key,
            about: "The cloud of the file; organised if the file is.",
        }],
        timer: Timer::Required,
    };

    fn new(params: PcdParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let files = files::read(setup, &params.files, params.strict, |file| look(&params, file))?;
        let files: Vec<RecordedFile> = files.into_iter().map(|(file, ())| file).collect();
        Ok(Self { turn: Turn::new(files.len(), params.at_end), files, unit: params.unit })
    }

    fn remarks(params: &PcdParams, files: &dyn Files) -> Vec<String> {
        files::remarks(files, &params.files, params.strict, |file| look(params, file))
    }

    fn finishes(params: &PcdParams) -> bool {
        params.at_end == AtEnd::Stop
    }

    fn capacities(params: &PcdParams) -> Vec<usize> {
        vec![params.max_points as usize]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(frame) = self.turn.take() else {
            outputs.finish();
            return Ok(());
        };
        let file = &self.files[frame];
        let cloud = pcd::read(&file.bytes).map_err(|e| StepError(format!("{}: {e}", file.name)))?;
        send_cloud(outputs, CLOUD, cloud.width, cloud.height, |points| {
            points.iter_mut().zip(&cloud.points).for_each(|(to, from)| *to = self.unit.in_metres(*from));
            Ok(())
        })
    }
}

/// Looks at a file as a step does.
fn look(params: &PcdParams, file: &RecordedFile) -> Result<(), Fault> {
    let cloud = pcd::read(&file.bytes).map_err(|e| Fault::Item(e.to_string()))?;
    files::at_most(params.max_points, cloud.points.len(), "points", "max_points")?;
    Ok(params.unit.check(&cloud.points)?)
}
