//! What is served of a running pipeline.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::run_folder::is_going_on;
use stillpoint_report::graph::svg;
use stillpoint_samples::AlignedBytes;

use super::figures::{Slow, state};
use super::picture::Picture;
use super::rows::Rows;
use super::scene::{Camera, Says, Scene};
use super::served::Served;
use crate::attach::Attached;
use crate::exit::Failure;
use crate::journals::LOOK;
use crate::rates::of_run;
use crate::tap::Tap;
use crate::top::Watch;

/// Interval at which the state is made.
const MADE: Duration = Duration::from_millis(500);
/// Interval at which paths, ledger and log are read.
const SLOW: Duration = Duration::from_secs(2);
/// Interval of the rows, ns.
const ROWS: u64 = 100_000_000;
/// How long an image waits for the face in it, ns.
const FACE_PATIENCE: u64 = 300_000_000;
/// Images and faces that wait for each other.
const RETAINED: usize = 12;

/// Serves a run from its begin to its end, or until `stop`. `begin` starts the server, with what does not change.
pub fn follow(
    attached: Attached,
    window: Duration,
    registry: &Registry,
    stop: &AtomicBool,
    begin: impl FnOnce(Served) -> Result<Arc<Served>, Failure>,
) -> Result<(), Failure> {
    let scene = Scene::of(&attached.graph);
    let card = &attached.card;
    let whole = config::check(&card.source, &card.file, &card.sets, registry, &card.files).ok();
    let mut taps = Taps::open(&attached, &scene)?;
    let mut about = scene.about(&attached.graph);
    about["of"] = of_run(&attached);
    about["pipeline"] = json!(attached.graph.name);
    about["follows"] = json!(true);
    let folder = attached.folder();
    let mut watch = Watch::open(attached, window)?;
    // The first sample sets the base of times.
    let begun = Instant::now();
    while taps.rows.base() == 0 && begun.elapsed() < MADE {
        taps.look_at_rows();
        watch.look()?;
        std::thread::sleep(LOOK);
    }
    if taps.rows.base() == 0 {
        taps.rows = Rows::every(ROWS, Some(stillpoint_pipeline::clock::realtime()));
    }
    let base = taps.rows.base();
    let mut slow = Slow::of(&watch.trace(), watch.ledger(), &folder);
    let served = Served { about, camera: scene.camera, base, ..Served::default() };
    put(&served, &mut watch, &slow, whole.as_ref())?;
    let served = begin(served)?;
    let (mut made, mut made_slow) = (Instant::now(), Instant::now());
    while !stop.load(Ordering::Relaxed) && is_going_on(&folder) {
        watch.look()?;
        taps.look_at_rows();
        served.add(taps.rows.made());
        if served.shows_images() {
            taps.look_at_images(&served);
        }
        if made_slow.elapsed() >= SLOW {
            made_slow = Instant::now();
            slow = Slow::of(&watch.trace(), watch.ledger(), &folder);
        }
        if made.elapsed() >= MADE {
            made = Instant::now();
            put(&served, &mut watch, &slow, whole.as_ref())?;
        }
        std::thread::sleep(LOOK);
    }
    served.end();
    // The streams report the end.
    std::thread::sleep(10 * LOOK);
    Ok(())
}

fn put(served: &Served, watch: &mut Watch, slow: &Slow, whole: Option<&Graph>) -> Result<(), Failure> {
    let snapshot = watch.snapshot()?;
    served.put(state(&snapshot, slow, served.base).map_err(Failure::failed)?, svg(&watch.drawing(whole)));
    Ok(())
}

/// The topics of a run that are shown.
struct Taps {
    small: Vec<(Says, Tap)>,
    rows: Rows,
    images: Option<Images>,
}

/// Images and faces as they come.
struct Images {
    image: Tap,
    face: Option<Tap>,
    piece: Option<Tap>,
    images: Retained,
    faces: Retained,
    pieces: Retained,
}

/// Samples with their origin.
type Retained = VecDeque<(u64, AlignedBytes)>;

impl Taps {
    fn open(attached: &Attached, scene: &Scene) -> Result<Self, Failure> {
        let open = |(operator, output)| Tap::open(attached, operator, output);
        let small = scene.topics.iter().map(|(says, port)| Ok((*says, open(*port)?)));
        let images = |camera: &Camera| {
            Ok::<_, Failure>(Images {
                image: open(camera.image)?,
                face: camera.face.map(open).transpose()?,
                piece: camera.pieces.map(open).transpose()?,
                images: VecDeque::new(),
                faces: VecDeque::new(),
                pieces: VecDeque::new(),
            })
        };
        Ok(Self {
            small: small.collect::<Result<_, Failure>>()?,
            rows: Rows::every(ROWS, None),
            images: scene.camera.as_ref().map(images).transpose()?,
        })
    }

    fn look_at_rows(&mut self) {
        for (says, tap) in &self.small {
            while let Ok(Some(sample)) = tap.next() {
                self.rows.take(*says, sample.pieces());
            }
        }
    }

    fn look_at_images(&mut self, served: &Served) {
        let Some(Images { image, face, piece, images, faces, pieces }) = &mut self.images else { return };
        take(image, images);
        if let Some(face) = face {
            take(face, faces);
        }
        if let Some(piece) = piece {
            take(piece, pieces);
        }
        let newest = images.back().map_or(0, |(origin, _)| *origin);
        // The pieces come after the face, and not from every frame: a later face says that none come.
        let is_whole = |at: &u64| {
            let is_followed = faces.back().is_some_and(|(last, _)| last > at);
            pieces.is_empty() || is_followed || pieces.iter().any(|(origin, _)| origin == at)
        };
        let with_face =
            images.iter().rposition(|(at, _)| faces.iter().any(|(origin, _)| origin == at) && is_whole(at));
        // An image without a face is shown when its face would have come.
        let late = images.iter().rposition(|(at, _)| face.is_none() || at + FACE_PATIENCE < newest);
        let Some(chosen) = with_face.max(late) else { return };
        let Some((origin, image)) = images.drain(..=chosen).next_back() else { return };
        let [face, pieces] = [faces, pieces].map(|retained| {
            let at = retained.iter().position(|(of, _)| *of == origin);
            Some(retained[at?].1.clone())
        });
        served.show(Picture { origin, image, face, pieces });
    }
}

/// Retains what has come.
fn take(tap: &Tap, retained: &mut Retained) {
    while let Ok(Some(sample)) = tap.next() {
        let pieces = sample.pieces();
        if retained.len() == RETAINED {
            retained.pop_front();
        }
        retained.push_back((pieces.header().origin, AlignedBytes::joined(pieces.meta, pieces.payload)));
    }
}
