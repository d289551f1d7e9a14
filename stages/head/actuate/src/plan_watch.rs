//! Whether the standing plan is known to hold in the set-up that was requested last.

use stillpoint_samples::{PlanRefusal, PlanStanding, PlanUpdateBody};

/// The newest request for a plan, and the newest answer.
#[derive(Clone, Debug, Default)]
pub struct PlanWatch {
    /// Incarnation of the operator that requests, and sequence of its newest request.
    asked: Option<(u32, u64)>,
    /// Sequence of the request that was answered, and whether the standing plan holds in its set-up.
    answered: Option<(u64, bool)>,
}

impl PlanWatch {
    /// Takes a request. Until it is answered nothing is known of its set-up.
    pub fn ask(&mut self, incarnation: u32, sequence: u64) {
        // Numbers of another life of the operator are other requests.
        if self.asked.is_some_and(|(asked, _)| asked != incarnation) {
            self.answered = None;
        }
        self.asked = Some((incarnation, sequence));
    }

    /// Takes an update. A refused request is an answer: its set-up was not judged. A refused acceptance is none.
    pub fn answer(&mut self, update: &PlanUpdateBody) {
        if update.refusal() != Some(PlanRefusal::Accept) {
            let holds =
                update.refusal() == Some(PlanRefusal::None) && update.standing() == PlanStanding::Holds;
            self.answered = Some((update.request, holds));
        }
    }

    /// Whether the newest request is answered, and the standing plan holds in its set-up.
    pub fn holds(&self) -> bool {
        let (Some((_, asked)), Some((answered, holds))) = (self.asked, self.answered) else { return false };
        asked == answered && holds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn update(request: u64, standing: PlanStanding, refusal: PlanRefusal) -> PlanUpdateBody {
        PlanUpdateBody { request, standing: standing as u32, refusal: refusal as u32, ..Default::default() }
    }

    #[test]
    fn a_plan_holds_only_by_the_answer_to_the_newest_request() {
        let holds = |request| update(request, PlanStanding::Holds, PlanRefusal::None);
        let mut watch = PlanWatch::default();
        assert!(!watch.holds(), "nothing was asked");
        watch.answer(&holds(0));
        assert!(!watch.holds(), "nothing was asked still");
        watch.ask(0, 0);
        assert!(watch.holds(), "the answer may come before the request");
        watch.ask(0, 1);
        assert!(!watch.holds());
        watch.answer(&holds(0));
        assert!(!watch.holds(), "a late answer to the request before");
        watch.answer(&update(1, PlanStanding::Unknown, PlanRefusal::None));
        assert!(!watch.holds());
        watch.answer(&holds(1));
        assert!(watch.holds());
        watch.answer(&update(7, PlanStanding::Unknown, PlanRefusal::Accept));
        assert!(watch.holds(), "a refused acceptance is not an answer to a request");
        watch.answer(&update(1, PlanStanding::Fails, PlanRefusal::None));
        assert!(!watch.holds());
        watch.answer(&update(1, PlanStanding::Holds, PlanRefusal::Shift));
        assert!(!watch.holds(), "a refused request was not judged");
        watch.answer(&PlanUpdateBody { refusal: 99, ..holds(1) });
        assert!(!watch.holds(), "a refusal that this build does not know");
        watch.answer(&holds(1));
        watch.ask(1, 1);
        assert!(!watch.holds(), "another life of the watch, another request");
    }
}
