//! `stillpoint top`

use std::io::IsTerminal;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use ratatui::crossterm::event::{Event, KeyEventKind, poll, read};
use stillpoint_operator::Registry;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::log::{self, LogLine};
use stillpoint_pipeline::live::run_folder::is_going_on;
use stillpoint_recorder::Session;
use stillpoint_report::pipeline_of;
use stillpoint_samples::Pieces;

use super::hz::watched;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::journals::LOOK;
use crate::number::Angles;
use crate::screen;
use crate::settings::Values;
use crate::signals::stop_flag;
use crate::subject::{Of, Subject};
use crate::tap::Tap;
use crate::top::{Panel, Snapshot, View, Watch, draw, plain};

/// Interval at which the screen is drawn.
const DRAWN: Duration = Duration::from_millis(500);
/// Lines of the log that an open operator shows.
const LINES: usize = 5;
/// Interval at which keys are looked for.
const KEYS: Duration = Duration::from_millis(20);

/// Show what a pipeline does: operators, edges, processes, how the head is held, the recording, and what is wrong.
#[derive(Args)]
pub struct Top {
    #[command(flatten)]
    of: Of,
    /// Print the state once, in place of a screen that goes on.
    #[arg(long)]
    once: bool,
    /// The time over which rates, latencies and losses are measured.
    #[arg(long = "for", value_name = "TIME", default_value = "2s")]
    time: String,
    /// Print JSON; only with --once.
    #[arg(long, requires = "once")]
    json: bool,
}

impl Top {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let window = watched(&self.time)?;
        let subject = self.of.open(registry)?;
        let of = subject.of();
        match subject {
            Subject::Session(path, session) => {
                let (graph, _) = pipeline_of(&session, registry)?;
                let snapshot = Snapshot::of_session(of, &path, &session, &graph);
                if self.is_once() {
                    return self.print(&snapshot);
                }
                screen_of(&mut Source::Session {
                    path: &path,
                    snapshot: Box::new(snapshot),
                    session: &session,
                    graph: &graph,
                })
            }
            Subject::Run(attached) => {
                let mut watch = Watch::open(*attached, window)?;
                if self.is_once() {
                    let begun = Instant::now();
                    while begun.elapsed() < window && is_going_on(&watch.attached.folder()) {
                        watch.look()?;
                        std::thread::sleep(LOOK);
                    }
                    return self.print(&watch.snapshot()?);
                }
                screen_of(&mut Source::Run(Box::new(watch)))
            }
        }
    }

    /// Without a terminal there is no screen.
    fn is_once(&self) -> bool {
        self.once || !std::io::stdout().is_terminal()
    }

    fn print(&self, snapshot: &Snapshot) -> Ended {
        if self.json {
            print_json(snapshot)?;
        } else {
            out!("{}", plain(snapshot));
        }
        Ok(Exit::Done)
    }
}

/// Where the screen takes its figures from.
enum Source<'a> {
    Run(Box<Watch>),
    Session { path: &'a Path, snapshot: Box<Snapshot>, session: &'a Session, graph: &'a Graph },
}

