//! Operators that should answer and never did: a segmentation without a face, a law that was idle to the end, a sensor that
//! fusion left out. The figures come from the samples and journals of a running pipeline or of a session.

use std::collections::BTreeMap;

use stillpoint_pipeline::graph::{Graph, OperatorNode};
use stillpoint_pipeline::live::status::{OperatorFigures, Status};
use stillpoint_recorder::{Session, TopicKind};
use stillpoint_samples::{
    DepthImage, Duties, GreyImage, Health, Pieces, PlanUpdate, PointCloud, Rejection, Sample, SampleKind,
};

/// The share of its samples from which on a sensor counts as left out to the end.
const LEFT_OUT: f64 = 0.99;

/// Collects the samples that state whether operators answered.
#[derive(Default)]
pub struct Answers {
    laws: BTreeMap<String, Law>,
    /// Of each sensor of a fusion: used, left out, and the last reason.
    fusions: BTreeMap<String, BTreeMap<String, (u64, u64, String)>>,
    rejections: BTreeMap<String, BTreeMap<u32, (String, u64)>>,
    /// Requests of each planner for which a plan is offered.
    plans: BTreeMap<String, Vec<u64>>,
}

#[derive(Default)]
struct Law {
    samples: u64,
    idle: u64,
    /// The reasons of the last idle sample.
    why: String,
}

impl Answers {
    /// The topics of a graph that state answers.
    pub fn of(graph: &Graph) -> Self {
        let mut found = Self::default();
        for node in &graph.operators {
            for (output, port) in node.outputs.iter().zip(node.stage.kind.outputs) {
                let topic = output.topic.clone();
                if *port.sample == *Duties::KIND && !is_far_end(node) {
                    found.laws.insert(topic, Law::default());
                } else if *port.sample == *Health::KIND {
                    found.fusions.insert(topic, BTreeMap::new());
                } else if *port.sample == *Rejection::KIND {
                    found.rejections.insert(topic, BTreeMap::new());
                } else if *port.sample == *PlanUpdate::KIND && !is_far_end(node) {
                    found.plans.insert(topic, Vec::new());
                }
            }
        }
        found
    }

    /// The same with the samples of a session. Topics that the session does not keep stay empty.
    pub fn of_session(graph: &Graph, session: &Session) -> Self {
        let mut found = Self::of(graph);
        let topics: Vec<String> = found.topics().map(str::to_owned).collect();
        for recorded in session.samples_where(|t| topics.contains(&t.name)).flatten() {
            let topic = &session.topics()[recorded.topic];
            if let TopicKind::Known(kind) = &topic.kind
                && let Ok(pieces) = Pieces::split(kind, &recorded.sample)
            {
                found.take(&topic.name, pieces);
            }
        }
        found
    }

