//! Which sample of one session belongs to which of the other.

use std::collections::BTreeMap;

use serde::Serialize;

/// How samples of two sessions are paired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// Samples of one incarnation and number.
    Sequence,
    /// Samples of one time of acquisition, in their order.
    Origin,
}

/// How pairing is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// By origin where the sessions share at least half of their times of acquisition, else by sequence.
    #[default]
    Auto,
    /// By sequence.
    Sequence,
    /// By origin.
    Origin,
}

/// What names a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Key {
    pub incarnation: u32,
    pub sequence: u64,
    pub stamp: u64,
    pub origin: u64,
}

impl Key {
    fn number(&self) -> (u32, u64) {
        (self.incarnation, self.sequence)
    }
}

/// The partner in the second session of samples of the first one, and the other way round.
#[derive(Default)]
pub(super) struct Pairs {
    partner: [BTreeMap<(u32, u64), (u32, u64)>; 2],
}

impl Pairs {
    pub fn of(keys: &[Vec<Key>; 2], zero: [u64; 2], alignment: Alignment) -> Self {
        let names = |side: usize| -> BTreeMap<(u64, u64), (u32, u64)> {
            match alignment {
                Alignment::Sequence => {
                    let named = |k: &Key| ((u64::from(k.incarnation), k.sequence), k.number());
                    keys[side].iter().map(named).collect()
                }
                Alignment::Origin => by_origin(&keys[side], zero[side]),
            }
        };
        let (first, second) = (names(0), names(1));
        let mut pairs = Self::default();
        for (name, one) in &first {
            if let Some(other) = second.get(name) {
                pairs.partner[0].insert(*one, *other);
                pairs.partner[1].insert(*other, *one);
            }
        }
        pairs
    }

    /// The partner of a sample of the first session.
    pub fn partner(&self, number: (u32, u64)) -> Option<(u32, u64)> {
        self.partner[0].get(&number).copied()
    }

    /// The samples of one session that have no partner.
    pub fn alone<'k>(&'k self, side: usize, keys: &'k [Key]) -> impl Iterator<Item = &'k Key> {
        keys.iter().filter(move |k| !self.partner[side].contains_key(&k.number()))
    }
}

/// Samples by time of acquisition since the start, and their place among those of the same time.
fn by_origin(keys: &[Key], zero: u64) -> BTreeMap<(u64, u64), (u32, u64)> {
    let mut named = BTreeMap::new();
    let mut count: BTreeMap<u64, u64> = BTreeMap::new();
    for key in keys {
        let origin = key.origin.saturating_sub(zero);
        let place = count.entry(origin).or_default();
        named.insert((origin, *place), key.number());
        *place += 1;
    }
    named
}

/// How samples of these names are paired.
pub(super) fn choose(keys: &[Vec<Key>; 2], zero: [u64; 2], choice: Choice) -> Alignment {
    match choice {
        Choice::Sequence => Alignment::Sequence,
        Choice::Origin => Alignment::Origin,
        Choice::Auto => {
            let [first, second] = [0, 1].map(|side| by_origin(&keys[side], zero[side]));
            let shared = first.keys().filter(|name| second.contains_key(name)).count();
            if 2 * shared >= first.len().min(second.len()) { Alignment::Origin } else { Alignment::Sequence }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(origins: &[u64]) -> Vec<Key> {
        let key = |(sequence, origin): (usize, &u64)| Key {
            incarnation: 0,
            sequence: sequence as u64,
            stamp: *origin,
            origin: *origin,
        };
        origins.iter().enumerate().map(key).collect()
    }

    #[test]
    fn a_sample_that_one_session_lacks_moves_no_later_pair() {
        let both = [keys(&[10, 20, 30, 40]), keys(&[110, 130, 140])];
        let zero = [0, 100];
        assert_eq!(choose(&both, zero, Choice::Auto), Alignment::Origin);
        let pairs = Pairs::of(&both, zero, Alignment::Origin);
        assert_eq!(
            [0, 1, 2, 3].map(|n| pairs.partner((0, n))),
            [Some((0, 0)), None, Some((0, 1)), Some((0, 2))]
        );
        assert_eq!(pairs.alone(0, &both[0]).count(), 1);
        assert_eq!(pairs.alone(1, &both[1]).count(), 0);
    }

    #[test]
    fn sessions_without_common_times_are_paired_by_number() {
        let both = [keys(&[10, 20, 30]), keys(&[11, 21, 31])];
        assert_eq!(choose(&both, [0, 0], Choice::Auto), Alignment::Sequence);
        assert_eq!(Pairs::of(&both, [0, 0], Alignment::Sequence).partner((0, 2)), Some((0, 2)));
    }
}
