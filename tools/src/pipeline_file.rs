//! Reading and checking the file of a pipeline.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use stillpoint_pipeline::files::DiskFiles;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::operator::Registry;
use stillpoint_pipeline::spec::{self, Faults, Machine};

use crate::exit::Failure;

/// The default pipeline, for a program that is started away from its source.
const EMBEDDED: &str = include_str!("../../pipeline.yaml");

/// Which pipeline, and what is changed in it.
#[derive(Args, Clone, Debug, Default)]
pub struct PipelineFile {
    /// The pipeline; without one `pipeline.yaml` of this folder, or the one that comes with the command.
    pub file: Option<PathBuf>,
    /// Change a parameter: `--set operator.param=value`.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE")]
    pub sets: Vec<String>,
}

/// A pipeline that was read and checked.
pub struct Checked {
    /// Its text.
    pub source: String,
    /// Name of its file: absolute, so that every process finds the files beside it.
    pub file: PathBuf,
    /// The graph.
    pub graph: Arc<Graph>,
}

impl PipelineFile {
    /// Text and file name.
    pub fn read(&self) -> Result<(String, PathBuf), Failure> {
        let path = match &self.file {
            Some(path) => path.clone(),
            None if Path::new("pipeline.yaml").is_file() => PathBuf::from("pipeline.yaml"),
            None => return Ok((EMBEDDED.to_string(), PathBuf::from("pipeline.yaml"))),
        };
        let source = std::fs::read_to_string(&path)
            .map_err(|e| Failure::wrong(format!("{}: {e}; name the file of a pipeline", path.display())))?;
        Ok((source, std::path::absolute(&path).unwrap_or(path)))
    }

    /// Reads and checks. Faults name the file as the user did.
    pub fn check(&self, registry: &Registry, machine: &Machine) -> Result<Checked, Failure> {
        let (source, file) = self.read()?;
        match self.check_text(&source, &file, registry, machine) {
            Ok(graph) => Ok(Checked { source, file, graph: Arc::new(graph) }),
            Err(faults) => Err(Failure::wrong(faults)),
        }
    }

    /// Checks a text that was read.
    pub fn check_text(
        &self,
        source: &str,
        file: &Path,
        registry: &Registry,
        machine: &Machine,
    ) -> Result<Graph, Faults> {
        let shown = self.file.as_deref().unwrap_or(Path::new("pipeline.yaml"));
        let files = DiskFiles::beside(file);
        spec::check_for(machine, source, &shown.display().to_string(), &self.sets, registry, &files)
    }
}
