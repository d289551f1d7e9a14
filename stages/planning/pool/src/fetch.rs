//! Fetching a content from another process, part by part.

use std::collections::{BTreeMap, BTreeSet};

use crate::Hash;
use crate::hash::Hasher;
use crate::message::{LONGEST_CONTENT, PART};

/// Parts that are asked for and have not arrived, at most.
pub const OUTSTANDING: usize = 8;
/// Time after which a part is asked for again, ns.
const RETRY: u64 = 2_000_000_000;
/// Times that a part is asked for.
const TRIES: u32 = 15;

/// A content on its way.
pub struct Fetch {
    content: Hash,
    /// The longest that it can be, bytes.
    most: u64,
    /// Times that a part is asked for.
    tries: u32,
    /// Bytes of all parts so far without a gap: memory grows only with what arrives.
    bytes: Vec<u8>,
    /// Their hash goes with them: the last part of a long content takes no longer than the others.
    hasher: Hasher,
    early: BTreeMap<u32, Vec<u8>>,
    length: Option<u64>,
    /// When a part was asked for, and how often.
    asked: BTreeMap<u32, (u64, u32)>,
    /// Parts that were asked for once and are behind one that was asked for later: they are likely to be lost.
    overtaken: BTreeSet<u32>,
}

/// Why a content cannot be had from where it is fetched.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FetchError {
    /// Parts do not fit together.
    #[error("the parts of {0:.16} do not fit together")]
    Parts(Hash),
    /// It is too long.
    #[error("{0:.16} is announced with {1} bytes; at most {2} are fetched")]
    Long(Hash, u64, u64),
    /// What arrived is something else.
    #[error("what arrived as {0:.16} has the SHA-256 {1:.16}")]
    Other(Hash, Hash),
    /// Parts do not come.
    #[error("a part of {0:.16} did not arrive after {1} requests")]
    Silent(Hash, u32),
}

impl Fetch {
    /// Of this content.
    pub fn new(content: Hash) -> Self {
        Self {
            content,
            most: LONGEST_CONTENT,
            tries: TRIES,
            bytes: Vec::new(),
            hasher: Hasher::default(),
            early: BTreeMap::new(),
            length: None,
            asked: BTreeMap::new(),
            overtaken: BTreeSet::new(),
        }
    }

    /// Refuses the content if it is said to have more bytes than these.
    pub fn at_most(mut self, most: u64) -> Self {
        self.most = most.min(LONGEST_CONTENT);
        self
    }

    /// Of this length, if who gives it has reported one: all parts may be asked for at once.
    pub fn of_length(mut self, length: Option<u64>) -> Self {
        self.length = length.filter(|length| *length <= self.most);
        self
    }

    /// Asks for each part at most so often.
    pub fn with_tries(mut self, tries: u32) -> Self {
        self.tries = tries;
        self
    }

    /// The content.
    pub fn content(&self) -> Hash {
        self.content
    }

    /// Parts to ask for now.
    ///
    /// # Errors
    /// A part was asked for too often.
    pub fn wants(&mut self, now: u64) -> Result<Vec<u32>, FetchError> {
        let next = self.next();
        self.asked.retain(|part, _| *part >= next);
        let mut wants = Vec::new();
        // The first part says how many there are.
        let count = self.length.map_or(1, parts);
        for part in (next..count).take(OUTSTANDING) {
            if self.early.contains_key(&part) {
                continue;
            }
            let (at, tries) = self.asked.entry(part).or_insert((now, 0));
            let is_overtaken = self.overtaken.remove(&part);
            if *tries > 0 && !is_overtaken && now.saturating_sub(*at) < RETRY {
                continue;
            }
            if *tries >= self.tries {
                return Err(FetchError::Silent(self.content, self.tries));
            }
            (*at, *tries) = (now, *tries + 1);
            wants.push(part);
        }
        Ok(wants)
    }

    /// Takes a part; the whole content when it is the last one.
    ///
    /// # Errors
    /// The part does not fit, or the content is not what its name says.
    pub fn take(&mut self, part: u32, length: u64, bytes: Vec<u8>) -> Result<Option<Vec<u8>>, FetchError> {
        if length > self.most {
            return Err(FetchError::Long(self.content, length, self.most));
        }
        if *self.length.get_or_insert(length) != length || bytes.len() as u64 != length_of(part, length) {
            return Err(FetchError::Parts(self.content));
        }
        let next = self.next();
        // A part that came before, or one that was not asked for.
        if part < next || !self.asked.contains_key(&part) {
            return Ok(None);
        }
        self.early.insert(part, bytes);
        let overtaken = self.asked.range(..part).filter(|(part, (_, tries))| {
            // Once: messages that change their order are not asked for again and again.
            *tries == 1 && !self.early.contains_key(part)
        });
        self.overtaken.extend(overtaken.map(|(part, _)| *part));
        let mut next = next;
        while let Some(bytes) = self.early.remove(&next) {
            self.hasher.update(&bytes);
            self.bytes.extend(bytes);
            next += 1;
        }
        if (self.bytes.len() as u64) < length {
            return Ok(None);
        }
        let found = self.hasher.finish();
        if found != self.content {
            return Err(FetchError::Other(self.content, found));
        }
        Ok(Some(std::mem::take(&mut self.bytes)))
    }

    fn next(&self) -> u32 {
        (self.bytes.len() / PART) as u32
    }
}

