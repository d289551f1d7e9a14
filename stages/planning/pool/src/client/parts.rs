//! Long answers, which workers give part by part.

use super::{Client, Inside};
use crate::message::Message;
use crate::{Hash, To};

impl Client {
    pub(super) fn take_part(
        &mut self,
        now: u64,
        from: &str,
        (content, part, length, bytes): (Hash, u32, u64, Vec<u8>),
        inside: &dyn Inside,
    ) {
        let mut whole = None;
        let mut wrong = None;
        for (key, open) in &mut self.calls {
            let Some(fetch) = open.fetches.get_mut(from).filter(|fetch| fetch.content() == content) else {
                continue;
            };
            (open.progress, self.progress) = (now, now);
            match fetch.take(part, length, bytes) {
                Ok(Some(bytes)) => whole = Some((*key, bytes)),
                Ok(None) => {
                    let wants = fetch.wants(now).unwrap_or_default();
                    let want = |part| (To::one(from), Message::Want { content, part, only: false });
                    self.out.extend(wants.into_iter().map(want));
                }
                Err(e) => wrong = Some(e.to_string()),
            }
            break;
        }
        match (whole, wrong) {
            (Some((key, bytes)), _) => self.arrived(now, key, from, bytes, inside),
            (None, Some(reason)) => self.shut_out(from, &reason),
            (None, None) => {}
        }
    }

    /// The worker does not hold an answer any more: it is asked again.
    pub(super) fn drop_fetches(&mut self, from: &str, content: &Hash) {
        for open in self.calls.values_mut() {
            if open.fetches.get(from).is_some_and(|fetch| fetch.content() == *content) {
                open.fetches.remove(from);
            }
        }
    }
}