impl Source<'_> {
    fn snapshot(&mut self) -> Result<Snapshot, Failure> {
        match self {
            Self::Run(watch) => watch.snapshot(),
            Self::Session { snapshot, .. } => Ok(Snapshot::clone(snapshot)),
        }
    }

    fn is_over(&self) -> bool {
        matches!(self, Self::Run(watch) if !is_going_on(&watch.attached.folder()))
    }

    fn look(&mut self) -> Result<(), Failure> {
        match self {
            Self::Run(watch) => watch.look(),
            Self::Session { .. } => Ok(()),
        }
    }

    /// The parameters of an operator, and the last sample of each of its outputs.
    fn detail(&self, taps: &[(&'static stillpoint_samples::SampleKind, Tap)], name: &str) -> Vec<String> {
        let graph = match self {
            Self::Run(watch) => &watch.attached.graph,
            Self::Session { graph, .. } => graph,
        };
        let Some(node) = graph.operators.iter().find(|o| o.name == name) else { return Vec::new() };
        let mut lines = vec![format!("{}: parameters", node.stage.kind.name)];
        let number = graph.operator(name).unwrap_or_default();
        let rows = match self {
            Self::Run(watch) => watch.settings.rows(number, node),
            Self::Session { session, .. } => Values::of_session(session, graph).rows(number, node),
        };
        lines.extend(rows.iter().map(|row| format!("  {}", row.text())));
        for line in self.last_lines(name) {
            lines.push(format!("log: {} {}", line.level.word(), line.message));
        }
        match self {
            Self::Run(_) => {
                for (kind, tap) in taps {
                    let mut last = None;
                    while let Ok(Some(sample)) = tap.next() {
                        last = Some(sample);
                    }
                    match last {
                        Some(sample) => {
                            let text = screen::of_sample(&tap.name, kind, sample.pieces(), Angles::Degrees);
                            lines.extend(text.lines().map(str::to_owned));
                        }
                        None => lines.push(format!("{}: no new sample", tap.name)),
                    }
                }
            }
            Self::Session { session, .. } => {
                for output in &node.outputs {
                    lines.extend(last_recorded(session, &output.topic));
                }
            }
        }
        lines
    }

    /// The last lines of the log about an operator.
    fn last_lines(&self, name: &str) -> Vec<LogLine> {
        let folder = match self {
            Self::Run(watch) => watch.attached.folder(),
            Self::Session { path, .. } => path.to_path_buf(),
        };
        let mut all = log::read(&folder).unwrap_or_default();
        all.retain(|line| line.operator == name);
        all.split_off(all.len().saturating_sub(LINES))
    }

    /// Subscriptions to the outputs of an operator of a run.
    fn taps(&self, name: &str) -> Vec<(&'static stillpoint_samples::SampleKind, Tap)> {
        let Self::Run(watch) = self else { return Vec::new() };
        let graph = &watch.attached.graph;
        let Some(operator) = graph.operator(name) else { return Vec::new() };
        let ports = graph.operators[operator].stage.kind.outputs;
        let taps = ports.iter().enumerate();
        taps.filter_map(|(port, of)| Some((of.sample, Tap::open(&watch.attached, operator, port).ok()?)))
            .collect()
    }
}

fn last_recorded(session: &Session, topic: &str) -> Vec<String> {
    let last = session.topic_number(topic).and_then(|number| {
        let (incarnation, sequence) = session.numbers(number).next_back()?;
        let kind = session.topics()[number].kind.kind()?;
        let recorded = session.sample(number, incarnation, sequence).ok()??;
        let pieces = Pieces::split(kind, &recorded.sample).ok()?;
        Some(screen::of_sample(topic, kind, pieces, Angles::Degrees))
    });
    match last {
        Some(text) => text.lines().map(str::to_owned).collect(),
        None => vec![format!("{topic}: not recorded")],
    }
}

/// Shows the screen until a key ends it, or the run ends.
fn screen_of(source: &mut Source<'_>) -> Ended {
    let mut terminal = ratatui::try_init().map_err(Failure::failed)?;
    let shown = keep_showing(source, &mut terminal);
    ratatui::try_restore().map_err(Failure::failed)?;
    if shown? {
        outln!("the run has ended");
    }
    Ok(Exit::Done)
}

/// True if the run has ended.
fn keep_showing(source: &mut Source<'_>, terminal: &mut ratatui::DefaultTerminal) -> Result<bool, Failure> {
    // A terminal that closes, too, ends the screen in order: its ports are given back.
    let stop = stop_flag()?;
    let mut view = View::default();
    let mut snapshot = source.snapshot()?;
    let (mut drawn, mut opened, mut taps) = (None::<Instant>, None::<String>, Vec::new());
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        if source.is_over() {
            return Ok(true);
        }
        source.look()?;
        let open = view.open.clone().filter(|_| view.panel == Panel::Operator);
        if open != opened {
            taps = open.as_deref().map(|name| source.taps(name)).unwrap_or_default();
            opened.clone_from(&open);
            drawn = None;
        }
        if drawn.is_none_or(|at| at.elapsed() >= DRAWN) {
            if !view.paused {
                snapshot = source.snapshot()?;
                if let Some(name) = &open {
                    view.detail = source.detail(&taps, name);
                }
            }
            terminal.draw(|frame| draw(frame, &snapshot, &view)).map_err(Failure::failed)?;
            drawn = Some(Instant::now());
        }
        if poll(KEYS).map_err(Failure::failed)? {
            if let Event::Key(key) = read().map_err(Failure::failed)?
                && key.kind == KeyEventKind::Press
            {
                let is_interrupt = key.modifiers.contains(ratatui::crossterm::event::KeyModifiers::CONTROL)
                    && key.code == ratatui::crossterm::event::KeyCode::Char('c');
                if is_interrupt || !view.key(key.code, &snapshot) {
                    return Ok(false);
                }
            }
            drawn = None;
        }
    }
}