    /// The topics to read.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        let laws = self.laws.keys().chain(self.fusions.keys());
        laws.chain(self.rejections.keys()).chain(self.plans.keys()).map(String::as_str)
    }

    /// Takes a sample.
    pub fn take(&mut self, topic: &str, pieces: Pieces<'_>) {
        if let Some(law) = self.laws.get_mut(topic)
            && let Ok(view) = pieces.view::<Duties>()
            && let Some(duties) = view.first()
        {
            law.samples += 1;
            if duties.idle != 0 {
                law.idle += 1;
                law.why = duties.reasons().collect::<Vec<_>>().join(", ");
            }
        }
        if let Some(sensors) = self.fusions.get_mut(topic)
            && let Ok(view) = pieces.view::<Health>()
        {
            for s in view.elements {
                let reason = match sensors.remove(s.name()) {
                    Some((.., before)) if s.reason() == "used" => before,
                    _ => s.reason().to_owned(),
                };
                sensors.insert(s.name().to_owned(), (s.used, s.left_out, reason));
            }
        }
        if let Some(reasons) = self.rejections.get_mut(topic)
            && let Ok(view) = pieces.view::<Rejection>()
            && let Some(rejection) = view.first()
        {
            reasons.entry(rejection.code).or_insert_with(|| (rejection.reason().to_owned(), 0)).1 += 1;
        }
        if let Some(requests) = self.plans.get_mut(topic)
            && let Ok(view) = pieces.view::<PlanUpdate>()
            && view.body.ended != 0
            && view.body.beams > 0
            && !requests.contains(&view.body.request)
        {
            requests.push(view.body.request);
        }
    }

    /// Takes over the topics of which another observation of the same run saw more.
    pub fn add_missing(&mut self, other: Self) {
        for (topic, law) in other.laws {
            let own = self.laws.entry(topic).or_default();
            if own.samples == 0 {
                *own = law;
            }
        }
        for (topic, sensors) in other.fusions {
            let own = self.fusions.entry(topic).or_default();
            if own.is_empty() {
                *own = sensors;
            }
        }
        for (topic, reasons) in other.rejections {
            let own = self.rejections.entry(topic).or_default();
            if own.is_empty() {
                *own = reasons;
            }
        }
        for (topic, requests) in other.plans {
            let own = self.plans.entry(topic).or_default();
            if own.is_empty() {
                *own = requests;
            }
        }
    }

    /// What operators found, a line each, and who never answered.
    pub fn verdict(&self, graph: &Graph, figures: &[OperatorFigures]) -> Verdict {
        let mut verdict = Verdict::default();
        for node in &graph.operators {
            let Some(figures) = figures.iter().find(|f| f.operator == node.name) else { continue };
            self.frames(node, figures, &mut verdict);
            images(node, figures, &mut verdict);
            if node.stage.kind.name.starts_with("sink.") {
                verdict.found.push(format!("{}: took samples in {} steps", node.name, figures.activations));
            }
        }
        for (topic, law) in &self.laws {
            if law.samples > 0 && law.idle == law.samples {
                let why = if law.why.is_empty() { "no reason stated" } else { &law.why };
                verdict.unanswered.push(format!("{topic}: the law was idle to the end: {why}"));
            }
        }
        for (topic, sensors) in &self.fusions {
            for (name, (used, left_out, reason)) in sensors {
                let all = used + left_out;
                if all > 0 && (*left_out as f64) < LEFT_OUT * all as f64 {
                    let share = *used as f64 / all as f64 * 100.0;
                    verdict
                        .found
                        .push(format!("{topic}: `{name}` was used in {share:.0} % of {all} estimates"));
                } else if all > 0 {
                    verdict.unanswered.push(format!(
                        "{topic}: the sensor `{name}` was left out of {left_out} of {all} estimates: {reason}"
                    ));
                }
            }
        }
        for (topic, requests) in &self.plans {
            let count = requests.len();
            let plans = if count == 1 { "plan" } else { "plans" };
            verdict.found.push(format!("{topic}: {count} {plans} offered"));
        }
        verdict
    }

    /// The frames of an operator that refuses some, such as those without a face.
    fn frames(&self, node: &OperatorNode, figures: &OperatorFigures, verdict: &mut Verdict) {
        let outputs = node.stage.kind.outputs;
        let is = |sample: &SampleKind| *sample == *Rejection::KIND;
        let Some(port) = outputs.iter().position(|o| is(o.sample)) else { return };
        let refused = figures.sent_by_output.get(port).copied().unwrap_or(0);
        let frames = figures.activations;
        // Of a console, what is refused are commands.
        if frames == 0 || node.stage.kind.role == stillpoint_operator::Role::Source {
            return;
        }
        let (found, result) = (frames.saturating_sub(refused), outputs[0].name);
        let reasons = self.rejections.get(&node.outputs[port].topic);
        let most = reasons.into_iter().flat_map(BTreeMap::values).max_by_key(|(_, often)| *often);
        let why = match most {
            Some((reason, _)) => format!("; most of the others: {reason}"),
            None if refused > 0 => format!("; `stillpoint echo {}` says why", node.outputs[port].topic),
            None => String::new(),
        };
        if refused < frames {
            verdict.found.push(format!("{}: {found} of {frames} frames had a {result}{why}", node.name));
        } else {
            let why = most.map_or_else(String::new, |(reason, _)| format!(": {reason}"));
            verdict.unanswered.push(format!("{}: 0 of {frames} frames had a {result}{why}", node.name));
        }
    }
}

/// A camera without images.
fn images(node: &OperatorNode, figures: &OperatorFigures, verdict: &mut Verdict) {
    let is_source = node.stage.kind.role == stillpoint_operator::Role::Source;
    let seen = [DepthImage::KIND, GreyImage::KIND, PointCloud::KIND];
    let images = node.stage.kind.outputs.iter().position(|o| seen.contains(&o.sample));
    if let (true, Some(port)) = (is_source, images)
        && figures.sent_by_output.get(port) == Some(&0)
    {
        verdict.unanswered.push(format!("{}: no image came", node.outputs[port].topic));
    }
}

/// Whether an operator only passes on what a link carries.
fn is_far_end(node: &OperatorNode) -> bool {
    node.far_end.is_some()
}

/// What the operators of a run found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// What was found, a line each.
    pub found: Vec<String>,
    /// Who should have answered and never did, a line each.
    pub unanswered: Vec<String>,
}

/// The figures of the operators of a session, from its journals.
pub fn figures_of(session: &Session, graph: &Graph) -> Vec<OperatorFigures> {
    let mut status = Status::new(graph);
    for (number, node) in graph.operators.iter().enumerate() {
        let entries = session.journals().get(&node.name);
        entries.into_iter().flatten().for_each(|entry| status.enter(number, entry));
    }
    status.figures()
}
