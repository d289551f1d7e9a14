//! The pool as one object: calls go in, answers come out.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use crate::client::{Client, ClientSettings, Event, Inside, Tally};
use crate::record::{Record, Recorder};
use crate::{Call, CallError, Courier, Hash, WorkerState};

/// Longest time between two looks at the clock, ns.
const TICK: u64 = 20_000_000;

/// Takes the answer of a call, by its place in the list of calls, and gives whether further answers are awaited.
type Taker<'t> = dyn FnMut(usize, &Arc<Vec<u8>>) -> Result<ControlFlow<()>, CallError> + 't;

/// What the asking process can do itself.
pub trait Home {
    /// A content that workers need.
    fn content(&self, hash: &Hash) -> Option<&[u8]>;

    /// Whether an answer has the form that a call, by its place in the list of calls, asks for.
    ///
    /// # Errors
    /// What is wrong with it.
    fn check(&self, call: usize, answer: &[u8]) -> Result<(), CallError>;

    /// Computes a call, by its place in the list.
    ///
    /// # Errors
    /// The call has no answer.
    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError>;
}

/// A pool of workers behind a courier. With no worker at all, this process computes after a time of patience.
pub struct Pool<C: Courier> {
    courier: C,
    client: Client,
    report: Option<Report>,
}

/// Tells people a message.
type Report = Box<dyn FnMut(&str)>;

struct Keyed<'h> {
    home: &'h dyn Home,
    places: BTreeMap<Hash, usize>,
}

impl Inside for Keyed<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        self.home.content(hash)
    }

    fn check(&self, key: &Hash, answer: &[u8]) -> Result<(), CallError> {
        self.places.get(key).map_or(Ok(()), |place| self.home.check(*place, answer))
    }
}

impl<C: Courier> Pool<C> {
    /// Over this courier.
    pub fn new(courier: C, settings: ClientSettings) -> Self {
        Self { client: Client::new(courier.now(), settings), courier, report: None }
    }

    /// Tells each message for people as soon as there is one.
    pub fn telling(mut self, report: impl FnMut(&str) + 'static) -> Self {
        self.report = Some(Box::new(report));
        self
    }

    /// Writes down all calls from now on.
    pub fn start_record(&mut self) {
        self.client.start_record();
    }

    /// The calls since [`start_record`](Self::start_record); none if it was not called.
    pub fn take_record(&mut self) -> Option<Record> {
        self.client.recorder().take().map(Recorder::into_record)
    }

    /// The next calls are asked for the answers of these, some of which came before.
    pub fn note_needs(&mut self, keys: &[Hash]) {
        if let Some(recorder) = self.client.recorder() {
            recorder.needs(keys);
        }
    }

    /// The calls of these keys were asked because the answer of another call was there.
    pub fn note_followers(&mut self, keys: &[Hash], after: &Hash) {
        if let Some(recorder) = self.client.recorder() {
            recorder.follow(keys, after);
        }
    }

    /// The workers.
    pub fn workers(&self) -> &BTreeMap<String, WorkerState> {
        self.client.workers()
    }

    /// How calls were answered.
    pub fn tally(&self) -> Tally {
        self.client.tally()
    }

    /// Messages for people since the last call.
    pub fn take_news(&mut self) -> Vec<String> {
        self.client.take_news()
    }

    /// Keys of answers that were given out and are in doubt now: what was made of them must be made again.
    pub fn take_tainted(&mut self) -> std::collections::BTreeSet<Hash> {
        self.client.take_tainted()
    }

    /// The key of a call.
    pub fn key(&self, call: &Call) -> Hash {
        call.key(self.client.build())
    }

    /// The courier.
    pub fn courier(&mut self) -> &mut C {
        &mut self.courier
    }

    /// Answers of all calls, in their order.
    ///
    /// # Errors
    /// A call has no answer, neither there nor here.
    pub fn call_all(&mut self, calls: &[Call], home: &dyn Home) -> Result<Vec<Arc<Vec<u8>>>, CallError> {
        let mut answers: Vec<Option<Arc<Vec<u8>>>> = vec![None; calls.len()];
        self.call_each(calls, home, |place, answer| {
            answers[place] = Some(answer.clone());
            Ok(())
        })?;
        answers.into_iter().map(|answer| answer.ok_or(CallError::NoAnswer)).collect()
    }

    /// Hands out the answer of each call as soon as it is there, in any order.
    ///
    /// # Errors
    /// A call has no answer, neither there nor here, or the taker fails.
    pub fn call_each(
        &mut self,
        calls: &[Call],
        home: &dyn Home,
        mut take: impl FnMut(usize, &Arc<Vec<u8>>) -> Result<(), CallError>,
    ) -> Result<(), CallError> {
        let result = self.answers(calls, calls.len(), home, &mut |place, answer| {
            take(place, answer).map(ControlFlow::Continue)
        });
        self.cancel();
        self.end_round();
        result
    }

