//! `stillpoint rig`

use std::path::PathBuf;

use clap::Args;
use stillpoint_operator::Registry;

use crate::commands::run::Run;
use crate::exit::Ended;
use crate::pipeline_file::PipelineFile;

/// The host that it runs.
const HOST: &str = "rig";

/// Run the far end of a pipeline as a separate program: the operators that the file places on the host `rig`. The program
/// takes datagrams, runs the plant in real time, sends the images of its camera, and vents by itself when datagrams stop. It
/// runs until Ctrl-C, also if the controlling program (`stillpoint run --host main`) ends. Without FILE, the embedded pipeline
/// in two programs is used. Images go through `stillpoint-bridge`, which has to be built.
#[derive(Args)]
pub struct Rig {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Length of the run in session time, such as `10s`. Without it, the program runs until Ctrl-C.
    #[arg(long = "for", value_name = "TIME", allow_hyphen_values = true)]
    length: Option<String>,
    /// Folder in which the session folder is created.
    #[arg(long, value_name = "FOLDER", default_value = "sessions")]
    record: PathBuf,
    /// Do not record a session.
    #[arg(long, conflicts_with = "record")]
    no_record: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

impl Rig {
    /// Executes the subcommand.
    pub fn execute(self, registry: &Registry) -> Ended {
        let Self { pipeline, length, record, no_record, json } = self;
        Run::part(pipeline, HOST, length, record, no_record, json).execute(registry)
    }
}
