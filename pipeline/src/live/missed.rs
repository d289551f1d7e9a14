//! Samples that were sent while no recorder ran: their numbers are in no part of a session, and in no list of losses.

use std::collections::BTreeMap;

use stillpoint_recorder::{Lost, Session};

/// The ranges of numbers that are missing before the last that is there, by topic and incarnation.
pub fn missed(session: &Session) -> Vec<Lost> {
    let mut missed = Vec::new();
    for (number, topic) in session.topics().iter().enumerate() {
        let mut listed: Vec<&Lost> = session.lost().iter().filter(|l| l.topic == topic.name).collect();
        listed.sort_by_key(|l| (l.incarnation, l.first));
        let mut next: BTreeMap<u32, u64> = BTreeMap::new();
        for (incarnation, sequence) in session.numbers(number) {
            let from = next.insert(incarnation, sequence.saturating_add(1)).unwrap_or(0);
            let known = listed.iter().filter(|l| l.incarnation == incarnation);
            for (first, end) in without(from, sequence, known.map(|l| (l.first, l.count))) {
                let topic = topic.name.clone();
                missed.push(Lost { topic, incarnation, first, count: end - first });
            }
        }
    }
    missed
}

/// What of the numbers from `from` to before `end` none of the rising ranges (first, count) holds.
fn without(from: u64, end: u64, ranges: impl Iterator<Item = (u64, u64)>) -> Vec<(u64, u64)> {
    let mut left = Vec::new();
    let mut at = from;
    for (first, count) in ranges.filter(|(first, _)| *first < end) {
        if first > at {
            left.push((at, first));
        }
        at = at.max(first.saturating_add(count));
    }
    if at < end {
        left.push((at, end));
    }
    left
}

#[cfg(test)]
mod tests {
    use super::without;

    #[test]
    fn what_is_listed_is_not_listed_again() {
        let of = |ranges: &[(u64, u64)]| without(10, 20, ranges.iter().copied());
        assert_eq!(of(&[]), [(10, 20)]);
        assert_eq!(of(&[(0, 10), (20, 5)]), [(10, 20)]);
        assert_eq!(of(&[(5, 7), (14, 2)]), [(12, 14), (16, 20)]);
        assert_eq!(of(&[(10, 4), (12, 8)]), []);
        assert_eq!(without(10, 10, std::iter::empty()), []);
    }
}
