//! `stillpoint new`

mod operator;
mod templates;

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use stillpoint_operator::Registry;
use stillpoint_operator::config::near::{is_name, shown};
use stillpoint_pipeline::config::Machine;
use stillpoint_pipeline::config::schema::schema;

use crate::exit::{Ended, Exit, Failure};
use crate::pipeline_file::PipelineFile;
use crate::private;

/// Make a folder with a commented pipeline of your own. By default a simulated rig is held, as in the default pipeline, with
/// a key of its own. What is written has passed `stillpoint check`.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct New {
    #[command(subcommand)]
    other: Option<Other>,
    /// Name of the pipeline and of its folder.
    #[arg(required = true)]
    name: Option<String>,
    /// Read these recorded files: depth images (`scans/*.png`), point clouds (`*.pcd`, `*.ply`) or a recording (`ride.mcap`).
    #[arg(long, value_name = "FILES", conflicts_with = "camera")]
    files: Option<PathBuf>,
    /// The topic of clouds or depth images in the MCAP recording.
    #[arg(long, value_name = "TOPIC", requires = "files")]
    topic: Option<String>,
    /// Take the depth images of this topic of ROS 2.
    #[arg(long, value_name = "TOPIC")]
    camera: Option<String>,
}

/// What is made in place of a pipeline.
#[derive(Subcommand)]
enum Other {
    Operator(operator::NewOperator),
}

/// Name of the file of the pipeline: `stillpoint run` finds it in its folder.
const FILE: &str = "pipeline.yaml";
/// Name of the file of the schema.
const SCHEMA: &str = "pipeline.schema.json";
/// Bytes of a key.
const KEY_BYTES: usize = 32;

impl New {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        if let Some(Other::Operator(operator)) = &self.other {
            return operator.execute();
        }
        let name = checked_name(self.name.as_deref().unwrap_or_default())?;
        let text = match (&self.files, &self.camera) {
            (Some(files), _) => templates::reading(name, &absolute(files)?, self.topic.as_deref())?,
            (None, Some(topic)) => templates::camera(name, topic),
            (None, None) => templates::rig(name),
        };
        let folder = Path::new(name);
        let failed = |e: std::io::Error| match e.kind() {
            ErrorKind::AlreadyExists => Failure::failed(format!("{name}: it exists; choose another name")),
            _ => Failure::failed(format!("{name}: {e}")),
        };
        std::fs::create_dir(folder).map_err(failed)?;
        let file = folder.join(FILE);
        let written = self.write(folder, &text, registry);
        let given = PipelineFile { file: Some(file.clone()), ..PipelineFile::default() };
        let checked = written.map_err(failed).map(|()| given.check(registry, &Machine::here()));
        if !matches!(checked, Ok(Ok(_))) {
            // The folder is this command's own: it was made above.
            let _ = std::fs::remove_dir_all(folder);
        }
        if let Err(refused) = checked? {
            errln!("{name}: nothing was written, because the pipeline would have faults:");
            return refused.end(false);
        }
        outln!("{}: it has passed `stillpoint check`", file.display());
        outln!("{}", self.next(name));
        Ok(Exit::Done)
    }

    /// Writes the pipeline, the schema by which an editor helps with it, and its key where it has one.
    fn write(&self, folder: &Path, text: &str, registry: &Registry) -> std::io::Result<()> {
        let head = format!("# yaml-language-server: $schema={SCHEMA}\n");
        std::fs::write(folder.join(FILE), head + text)?;
        let schema = serde_json::to_string_pretty(&schema(registry))?;
        std::fs::write(folder.join(SCHEMA), schema + "\n")?;
        if text.contains(templates::KEY) { draw_key(&folder.join(templates::KEY)) } else { Ok(()) }
    }

    /// What a person does next.
    fn next(&self, name: &str) -> String {
        match (&self.files, &self.camera) {
            (Some(_), _) => format!(
                "next: state place and calibration of your camera in it, then `cd {name}` and `stillpoint run --clock simulated`"
            ),
            (None, Some(_)) => format!(
                "next: state the place of your camera and the router in it, then `cd {name}` and `stillpoint run`"
            ),
            (None, None) => format!("next: `cd {name}` and `stillpoint run --for 20s`"),
        }
    }
}

/// A name of a pipeline and its folder, or of a crate.
fn checked_name(name: &str) -> Result<&str, Failure> {
    if is_name(&name.replace('-', "_")) {
        return Ok(name);
    }
    Err(Failure::wrong(format!(
        "invalid name {} (allowed: up to 40 lower-case letters, digits, `_` and `-`, a letter first)",
        shown(name)
    )))
}

/// The path of files, from the root: the pipeline stands in another folder.
fn absolute(files: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(files).map_err(|e| Failure::failed(format!("{}: {e}", files.display())))
}

/// Draws a key that only its owner may read.
fn draw_key(path: &Path) -> std::io::Result<()> {
    let mut bytes = [0_u8; KEY_BYTES];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    writeln!(private::create(path)?, "{digits}")
}