/// Parts of a content of this length; an empty one has one.
fn parts(length: u64) -> u32 {
    length.div_ceil(PART as u64).max(1) as u32
}

/// Bytes of a part.
fn length_of(part: u32, length: u64) -> u64 {
    length.saturating_sub(u64::from(part) * PART as u64).min(PART as u64)
}

/// The bytes of a part of a content, if it has such a part.
pub fn part_of(content: &[u8], part: u32) -> Option<&[u8]> {
    if part >= parts(content.len() as u64) {
        return None;
    }
    let start = part as usize * PART;
    content.get(start..content.len().min(start + PART))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_content_arrives_whole_whatever_the_order_the_losses_and_the_repetitions(
            length in 0..4 * PART, seed: u64, deals in prop::collection::vec((any::<prop::sample::Index>(), 0..3_u8), 0..80),
        ) {
            let content: Vec<u8> = (0..length).map(|i| (i as u64).wrapping_mul(seed | 1).to_le_bytes()[7]).collect();
            let mut fetch = Fetch::new(Hash::of(&content));
            let (mut now, mut due, mut whole) = (0, Vec::new(), None);
            let mut deals = deals.into_iter();
            while whole.is_none() {
                due.extend(fetch.wants(now).unwrap());
                prop_assert!(due.len() <= 8 * OUTSTANDING);
                if due.is_empty() {
                    now += RETRY;
                    continue;
                }
                let (at, fate) = deals.next().map_or((0, 1), |(at, fate)| (at.index(due.len()), fate));
                let part = due[at];
                if fate < 2 {
                    due.remove(at);
                }
                if fate > 0 {
                    let bytes = part_of(&content, part).unwrap().to_vec();
                    whole = fetch.take(part, content.len() as u64, bytes).unwrap();
                }
            }
            prop_assert!(whole.unwrap() == content);
        }

        #[test]
        fn parts_of_anybody_make_no_wrong_content(part: u32, length: u64, size in 0..2_000_usize) {
            let mut fetch = Fetch::new(Hash::of(b"wanted"));
            fetch.wants(0).unwrap();
            prop_assert!(!matches!(fetch.take(part, length, vec![1; size]), Ok(Some(_))));
            prop_assert!(fetch.bytes.len() <= size);
        }
    }

    #[test]
    fn a_part_that_a_later_one_overtakes_is_asked_for_again_at_once_and_once() {
        let content = vec![7; 2 * OUTSTANDING * PART];
        let mut fetch = Fetch::new(Hash::of(&content));
        let take = |fetch: &mut Fetch, part: u32| {
            let bytes = part_of(&content, part).unwrap().to_vec();
            fetch.take(part, content.len() as u64, bytes).unwrap()
        };
        assert_eq!(fetch.wants(0).unwrap(), [0]);
        take(&mut fetch, 0);
        assert_eq!(fetch.wants(1).unwrap(), (1..=8).collect::<Vec<_>>());
        take(&mut fetch, 2);
        assert_eq!(fetch.wants(2).unwrap(), [1]);
        take(&mut fetch, 3);
        assert!(fetch.wants(3).unwrap().is_empty());
        take(&mut fetch, 1);
        assert_eq!(fetch.wants(4).unwrap(), [9, 10, 11]);
        (4..=11).for_each(|part| drop(take(&mut fetch, part)));
        assert_eq!(fetch.wants(5).unwrap(), [12, 13, 14, 15]);
        // The last one has none behind it: it is asked for after a while.
        [12, 13, 14].into_iter().for_each(|part| drop(take(&mut fetch, part)));
        assert!(fetch.wants(6).unwrap().is_empty());
        assert_eq!(fetch.wants(5 + RETRY).unwrap(), [15]);
        assert_eq!(take(&mut fetch, 15), Some(content.clone()));
    }

    #[test]
    fn all_parts_of_a_content_of_known_length_are_asked_for_at_once() {
        let content = vec![7; 5 * PART];
        let length = content.len() as u64;
        let mut fetch = Fetch::new(Hash::of(&content)).of_length(Some(length));
        assert_eq!(fetch.wants(0).unwrap(), [0, 1, 2, 3, 4]);
        let parts = (0..5).map(|part| fetch.take(part, length, vec![7; PART]).unwrap());
        assert_eq!(parts.last().flatten(), Some(content.clone()));
        // Who reports another length than it gives is found at the first part.
        let mut other = Fetch::new(Hash::of(&content)).of_length(Some(length - 1));
        other.wants(0).unwrap();
        assert!(matches!(other.take(0, length, vec![7; PART]), Err(FetchError::Parts(_))));
        assert_eq!(Fetch::new(Hash::of(&content)).at_most(10).of_length(Some(length)).wants(0).unwrap(), [0]);
    }

    #[test]
    fn a_content_that_is_said_to_be_longer_than_it_can_be_is_refused_at_its_first_part() {
        let hash = Hash::of(b"wanted");
        let mut fetch = Fetch::new(hash).at_most(PART as u64);
        fetch.wants(0).unwrap();
        let long = PART as u64 + 1;
        assert_eq!(fetch.take(0, long, vec![1; PART]), Err(FetchError::Long(hash, long, PART as u64)));
    }

    #[test]
    fn a_holder_that_is_silent_is_given_up() {
        let mut fetch = Fetch::new(Hash::of(b"wanted"));
        let given_up = (0..100).find(|i| fetch.wants(i * RETRY).is_err());
        assert_eq!(given_up, Some(u64::from(TRIES)));
    }
}
