//! `stillpoint new operator`

use std::path::{Path, PathBuf};

use clap::Args;

use super::checked_name;
use crate::exit::{Ended, Exit, Failure};

const CARGO: &str = include_str!("crate_of_operator/Cargo.toml.txt");
const MAIN: &str = include_str!("crate_of_operator/main.rs");
const PIPELINE: &str = include_str!("crate_of_operator/pipeline.yaml");

/// The crate that the program depends on, in the sources of stillpoint.
const LIBRARY: &str = "pipeline/operator";

/// Make a crate with an operator of your own in Rust, its tests, and a pipeline that uses it. It builds to a program that
/// pipelines start, without a build of stillpoint.
#[derive(Args)]
pub struct NewOperator {
    /// Name of the crate and of its folder.
    name: String,
    /// The folder with the sources of stillpoint of the version of this command. The crate depends on one library in it.
    #[arg(long, value_name = "FOLDER")]
    stillpoint: PathBuf,
}

impl NewOperator {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let name = checked_name(&self.name)?;
        let library = std::path::absolute(self.stillpoint.join(LIBRARY)).map_err(Failure::failed)?;
        if !library.join("Cargo.toml").is_file() {
            return Err(Failure::wrong(format!(
                "{}: the sources of stillpoint are not there: it has no {LIBRARY}/Cargo.toml; give the folder of a checkout or of \
                 an unpacked source archive",
                self.stillpoint.display()
            )));
        }
        let folder = Path::new(name);
        let failed = |e: std::io::Error| Failure::failed(format!("{name}: {e}"));
        std::fs::create_dir(folder).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => {
                Failure::failed(format!("{name}: it exists; choose another name"))
            }
            _ => failed(e),
        })?;
        let path = library.display().to_string().replace('\\', "\\\\").replace('"', "\\\"");
        let filled = |text: &str| {
            text.replace("my.KIND", &format!("my.{}", name.replace('-', "_"))).replace("NAME", name)
        };
        std::fs::create_dir(folder.join("src")).map_err(failed)?;
        for (file, text) in [
            ("Cargo.toml", filled(CARGO).replace("PATH", &path)),
            ("src/main.rs", filled(MAIN)),
            ("pipeline.yaml", filled(PIPELINE)),
            (".gitignore", "target\nsessions\n".to_owned()),
        ] {
            std::fs::write(folder.join(file), text).map_err(failed)?;
        }
        outln!("{name}: a crate with an operator, its tests, and a pipeline that uses it");
        outln!(
            "next: `cd {name}`, `cargo test`, `cargo build --release` and `stillpoint run --clock simulated --for 10s`"
        );
        Ok(Exit::Done)
    }
}
