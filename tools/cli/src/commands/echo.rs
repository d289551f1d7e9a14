//! `stillpoint echo`

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, SampleKind};

use crate::attach::Which;
use crate::exit::{Ended, Exit, Failure};
use crate::number::Angles;
use crate::path::ValuePath;
use crate::recorded::with_topics;
use crate::signals::stop_flag;
use crate::tap::{Tap, no_topic};
use crate::{screen, show};

/// Print the samples of a topic of a running pipeline or a session: codes in words, values with their units.
#[derive(Args)]
pub struct Echo {
    /// The topic: `operator.port`; `operator.journal` for a journal; `operator.timing` for laps.
    topic: String,
    /// Values to print instead of the whole sample, a line a sample: `pose.z`, `covariance[2][2]`, `reasons`.
    #[arg(value_name = "PATH")]
    paths: Vec<String>,
    /// End after this number of samples.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Print angles in degrees; samples have them in rad.
    #[arg(long, conflicts_with = "json")]
    degrees: bool,
    /// Print a line of JSON for each sample: numbers as the sample has them, and `words` of codes.
    #[arg(long)]
    json: bool,
    /// Read a session instead of a running pipeline.
    #[arg(long, value_name = "SESSION")]
    session: Option<PathBuf>,
    #[command(flatten)]
    which: Which,
}

/// How samples of one kind are printed.
struct Printer<'a> {
    echo: &'a Echo,
    kind: &'static SampleKind,
    paths: Vec<ValuePath>,
}

impl Echo {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        match &self.session {
            Some(path) => self.recorded(path),
            None => self.live(registry),
        }
    }

    fn recorded(&self, path: &std::path::Path) -> Ended {
        let session = with_topics(Session::open(path), path)?;
        let names = || session.topics().iter().map(|t| t.name.as_str());
        let Some(number) = session.topic_number(&self.topic) else {
            return Err(no_topic(&self.topic, names()));
        };
        let Some(kind) = session.topics()[number].kind.kind() else {
            let (path, topic) = (path.display(), &self.topic);
            return Err(Failure::failed(format!(
                "{path}: `{topic}` has messages of another program, which `echo` cannot read"
            )));
        };
        let printer = Printer::new(self, kind)?;
        let limit = usize::try_from(self.count.unwrap_or(u64::MAX)).unwrap_or(usize::MAX);
        for recorded in session.samples_where(|t| t.name == self.topic).take(limit) {
            let recorded = recorded.map_err(Failure::failed)?;
            let sample = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
            if !print(&printer.text(sample)) {
                break;
            }
        }
        Ok(Exit::Done)
    }

    fn live(&self, registry: &Registry) -> Ended {
        let attached = self.which.attach(registry)?;
        let (tap, kind) = Tap::of_topic(&attached, &self.topic)?;
        let printer = Printer::new(self, kind)?;
        let stop = stop_flag()?;
        let mut shown = 0;
        loop {
            // Asked before the look: what was sent until the end is shown, too.
            let over = stop.load(Ordering::Relaxed) || !self.which.is_going_on(&attached.root);
            // Polled: a listener would cost the publisher time.
            while let Some(sample) = tap.next()? {
                let text = printer.text(sample.pieces());
                // Back to its publisher before a slow reader is waited for.
                drop(sample);
                if !print(&text) {
                    return Ok(Exit::Done);
                }
                shown += 1;
                if self.count.is_some_and(|count| shown >= count) {
                    return Ok(Exit::Done);
                }
            }
            if over {
                return Ok(Exit::Done);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl<'a> Printer<'a> {
    fn new(echo: &'a Echo, kind: &'static SampleKind) -> Result<Self, Failure> {
        let paths = echo.paths.iter().map(|text| ValuePath::new(text, kind)).collect::<Result<_, _>>();
        Ok(Self { echo, kind, paths: paths.map_err(Failure::wrong)? })
    }

    fn text(&self, sample: Pieces<'_>) -> String {
        let angles = if self.echo.degrees { Angles::Degrees } else { Angles::Radians };
        match (self.echo.json, self.paths.is_empty()) {
            (true, true) => show::to_json(self.kind, sample).to_string(),
            (true, false) => show::values_json(self.kind, sample, &self.paths).to_string(),
            (false, true) => screen::of_sample(&self.echo.topic, self.kind, sample, angles) + "\n",
            (false, false) => screen::of_values(self.kind, sample, &self.paths, angles),
        }
    }
}

/// Prints a line. False if the reader of standard output has gone.
fn print(text: &str) -> bool {
    crate::output::out(format_args!("{text}\n"))
}
