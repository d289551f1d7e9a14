//! `stillpoint log`

use std::path::Path;
use std::sync::atomic::Ordering;

use clap::Args;
use serde_json::json;
use stillpoint_pipeline::live::log::{Level, LogLine, read};
use stillpoint_pipeline::live::run_folder::is_going_on;

use crate::attach::Which;
use crate::exit::{Ended, Exit, Failure};
use crate::journals::LOOK;
use crate::signals::stop_flag;
use crate::subject::Of;

/// Print the log of a running pipeline or a session, by operator and level.
#[derive(Args)]
pub struct Log {
    #[command(flatten)]
    of: Of,
    /// Only lines about this operator or process.
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// Only lines of this level, and graver ones.
    #[arg(long, value_enum, default_value_t)]
    level: LevelName,
    /// Go on with new lines until the run ends.
    #[arg(long)]
    follow: bool,
    /// Print a line of JSON for each line.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum LevelName {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// Everything.
    #[default]
    Info,
}

impl LevelName {
    fn level(self) -> Level {
        match self {
            Self::Error => Level::Error,
            Self::Warn => Level::Warn,
            Self::Info => Level::Info,
        }
    }
}

impl Log {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let (folder, is_run) = match self.of.path() {
            // The log of a session stands beside its parts.
            Some(path) if path.is_file() => (path.parent().map(Path::to_path_buf).unwrap_or_default(), false),
            Some(path) => (path.to_owned(), false),
            None => {
                let card = Which { run: self.of.name() }.card()?;
                (card.root.parent().map(Path::to_path_buf).unwrap_or_default(), true)
            }
        };
        let mut printed = self.print(&lines(&folder)?);
        if self.follow && is_run {
            let stop = stop_flag()?;
            while is_going_on(&folder) && !stop.load(Ordering::Relaxed) {
                std::thread::sleep(LOOK);
                // The folder goes with its run.
                let Ok(all) = lines(&folder) else { break };
                printed += self.print(all.get(printed..).unwrap_or(&[]));
            }
        }
        Ok(Exit::Done)
    }

    /// Prints lines; gives how many there are, printed or not.
    fn print(&self, lines: &[LogLine]) -> usize {
        let begun = lines.first().map_or(0, |l| l.time);
        let is_asked = |l: &&LogLine| {
            l.level <= self.level.level() && self.operator.as_ref().is_none_or(|o| *o == l.operator)
        };
        for line in lines.iter().filter(is_asked) {
            if self.json {
                outln!("{}", json!(line));
            } else {
                let seconds = line.time.saturating_sub(begun) as f64 * 1e-9;
                outln!("{seconds:>10.3} s  {:<5}  {:<16} {}", line.level.word(), line.operator, line.message);
            }
        }
        lines.len()
    }
}

fn lines(folder: &Path) -> Result<Vec<LogLine>, Failure> {
    read(folder).map_err(|e| {
        Failure::failed(format!(
            "{}: it keeps no log ({e}); a live run keeps one, a simulated run does not",
            folder.display()
        ))
    })
}
