//! The lease of the beam: it begins after a dwell, is renewed while there is no reason against it, and is never longer
//! than its length.

/// Rules of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeaseRules {
    /// How long a lease lasts unless it is renewed, ns.
    pub length: u64,
    /// Time without a reason against it before it begins, ns.
    pub dwell: u64,
}

/// The lease, and how long it was held in all.
#[derive(Clone, Debug)]
pub struct Lease {
    rules: LeaseRules,
    /// Time since which there is no reason against it, ns.
    well: Option<u64>,
    /// When it ends, ns; `None` where there is none.
    ends: Option<u64>,
    ended_by: u32,
    last: Option<u64>,
    /// Since when the present one is held, ns.
    begun: u64,
    stats: LeaseStats,
}

/// How long leases were held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeaseStats {
    pub leases: u64,
    /// Time held, ns.
    pub on: u64,
    /// Time watched, ns.
    pub watched: u64,
    /// The longest that ended, ns.
    pub longest: u64,
    /// The shortest that ended, ns; 0 before the first.
    pub shortest: u64,
}

impl Lease {
    #[must_use]
    pub fn new(rules: LeaseRules) -> Self {
        Self {
            rules,
            well: None,
            ends: None,
            ended_by: 0,
            last: None,
            begun: 0,
            stats: LeaseStats::default(),
        }
    }

    /// Goes on with another dwell, ns.
    pub fn set_dwell(&mut self, dwell: u64) {
        self.rules.dwell = dwell;
    }

    /// Takes the reasons against it at `now`, ns, as bits; 0 for none. Returns whether it is held until the next call,
    /// or its end.
    pub fn look(&mut self, now: u64, against: u32) -> bool {
        // Time that nobody watched is no dwell.
        if self.last.is_some_and(|last| now.saturating_sub(last) >= self.rules.length) {
            self.well = None;
        }
        self.count(now);
        // Not renewed in time: it has ended by itself.
        if self.ends.is_some_and(|ends| now >= ends) {
            self.end(now, against);
        }
        if against != 0 {
            self.well = None;
            if self.is_held() {
                self.end(now, against);
            }
            return false;
        }
        let well = *self.well.get_or_insert(now);
        if !self.is_held() {
            if now.saturating_sub(well) < self.rules.dwell {
                return false;
            }
            self.stats.leases += 1;
            self.begun = now;
        }
        self.ends = Some(now.saturating_add(self.rules.length));
        true
    }

    fn count(&mut self, now: u64) {
        let from = self.last.replace(now).unwrap_or(now);
        self.stats.watched += now.saturating_sub(from);
        if let Some(ends) = self.ends {
            self.stats.on += now.min(ends).saturating_sub(from);
        }
    }

    fn end(&mut self, now: u64, why: u32) {
        let held = self.ends.take().map_or(now, |ends| now.min(ends)).saturating_sub(self.begun);
        self.ended_by = why;
        self.stats.longest = self.stats.longest.max(held);
        self.stats.shortest = if self.stats.shortest == 0 { held } else { self.stats.shortest.min(held) };
    }

    /// Whether it is held.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.ends.is_some()
    }

    /// When it ends, ns.
    #[must_use]
    pub fn ends(&self) -> Option<u64> {
        self.ends
    }

    /// Time without a reason against it at `now`, ns.
    #[must_use]
    pub fn well_for(&self, now: u64) -> u64 {
        self.well.map_or(0, |well| now.saturating_sub(well))
    }

    /// What the last one was ended by: bits.
    #[must_use]
    pub fn ended_by(&self) -> u32 {
        self.ended_by
    }

    /// How long leases were held.
    #[must_use]
    pub fn stats(&self) -> &LeaseStats {
        &self.stats
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;
    const RULES: LeaseRules = LeaseRules { length: 100 * MS, dwell: 500 * MS };

    #[test]
    fn it_begins_after_the_dwell_and_ends_at_the_first_word_against_it() {
        let mut lease = Lease::new(RULES);
        let held = |lease: &mut Lease, ms: u64, against: u32| lease.look(ms * MS, against);
        assert!(!held(&mut lease, 0, 4));
        for ms in (10..510).step_by(10) {
            assert!(!held(&mut lease, ms, 0), "{ms}");
        }
        assert!(held(&mut lease, 510, 0));
        assert_eq!(lease.ends(), Some(610 * MS));
        assert!(held(&mut lease, 600, 0) && !held(&mut lease, 610, 8));
        assert_eq!((lease.ends(), lease.ended_by()), (None, 8));
        // It has to dwell again.
        for ms in (620..1_120).step_by(10) {
            assert!(!held(&mut lease, ms, 0), "{ms}");
        }
        assert!(held(&mut lease, 1_120, 0));
        let stats = lease.stats();
        assert_eq!((stats.leases, stats.on, stats.watched), (2, 100 * MS, 1_120 * MS));
        assert_eq!((stats.longest, stats.shortest), (100 * MS, 100 * MS));
    }

    #[test]
    fn time_that_nobody_watched_is_no_dwell() {
        let mut lease = Lease::new(RULES);
        assert!(!lease.look(0, 0) && !lease.look(2_000 * MS, 0));
        assert_eq!(lease.well_for(2_000 * MS), 0);
    }

    #[test]
    fn it_ends_by_itself_where_nobody_looks() {
        let mut lease = Lease::new(LeaseRules { dwell: 0, ..RULES });
        assert!(lease.look(0, 0) && lease.look(90 * MS, 0));
        assert!(lease.look(1_000 * MS, 0));
        assert_eq!((lease.stats().on, lease.stats().leases), (190 * MS, 2));
    }

    proptest! {
        #[test]
        fn it_is_never_held_against_anything_nor_before_the_dwell(
            looks in prop::collection::vec((1..150u64, prop::bool::weighted(0.1)), 1..400),
        ) {
            let mut lease = Lease::new(RULES);
            let (mut now, mut well) = (0, None);
            for (step, against) in looks {
                now += step * MS;
                let held = lease.look(now, u32::from(against));
                if against {
                    well = None;
                } else {
                    well.get_or_insert(now);
                }
                prop_assert!(!held || well.is_some_and(|w| now - w >= RULES.dwell));
                prop_assert_eq!(held, lease.ends() == Some(now + RULES.length));
                prop_assert!(lease.stats().on <= lease.stats().watched);
            }
        }
    }
}
