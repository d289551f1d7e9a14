//! `stillpoint manual`: the documents that are made of the command's own help.

use std::path::PathBuf;

use clap::{Args, Command, CommandFactory, Subcommand};
use clap_complete::Shell;

use crate::Arguments;
use crate::exit::{Ended, Exit, Failure};

/// Name of the program in completions and pages.
const NAME: &str = "stillpoint";

/// Write completions for shells, man pages, or the reference page of the command.
#[derive(Args)]
pub struct Manual {
    #[command(subcommand)]
    document: Document,
}

#[derive(Subcommand)]
enum Document {
    /// Print the completions for a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Write a man page for each subcommand into a folder.
    Man {
        /// The folder; it is made if it is not there.
        folder: PathBuf,
    },
    /// Print the help of all subcommands as one Markdown page.
    Page,
}

impl Manual {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.document {
            Document::Completions { shell } => {
                let mut text = Vec::new();
                clap_complete::generate(*shell, &mut Arguments::command(), NAME, &mut text);
                out!("{}", String::from_utf8_lossy(&text));
            }
            Document::Man { folder } => {
                std::fs::create_dir_all(folder)
                    .and_then(|()| clap_mangen::generate_to(Arguments::command(), folder))
                    .map_err(|error| Failure::failed(format!("{}: {error}", folder.display())))?;
            }
            Document::Page => out!("{}", page()),
        }
        Ok(Exit::Done)
    }
}

/// The reference page: one section for each subcommand, with its help as `--help` prints it.
fn page() -> String {
    let mut page = String::from(
        "# The command\n\nThis page is generated from `--help`. [Exit codes](exit-codes.md) are the same for all subcommands.\n",
    );
    let mut command = Arguments::command().term_width(110);
    command.build();
    section(&mut page, &mut command, 2);
    page
}

fn section(page: &mut String, command: &mut Command, level: usize) {
    let help = command.render_long_help().to_string();
    let lines: Vec<&str> = help.lines().map(str::trim_end).collect();
    let name = command.get_bin_name().unwrap_or(NAME).to_owned();
    page.push_str(&format!(
        "\n{} {name}\n\n```text\n{}\n```\n",
        "#".repeat(level),
        lines.join("\n").trim_end()
    ));
    let shown = |inner: &&mut Command| !inner.is_hide_set() && inner.get_name() != "help";
    for inner in command.get_subcommands_mut().filter(shown) {
        section(page, inner, (level + 1).min(4));
    }
}
