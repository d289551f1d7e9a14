//! What is served of a session, at any time of it.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::{Value, json};
use stillpoint_operator::Registry;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::ledger::Ledger;
use stillpoint_recorder::{Session, TopicKind};
use stillpoint_report::graph::{Drawing, svg};
use stillpoint_report::pipeline_of;
use stillpoint_report::trace::{Journals, Trace, as_run};
use stillpoint_report::unanswered::Verdict;
use stillpoint_samples::{Entry, Pieces};

use super::figures::{Slow, state};
use super::picture::Picture;
use super::pictures::Pictures;
use super::rows::Rows;
use super::scene::{Scene, name};
use super::served::Served;
use crate::exit::Failure;
use crate::top::{Parts, Snapshot, figures};

/// Rows of a whole session, about.
const ROWS: u64 = 4000;
/// Shortest interval of rows, ns.
const SHORTEST: u64 = 20_000_000;

/// A session that is shown.
pub struct Past {
    of: Value,
    session: Arc<Session>,
    /// The pipeline as the session ran it.
    graph: Graph,
    base: u64,
    /// The time over which figures are taken, ns.
    window: u64,
    slow: Slow,
    pictures: Option<Arc<Pictures>>,
}

impl Past {
    /// What is served of a session.
    pub fn open(
        of: Value,
        path: PathBuf,
        session: Session,
        window: u64,
        registry: &Registry,
    ) -> Result<Served, Failure> {
        let session = Arc::new(session);
        let (graph, files) = pipeline_of(&session, registry)?;
        let ran = as_run(&graph, &session);
        let scene = Scene::of(&ran);
        let journals = Journals::of_session(&session, Some(&ran));
        let (base, seconds) = (journals.first(), journals.seconds());
        let mut about = scene.about(&ran);
        about["of"] = of.clone();
        about["pipeline"] = json!(ran.name);
        about["follows"] = json!(false);
        about["seconds"] = json!(seconds);
        let mut ledger = Ledger::default();
        for (number, node) in ran.operators.iter().enumerate() {
            let entries = session.journals().get(&node.name).into_iter().flatten();
            entries.for_each(|entry| ledger.enter(number, entry));
        }
        let slow = Slow::of(&Trace::of(&journals, |_, _| true), ledger.lines(&ran), &path);
        let snapshot = Snapshot::of_session(of.clone(), &path, &session, &ran);
        let whole = state(&snapshot, &slow, base).map_err(Failure::failed)?;
        let drawing = svg(&Drawing::of(&journals, Some(&graph)));
        let interval = ((seconds * 1e9) as u64 / ROWS).max(SHORTEST);
        let rows = rows(&session, &ran, &scene, Rows::every(interval, Some(base)));
        drop(journals);
        let pictures =
            scene.camera.as_ref().map(|c| Arc::new(Pictures::of(&session, &graph, &ran, files, c)));
        about["images"] = json!(pictures.as_ref().map(|p| p.place()));
        let past = Self { of, session, graph: ran, base, window, slow, pictures };
        let served = Served { about, camera: scene.camera, base, past: Some(past), ..Served::default() };
        served.add(rows);
        served.put(whole, drawing);
        Ok(served)
    }

    /// The first and the last time, ns.
    pub fn range(&self) -> (u64, u64) {
        let entries = self.session.journals().values().flatten();
        let last = entries.map(|entry| entry.header.stamp).max().unwrap_or(self.base);
        (self.base, last.max(self.base))
    }

    /// Whether a replay computes the images.
    pub fn computes_images(&self) -> bool {
        self.pictures.as_ref().is_some_and(|pictures| pictures.needs_replay())
    }

    /// The state at a time, s: the figures of the window that ends then.
    pub fn state(&self, t: f64) -> Option<String> {
        let (entries, seconds) = self.window(t);
        let journals = Journals::of_run(&self.graph, &entries);
        let figures = figures(&self.graph, &entries);
        let snapshot = Snapshot::of(Parts {
            of: self.of.clone(),
            graph: &self.graph,
            journals,
            figures,
            seconds,
            held: None,
            verdict: Verdict::default(),
            processes: None,
            changed: Vec::new(),
            recorder: None,
            clock_set_s: None,
        });
        state(&snapshot, &self.slow, self.base).ok()
    }

    /// The graph with the figures of the window that ends at a time, s.
    pub fn graph(&self, t: f64) -> String {
        let (entries, _) = self.window(t);
        svg(&Drawing::of(&Journals::of_run(&self.graph, &entries), Some(&self.graph)))
    }

    /// The last image up to a time, s; and whether it stays the last. Images that are not recorded are computed from now on.
    pub fn picture(&self, t: f64) -> Option<(Picture, bool)> {
        self.pictures.as_ref()?.up_to(self.base.saturating_add(ns(t)))
    }

    /// The entries of the window that ends at a time, s, by operator; and its length, s.
    fn window(&self, t: f64) -> (Vec<Vec<Entry>>, f64) {
        let to = self.base.saturating_add(ns(t));
        let from = to.saturating_sub(self.window).max(self.base);
        let of = |name: &String| {
            let all = self.session.journals().get(name).map_or(&[][..], Vec::as_slice);
            all.iter().filter(|e| (from..=to).contains(&e.header.stamp)).cloned().collect()
        };
        let entries = self.graph.operators.iter().map(|node| of(&node.name)).collect();
        (entries, (to - from) as f64 * 1e-9)
    }
}

fn ns(t: f64) -> u64 {
    (t.max(0.0) * 1e9) as u64
}

/// The rows of a session.
fn rows(session: &Session, graph: &Graph, scene: &Scene, mut rows: Rows) -> Vec<super::rows::Row> {
    let topics: Vec<_> = scene.topics.iter().map(|(says, port)| (*says, name(graph, *port))).collect();
    let is_shown = |topic: &str| topics.iter().any(|(_, known)| known == topic);
    for recorded in session.samples_where(|t| is_shown(&t.name)).flatten() {
        let topic = &session.topics()[recorded.topic];
        let TopicKind::Known(kind) = &topic.kind else { continue };
        let Ok(pieces) = Pieces::split(kind, &recorded.sample) else { continue };
        if let Some((says, _)) = topics.iter().find(|(_, known)| *known == topic.name) {
            rows.take(*says, pieces);
        }
    }
    rows.made()
}