    /// Hands out answers until those of the first `awaited` calls are there, or the taker breaks off; the other calls stay
    /// open. Calls that are open from before are not asked twice.
    ///
    /// # Errors
    /// As for [`call_each`](Self::call_each); then no call is open.
    pub fn call_first(
        &mut self,
        calls: &[Call],
        awaited: usize,
        home: &dyn Home,
        mut take: impl FnMut(usize, &Arc<Vec<u8>>) -> Result<ControlFlow<()>, CallError>,
    ) -> Result<(), CallError> {
        let result = self.answers(calls, awaited, home, &mut take);
        if result.is_err() {
            self.cancel();
        }
        self.end_round();
        result
    }

    /// Asks calls without waiting for an answer.
    ///
    /// # Errors
    /// Nothing can be sent any more.
    pub fn begin(&mut self, calls: &[Call], home: &dyn Home) -> Result<(), CallError> {
        let result = self.answers(calls, 0, home, &mut |_, _| Ok(ControlFlow::Continue(())));
        self.end_round();
        result
    }

    fn begin_round(&mut self, now: u64, calls: &[Call], keys: &[Hash], (awaited, home): (usize, &dyn Home)) {
        let Some(recorder) = self.client.recorder() else { return };
        for input in calls.iter().flat_map(Call::inputs) {
            if !recorder.has(&input) {
                recorder.content(input, home.content(&input).map_or(0, |bytes| bytes.len() as u64));
            }
        }
        recorder.begin_round(now, keys, awaited);
    }

    fn end_round(&mut self) {
        let now = self.courier.now();
        if let Some(recorder) = self.client.recorder() {
            recorder.end_round(now);
        }
    }

    /// Forgets all calls that are open.
    pub fn cancel(&mut self) {
        self.client.cancel_all();
        self.send();
    }

    fn answers(
        &mut self,
        calls: &[Call],
        awaited: usize,
        home: &dyn Home,
        take: &mut Taker<'_>,
    ) -> Result<(), CallError> {
        let mut keyed = Keyed { home, places: BTreeMap::new() };
        let now = self.courier.now();
        let mut twins: BTreeMap<Hash, Vec<usize>> = BTreeMap::new();
        let mut keys = Vec::with_capacity(calls.len());
        for (place, call) in calls.iter().enumerate() {
            let key = self.client.submit(now, call);
            keyed.places.insert(key, place);
            twins.entry(key).or_default().push(place);
            keys.push(key);
        }
        self.begin_round(now, calls, &keys, (awaited, home));
        // What came in since the last call: a worker whose greetings wait is there.
        self.listen(&keyed, 0)?;
        loop {
            self.client.tick(self.courier.now());
            self.send();
            if twins.values().flatten().all(|place| *place >= awaited) {
                return Ok(());
            }
            if let Some(report) = &mut self.report {
                self.client.take_news().iter().for_each(|text| report(text));
            }
            match self.client.next_event() {
                Some(Event::Answer(key, answer)) => {
                    let begun = self.courier.now();
                    let mut flow = ControlFlow::Continue(());
                    for place in twins.remove(&key).unwrap_or_default() {
                        if take(place, &answer)?.is_break() {
                            flow = ControlFlow::Break(());
                        }
                    }
                    let ended = self.courier.now();
                    if let Some(recorder) = self.client.recorder() {
                        recorder.taken(&key, ended.saturating_sub(begun));
                    }
                    if flow.is_break() {
                        return Ok(());
                    }
                }
                Some(Event::Compute(key)) => {
                    let place = keyed.places.get(&key).copied().unwrap_or_default();
                    let begun = self.courier.now();
                    let answer = home.compute(place)?;
                    let ended = self.courier.now();
                    if let Some(recorder) = self.client.recorder() {
                        recorder.computed_here((begun, ended), &key, &answer);
                    }
                    // Greetings came in while this process was busy.
                    self.listen(&keyed, 0)?;
                    self.client.settle(&key, answer);
                }
                None => self.listen(&keyed, TICK)?,
            }
        }
    }

    /// Takes what arrives within `wait`, and all that has arrived.
    fn listen(&mut self, inside: &Keyed<'_>, wait: u64) -> Result<(), CallError> {
        let mut until = self.courier.now().saturating_add(wait);
        while let Some(arrival) = self.courier.receive(until)? {
            let now = self.courier.now();
            self.client.handle(now, &arrival.from, &arrival.bytes, inside);
            let ended = self.courier.now();
            if let Some(recorder) = self.client.recorder() {
                recorder.handled(arrival.bytes.len(), ended.saturating_sub(now));
            }
            until = now;
        }
        Ok(())
    }

    fn send(&mut self) {
        for (to, message) in self.client.take_messages() {
            self.courier.send(&to, message.to_bytes());
        }
    }
}
