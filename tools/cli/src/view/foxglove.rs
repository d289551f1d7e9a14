//! A run or a session in viewers such as Foxglove. Their server is a program of its own; this one hands over what is shown:
//! the newest state of a run as it comes, and of a session what lies in the time that viewers play.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Lines};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use stillpoint_pipeline::limits::start_thread;
use stillpoint_pipeline::live::log::{self, LogLine};
use stillpoint_viewer::{Asked, PipeError, Shown, Topic, write};

use super::messages::{Frames, line, state};
use super::past::Past;
use super::served::Served;
use crate::exit::Failure;
use crate::journals::LOOK;

/// How long the server is waited for.
const SILENCE: Duration = Duration::from_secs(5);
/// How long an image is waited for before its topics are looked at again.
const IMAGE: Duration = Duration::from_secs(1);
/// Interval of the figures of a session while it plays, ns of session time.
const FIGURES: u64 = 500_000_000;
/// How long the image of a time that was sought is waited for, while a replay computes it.
const COMPUTED: Duration = Duration::from_secs(10);
/// Lines of the log that a viewer gets that comes later.
const LINES: usize = 200;

/// Starts the server of viewers at a port of this machine, 0 for any, and gives the port. `lost` is set when the server ends
/// by itself, and `stop` with it.
///
/// # Errors
/// The server does not start: it prints why.
pub fn serve(
    mut program: Command,
    port: u16,
    served: &Arc<Served>,
    folder: PathBuf,
    [stop, lost]: [&Arc<AtomicBool>; 2],
) -> Result<u16, Failure> {
    // Ctrl-C is for this program; the server ends with its input.
    program.arg("foxglove").process_group(0);
    let started = program.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut server =
        started.map_err(|e| Failure::failed(format!("stillpoint-bridge cannot be started: {e}")))?;
    let (Some(mut input), Some(output)) = (server.stdin.take(), server.stdout.take()) else {
        return Err(Failure::failed("stillpoint-bridge has no pipes"));
    };
    let name = served.about["pipeline"].as_str().unwrap_or_default().to_owned();
    let range = served.past.as_ref().map(Past::range);
    // Where the server is gone already, its line is missing.
    let _ = write(&mut input, &Shown::Begin { name, port, range }, &[]);
    let mut asks = BufReader::new(output).lines();
    let Some(Asked::Listening(bound)) = next(&mut asks) else {
        let _ = server.wait();
        return Err(Failure::failed("the server of viewers ended at its start; its reason is printed above"));
    };
    let frames = Frames::of(&served.about);
    let feed = Arc::new(Feed {
        served: served.clone(),
        frames,
        folder,
        input: Mutex::new(input),
        topics: Mutex::default(),
    });
    let (sender, plays) = channel();
    let mut threads: Vec<Box<dyn FnOnce() + Send>> = Vec::new();
    let (of_asks, flags) = (feed.clone(), [stop.clone(), lost.clone()]);
    threads.push(Box::new(move || {
        of_asks.listen(asks, sender, server);
        flags.iter().rev().for_each(|flag| flag.store(true, Ordering::Relaxed));
    }));
    if feed.served.past.is_some() {
        threads.push(Box::new(move || drop(feed.play(&plays))));
    } else {
        let images = feed.clone();
        threads.push(Box::new(move || drop(images.images())));
        threads.push(Box::new(move || drop(feed.follow())));
    }
    for thread in threads {
        start_thread(thread)
            .map_err(|e| Failure::failed(format!("a thread that feeds viewers cannot be started: {e}")))?;
    }
    Ok(bound)
}

/// The next line of the server; none at its end, or where it is of another build.
fn next(asks: &mut Lines<BufReader<ChildStdout>>) -> Option<Asked> {
    serde_json::from_str(&asks.next()?.ok()?).ok()
}

/// What the server is fed from. A thread that feeds it ends when the server is gone.
struct Feed {
    served: Arc<Served>,
    frames: Frames,
    /// Folder of the run or of the session, for its log.
    folder: PathBuf,
    input: Mutex<ChildStdin>,
    /// The topics that are subscribed to.
    topics: Mutex<BTreeSet<Topic>>,
}

impl Feed {
    fn topics(&self) -> BTreeSet<Topic> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn shows_images(&self) -> bool {
        let topics = self.topics();
        topics.contains(&Topic::Image) || topics.contains(&Topic::Face)
    }

    fn send(&self, shown: &Shown, bytes: &[u8]) -> Result<(), PipeError> {
        let mut input = self.input.lock().unwrap_or_else(PoisonError::into_inner);
        write(&mut *input, shown, bytes)
    }

    fn send_all(&self, all: impl IntoIterator<Item = Shown>) -> Result<(), PipeError> {
        all.into_iter().try_for_each(|shown| self.send(&shown, &[]))
    }

    /// Takes what viewers ask for until the server ends.
    fn listen(
        &self,
        mut asks: Lines<BufReader<ChildStdout>>,
        plays: Sender<(u64, u64, bool)>,
        mut server: Child,
    ) {
        while let Some(asked) = next(&mut asks) {
            match asked {
                Asked::Topics(topics) => {
                    *self.topics.lock().unwrap_or_else(PoisonError::into_inner) = topics;
                }
                Asked::Play { from, to, is_seek } => drop(plays.send((from, to, is_seek))),
                Asked::Listening(_) => {}
            }
        }
        let _ = server.wait();
    }

