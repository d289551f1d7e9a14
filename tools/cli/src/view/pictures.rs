//! The images of a session with their faces: those that it holds, and those that a replay computes.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::limits::start_thread;
use stillpoint_pipeline::replay::{Selection, replay};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_pipeline::stdout::StdoutRedirect;
use stillpoint_recorder::Session;
use stillpoint_samples::{AlignedBytes, Entry, RefKind};

use super::picture::Picture;
use super::scene::{Camera, Port, name};

/// Bytes of computed images that are retained at most; of a longer session every second, third, ... image is.
const MOST_BYTES: usize = 256 << 20;
/// Images that wait for their face in a replay.
const WAITING: usize = 8;

/// Incarnation and sequence of a sample by its origin.
type Sent = BTreeMap<u64, (u32, u64)>;

/// The images of a session.
pub struct Pictures {
    session: Arc<Session>,
    /// The pipeline that is replayed.
    graph: Arc<Graph>,
    files: SessionFiles,
    image: Port,
    face: Option<Port>,
    /// The pieces of the reference, where they have to be computed.
    piece: Option<Port>,
    image_topic: Option<usize>,
    face_topic: Option<usize>,
    pieces_topic: Option<usize>,
    images: Sent,
    faces: Sent,
    /// The pieces of the reference that are recorded.
    pieces: Sent,
    /// Whether the session lacks images or faces.
    needs_replay: bool,
    has_begun: AtomicBool,
    has_ended: AtomicBool,
    computed: Mutex<BTreeMap<u64, Picture>>,
}

impl Pictures {
    /// Of a session that ran `ran`, of the pipeline `graph`.
    pub fn of(
        session: &Arc<Session>,
        graph: &Graph,
        ran: &Graph,
        files: SessionFiles,
        camera: &Camera,
    ) -> Self {
        let number = |port: Port| session.topic_number(&name(ran, port));
        let sent = |port: Port| sent(session, &ran.operators[port.0].name, port.1);
        let (image_topic, face_topic) = (number(camera.image), camera.face.and_then(number));
        let pieces_topic = camera.pieces.and_then(number);
        Self {
            session: session.clone(),
            graph: Arc::new(graph.clone()),
            files,
            image: camera.image,
            face: camera.face,
            image_topic,
            face_topic,
            piece: camera.pieces.filter(|_| pieces_topic.is_none()),
            pieces_topic,
            pieces: camera.pieces.map(sent).unwrap_or_default(),
            images: sent(camera.image),
            faces: camera.face.map(sent).unwrap_or_default(),
            needs_replay: image_topic.is_none() || (camera.face.is_some() && face_topic.is_none()),
            has_begun: AtomicBool::new(false),
            has_ended: AtomicBool::new(false),
            computed: Mutex::default(),
        }
    }

    /// Whether the session lacks images or faces, so that a replay computes them.
    pub fn needs_replay(&self) -> bool {
        self.needs_replay
    }

    /// Where the images come from.
    pub fn place(&self) -> &'static str {
        if self.needs_replay { "computed by a replay" } else { "recorded" }
    }

    /// The last image up to a time, ns; and whether no later one up to that time comes any more. The first call begins the
    /// replay, if one is needed.
    pub fn up_to(self: &Arc<Self>, time: u64) -> Option<(Picture, bool)> {
        if self.needs_replay {
            if !self.has_begun.swap(true, Ordering::Relaxed) {
                let pictures = self.clone();
                // Without a thread there are no images.
                let _ = start_thread(move || pictures.compute());
            }
            let computed = self.lock();
            let picture = computed.range(..=time).next_back().map(|(_, picture)| picture.clone())?;
            let recorded = self.pieces_of(picture.origin);
            let picture = Picture { pieces: recorded.or(picture.pieces), ..picture };
            let is_past = computed.range(time + 1..).next().is_some();
            return Some((picture, is_past || self.has_ended.load(Ordering::Relaxed)));
        }
        let (origin, place) = self.images.range(..=time).next_back()?;
        let face = self.faces.get(origin).and_then(|place| self.sample(self.face_topic, *place));
        let (image, pieces) = (self.sample(self.image_topic, *place)?, self.pieces_of(*origin));
        Some((Picture { origin: *origin, image, face, pieces }, true))
    }

    /// The pieces that were sent of the image of an origin.
    fn pieces_of(&self, origin: u64) -> Option<AlignedBytes> {
        self.sample(self.pieces_topic, *self.pieces.get(&origin)?)
    }

    fn sample(&self, topic: Option<usize>, (incarnation, sequence): (u32, u64)) -> Option<AlignedBytes> {
        Some(self.session.sample(topic?, incarnation, sequence).ok()??.sample)
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, Picture>> {
        self.computed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn compute(&self) {
        let Some((last, _)) = self.piece.or(self.face) else { return };
        let selection = Selection::Only(self.graph.operators[last].name.clone());
        let _aside = StdoutRedirect::to_stderr();
        let mut collector = Collector { of: self, images: VecDeque::new(), seen: 0 };
        if let Err(error) = replay(&self.session, &self.graph, &self.files, &selection, &mut collector) {
            errln!("stillpoint: the images of the session cannot be computed: {error}");
        }
        self.has_ended.store(true, Ordering::Relaxed);
    }
}

/// What an operator sent on an output, by origin: the last sample where it sent several.
fn sent(session: &Session, operator: &str, output: usize) -> Sent {
    let mut sent = Sent::new();
    for entry in session.journals().get(operator).into_iter().flatten() {
        for r in entry.refs_of(RefKind::Output).filter(|r| r.port as usize == output && r.count > 0) {
            let last = r.first.saturating_add(u64::from(r.count) - 1);
            sent.insert(entry.header.origin, (entry.header.incarnation, last));
        }
    }
    sent
}

/// Retains images and faces of a replay.
struct Collector<'p> {
    of: &'p Pictures,
    images: VecDeque<(u64, AlignedBytes)>,
    seen: usize,
}

impl Collector<'_> {
    /// Retains an image, and leaves out so many that all fit.
    fn retain(&mut self, picture: Picture) {
        let bytes = picture.image.len() + picture.face.as_ref().map_or(0, |face| face.len());
        let most = (MOST_BYTES / bytes.max(1)).max(1);
        let step = self.of.images.len().div_ceil(most).max(1);
        self.seen += 1;
        if self.seen.is_multiple_of(step) || self.seen == 1 {
            self.of.lock().insert(picture.origin, picture);
        }
    }
}

impl Observer for Collector<'_> {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        let origin = entry.header.origin;
        let output = |port: usize| {
            let found = outputs.iter().rev().find(|(number, _)| *number == port);
            found.map(|(_, sample)| AlignedBytes::clone(&sample.bytes))
        };
        if operator == self.of.image.0
            && let Some(image) = output(self.of.image.1)
        {
            if self.images.len() == WAITING {
                self.images.pop_front();
            }
            self.images.push_back((origin, image));
        }
        if let Some((_, port)) = self.of.piece.filter(|(number, _)| *number == operator)
            && let Some(picture) = self.of.lock().get_mut(&origin)
        {
            picture.pieces = output(port);
        }
        let Some((_, port)) = self.of.face.filter(|(number, _)| *number == operator) else { return Ok(()) };
        let computed = self.images.iter().find(|(of, _)| *of == origin).map(|(_, image)| image.clone());
        let recorded = || {
            let place = self.of.images.get(&origin)?;
            self.of.sample(self.of.image_topic, *place)
        };
        if let Some(image) = computed.or_else(recorded) {
            self.retain(Picture { origin, image, face: output(port), pieces: None });
        }
        Ok(())
    }
}
