//! `stillpoint rig`

use std::path::PathBuf;

use clap::Args;
use stillpoint_operator::Registry;

use crate::commands::run::Run;
use crate::exit::Ended;
use crate::pipeline_file::PipelineFile;

/// The host that it runs.
const HOST: &str = "rig";

/// Run the far end of a pipeline as a program of its own: what its file places on the host `rig`. It takes datagrams,
/// runs the plant in real time, serves its camera, and vents by itself when datagrams stop. It goes on until Ctrl-C,
/// whatever becomes of the program that controls it: `stillpoint run --host main`. Without a pipeline it is the one in two
/// programs that comes with the command.
#[derive(Args)]
pub struct Rig {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Length of the run in session time, such as `10s`. Without it, it goes on until Ctrl-C.
    #[arg(long = "for", value_name = "TIME", allow_hyphen_values = true)]
    length: Option<String>,
    /// Folder in which the session's folder is made.
    #[arg(long, value_name = "FOLDER", default_value = "sessions")]
    record: PathBuf,
    /// Record nothing.
    #[arg(long, conflicts_with = "record")]
    no_record: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

impl Rig {
    /// Does it.
    pub fn execute(self, registry: &Registry) -> Ended {
        let Self { pipeline, length, record, no_record, json } = self;
        Run::part(pipeline, HOST, length, record, no_record, json).execute(registry)
    }
}