    /// Feeds a run.
    fn follow(&self) -> Result<(), PipeError> {
        let (mut number, mut row, mut time) = (0, 0, self.served.base);
        let mut log = Log::default();
        loop {
            let (text, rows, is_over) = {
                let now = self.served.wait(number, row, SILENCE);
                let text = (now.number != number).then(|| now.state.clone());
                let (rows, next) = now.rows_from(row);
                (number, row) = (now.number, next);
                (text, rows, now.is_over)
            };
            for row in &rows {
                time = self.time(row.t);
                self.send_all(self.frames.row(time, row))?;
            }
            if let Some(text) = &text {
                self.send_all(self.frames.camera(time))?;
                self.send_all(state(time, text))?;
                let wants = self.topics().contains(&Topic::Log);
                self.send_all(log.lines(&self.folder, wants).iter().map(line))?;
            }
            if is_over {
                return Ok(());
            }
        }
    }

    /// Feeds the images of a run, while somebody looks.
    fn images(&self) -> Result<(), PipeError> {
        let mut newest = 0;
        while !self.served.now().is_over {
            if !self.shows_images() {
                std::thread::sleep(LOOK);
                continue;
            }
            if let Some((number, picture)) = self.served.picture_after(newest, IMAGE) {
                newest = number;
                self.picture(&picture)?;
            }
        }
        Ok(())
    }

    fn picture(&self, picture: &super::picture::Picture) -> Result<(), PipeError> {
        let Some(camera) = &self.served.camera else { return Ok(()) };
        // An image that cannot be drawn is left out, as on the page.
        let Ok(drawn) = picture.drawn(camera) else { return Ok(()) };
        let all = self.frames.picture(picture.origin, drawn);
        all.iter().try_for_each(|(shown, bytes)| self.send(shown, bytes))
    }

    /// Feeds a session: what viewers play.
    fn play(&self, plays: &Receiver<(u64, u64, bool)>) -> Result<(), PipeError> {
        let Some(past) = &self.served.past else { return Ok(()) };
        let (rows, _) = self.served.now().rows_from(0);
        let log = log::read(&self.folder).unwrap_or_default();
        let (mut image, mut figures) = (None, 0);
        while let Ok((from, to, is_seek)) = plays.recv() {
            let up_to = rows.partition_point(|row| self.time(row.t) <= to);
            let begun = match is_seek {
                true => up_to.saturating_sub(1),
                false => rows.partition_point(|row| self.time(row.t) <= from),
            };
            self.send_all(self.frames.camera(to))?;
            for row in &rows[begun.min(up_to)..up_to] {
                // The state at a time that was sought has that time.
                let time = if is_seek { to } else { self.time(row.t) };
                self.send_all(self.frames.row(time, row))?;
            }
            let t = to.saturating_sub(self.served.base) as f64 * 1e-9;
            if self.shows_images()
                && let Some(picture) = found(past, t, is_seek)
                && (is_seek || image != Some(picture.origin))
            {
                image = Some(picture.origin);
                self.picture(&picture)?;
            }
            if self.topics().contains(&Topic::State) && (is_seek || to.abs_diff(figures) >= FIGURES) {
                figures = to;
                self.send_all(past.state(t).iter().flat_map(|text| state(to, text)))?;
            }
            let before = log.partition_point(|line| line.time <= to);
            let first = match is_seek {
                true => before.saturating_sub(LINES),
                false => log.partition_point(|line| line.time <= from),
            };
            self.send_all(log[first.min(before)..before].iter().map(line))?;
            self.send(&Shown::Played, &[])?;
        }
        Ok(())
    }

    fn time(&self, t: f64) -> u64 {
        self.served.base.saturating_add((t.max(0.0) * 1e9).round() as u64)
    }
}

/// The image at a time of a session. That of a time that was sought is waited for while a replay computes it.
fn found(past: &Past, t: f64, waits: bool) -> Option<super::picture::Picture> {
    let begun = Instant::now();
    loop {
        let found = past.picture(t);
        let is_final = found.as_ref().is_some_and(|(_, is_final)| *is_final);
        if is_final || !waits || !past.computes_images() || begun.elapsed() >= COMPUTED {
            return found.map(|(picture, _)| picture);
        }
        std::thread::sleep(LOOK);
    }
}

/// The log of a run as far as viewers have it.
#[derive(Default)]
struct Log {
    seen: usize,
}

impl Log {
    /// The lines that are new, if somebody reads them: at first the last ones.
    fn lines(&mut self, folder: &std::path::Path, wants: bool) -> Vec<LogLine> {
        if !wants {
            self.seen = 0;
            return Vec::new();
        }
        let mut lines = log::read(folder).unwrap_or_default();
        let all = lines.len();
        let first = if self.seen == 0 { all.saturating_sub(LINES) } else { self.seen.min(all) };
        self.seen = all;
        lines.split_off(first)
    }
}
