//! Reading and checking the file of a pipeline.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_operator::files::DiskFiles;
use stillpoint_pipeline::config::yaml::MOST_BYTES;
use stillpoint_pipeline::config::{self, Code, Composed, Faults, Machine, Resolved};
use stillpoint_pipeline::graph::Graph;

use crate::exit::{Ended, Exit, Failure, print_json};

/// The default pipeline, for a program that runs outside its source folder.
pub const EMBEDDED: &str = include_str!("../../../pipeline.yaml");
/// The files that it names.
pub const EMBEDDED_FILES: &[(&str, &[u8])] =
    &[("examples/data/rig.key", include_bytes!("../../../examples/data/rig.key"))];

/// The embedded pipeline in two programs, and the files that it names.
const APART: &str = include_str!("../../../examples/head-3dof-apart.yaml");
const APART_FILES: &[(&str, &[u8])] = &[("data/rig.key", include_bytes!("../../../examples/data/rig.key"))];

/// The pipeline to use and the parameters to override.
#[derive(Args, Clone, Debug, Default)]
pub struct PipelineFile {
    /// The pipeline file. Default: `pipeline.yaml` in this folder, else the pipeline embedded in the command.
    pub file: Option<PathBuf>,
    /// Override a parameter: `--set operator.param=value`.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE")]
    pub sets: Vec<String>,
    /// The command runs one part of the pipeline. Without a file, the embedded pipeline in two programs is used.
    #[arg(skip)]
    pub in_parts: bool,
}

/// A pipeline that was read.
pub struct Source {
    /// Its text. Of a checked pipeline: with what it includes, and the values of the variables that its paths name.
    pub text: String,
    /// The arguments of `--set`, likewise.
    pub sets: Vec<String>,
    /// The variables of the environment that paths name, with their values, once the pipeline was checked.
    pub variables: BTreeMap<String, String>,
    /// The files that it includes, with their SHA-256, once the pipeline was checked.
    pub included: BTreeMap<String, String>,
    /// Name of its file: absolute, so that every process finds it.
    pub file: PathBuf,
    /// The files beside it.
    pub files: DiskFiles,
}

/// A pipeline that was read and checked.
pub struct Checked {
    /// The source.
    pub source: Source,
    /// The graph.
    pub graph: Arc<Graph>,
}

/// Why a pipeline is refused.
pub enum Refused {
    /// Its file cannot be read.
    Unreadable {
        /// The file, as the user named it.
        file: PathBuf,
        /// The reason.
        reason: std::io::Error,
    },
    /// It has faults.
    Faults(Faults),
}

impl Display for Refused {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unreadable { file, reason } => write!(f, "{}: {reason}; {NAME_ONE}", file.display()),
            Self::Faults(faults) => faults.fmt(f),
        }
    }
}

impl Refused {
    /// Ends the command: prints the reason as `check --json` does, or as text for people.
    pub fn end(self, json: bool) -> Ended {
        let faults = match self {
            Self::Unreadable { .. } if !json => return Err(Failure::wrong(self)),
            Self::Faults(faults) if !json => {
                errln!("{faults}");
                return Ok(Exit::Wrong);
            }
            Self::Unreadable { file, reason } => serde_json::json!([{
                "file": file, "line": 1, "column": 1, "start": 0, "end": 0,
                "code": Code::FileMissing.name(), "message": reason.to_string(), "help": NAME_ONE,
            }]),
            Self::Faults(faults) => faults.to_json(),
        };
        print_json(&serde_json::json!({ "pipeline": null, "operators": [], "faults": faults }))?;
        Ok(Exit::Wrong)
    }
}

/// Advice for a file that cannot be read.
const NAME_ONE: &str = "give the path of a pipeline file";

/// The bytes of a file. The file may have no end, so at most as many bytes are read as show that it is too long.
fn read(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MOST_BYTES as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl PipelineFile {
    /// Reads the file.
    pub fn read(&self) -> Result<Source, Refused> {
        let default = PathBuf::from("pipeline.yaml");
        let path = match &self.file {
            Some(path) => path.clone(),
            None if self.in_parts => {
                let file = PathBuf::from("head-3dof-apart.yaml");
                let files = DiskFiles::next_to(&file).carrying(APART_FILES);
                return Ok(self.source(APART.to_string(), file, files));
            }
            None if default.is_file() => default,
            None => {
                let files = DiskFiles::next_to(&default).carrying(EMBEDDED_FILES);
                return Ok(self.source(EMBEDDED.to_string(), default, files));
            }
        };
        let bytes = read(&path).map_err(|reason| Refused::Unreadable { file: path.clone(), reason })?;
        let text = config::text(bytes, &path.display().to_string()).map_err(Refused::Faults)?;
        let file = std::path::absolute(&path).unwrap_or(path);
        let files = DiskFiles::next_to(&file);
        Ok(self.source(text, file, files))
    }

    fn source(&self, text: String, file: PathBuf, files: DiskFiles) -> Source {
        Source {
            text,
            sets: self.sets.clone(),
            variables: BTreeMap::new(),
            included: BTreeMap::new(),
            file,
            files,
        }
    }

    /// The name of the file, as the user gave it.
    fn shown(&self) -> String {
        self.file.as_deref().unwrap_or(Path::new("pipeline.yaml")).display().to_string()
    }

    /// Reads and checks, and gives all values.
    pub fn resolve(&self, registry: &Registry, machine: &Machine) -> Result<Resolved, Refused> {
        let Source { text, sets, files, .. } = self.read()?;
        config::resolve_for(machine, &text, &self.shown(), &sets, registry, &files).map_err(Refused::Faults)
    }

    /// Reads and checks. Faults name the file as the user did.
    pub fn check(&self, registry: &Registry, machine: &Machine) -> Result<Checked, Refused> {
        let source = self.read()?;
        let name = self.shown();
        let Composed { graph, text, sets, variables, included } =
            config::compose_for(machine, &source.text, &name, &source.sets, registry, &source.files)
                .map_err(Refused::Faults)?;
        Ok(Checked { source: Source { text, sets, variables, included, ..source }, graph: Arc::new(graph) })
    }
}
