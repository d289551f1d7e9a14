//! Watching a sensor by the samples that it sends: is it alive, does it see, is its clock sane.

/// Why a sensor is used, or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The sensor is used.
    Used,
    /// No sample was seen yet.
    Waiting,
    /// It has sent nothing for too long.
    Silent,
    /// The times of its samples jumped, lie farther ahead than clocks may differ, or are older than any delay explains.
    Clock,
    /// It sends the same measurement again and again.
    Frozen,
    /// Its filter has no estimate.
    NoEstimate,
    /// Its measurements are far from where its filter expects them.
    Jumps,
    /// Its measurements have no usable numbers.
    Refused,
    /// It is elsewhere than the other sensor and than the estimate was before.
    Disagrees,
    /// It is good again, and has to stay so for some samples.
    Returning,
}

impl Verdict {
    /// The verdict in a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Used => "used",
            Self::Waiting => "waiting",
            Self::Silent => "silent",
            Self::Clock => "clock",
            Self::Frozen => "frozen",
            Self::NoEstimate => "no estimate",
            Self::Jumps => "jumps",
            Self::Refused => "refused",
            Self::Disagrees => "disagrees",
            Self::Returning => "returning",
        }
    }
}

/// When a sensor is left out, and when it comes back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchParams {
    /// Time without a sample after which a sensor is silent, ns. A sample that is older than this when it arrives has a
    /// wrong time.
    pub timeout: u64,
    /// A delay from acquisition to arrival that differs by more than this from the one before is a jump of a clock, ns.
    pub clock_jump: u64,
    /// A sensor's clock may be ahead by so much, ns. Those that NTP or PTP keeps together differ by a few milliseconds, or
    /// by microseconds.
    pub clock_ahead: u64,
    /// So many repetitions of a measurement make a sensor frozen.
    pub frozen_after: u64,
    /// So many measurements in a row that its filter does not use leave it out.
    pub unused_after: u64,
    /// So many good samples in a row bring it back.
    pub readmit_after: u64,
}

/// What a sample says of its sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Report {
    /// When it was acquired, ns.
    pub origin: u64,
    /// When it arrived, ns.
    pub arrival: u64,
    /// Repetitions of the measurement.
    pub repeated: u64,
    /// How the filter used it.
    pub fate: Fate,
}

/// How a filter used a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    Used,
    /// It was beyond the gate.
    Gated,
    /// It had no usable numbers.
    Refused,
    /// There is no estimate.
    NoEstimate,
}

/// The watch over one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Watch {
    params: WatchParams,
    verdict: Verdict,
    /// When the verdict was given, ns.
    since: u64,
    last: Option<Report>,
    unused: u64,
    good: u64,
}

impl Watch {
    /// A watch over a sensor without samples.
    #[must_use]
    pub fn new(params: WatchParams) -> Self {
        Self { params, verdict: Verdict::Waiting, since: 0, last: None, unused: 0, good: 0 }
    }

    /// Whether time, content and track of a sample are plausible. Only such a sample is compared with the other sensor.
    #[must_use]
    pub fn is_sound(&self, report: &Report) -> bool {
        !self.has_bad_clock(report)
            && report.repeated < self.params.frozen_after
            && report.fate != Fate::NoEstimate
    }

    /// Takes a sample into account, and where its track is, seen from the other sensor's.
    pub fn see(&mut self, report: Report, agreement: Agreement) {
        self.unused = if report.fate == Fate::Used { 0 } else { self.unused + 1 };
        let apart = matches!(agreement, Agreement::Apart | Agreement::Disputed);
        let fault = self.fault(&report).or(apart.then_some(Verdict::Disagrees));
        self.last = Some(report);
        let verdict = match (fault, self.verdict) {
            (Some(fault), _) => {
                self.good = 0;
                fault
            }
            (None, Verdict::Used | Verdict::Waiting) => Verdict::Used,
            (None, Verdict::Disagrees) if agreement == Agreement::Unknown => Verdict::Disagrees,
            (None, _) => {
                self.good += 1;
                if self.good >= self.params.readmit_after { Verdict::Used } else { Verdict::Returning }
            }
        };
        self.give(verdict, report.arrival);
    }

    /// Checks the time, ns: a sensor that sends no samples is silent.
    pub fn look(&mut self, time: u64) {
        if self.last.is_some_and(|last| time.saturating_sub(last.arrival) > self.params.timeout) {
            self.good = 0;
            self.give(Verdict::Silent, time);
        }
    }

    /// Leaves the sensor out for being elsewhere than the other one.
    pub fn expel(&mut self, time: u64) {
        self.good = 0;
        self.give(Verdict::Disagrees, time);
    }

    /// Ends a dispute in which the sensor was left out and sent good samples since.
    pub fn reinstate(&mut self, time: u64) {
        if self.verdict == Verdict::Disagrees {
            self.give(Verdict::Used, time);
        }
    }

    fn give(&mut self, verdict: Verdict, time: u64) {
        if verdict != self.verdict {
            (self.verdict, self.since) = (verdict, time);
        }
    }

    fn fault(&self, report: &Report) -> Option<Verdict> {
        let p = &self.params;
        if self.has_bad_clock(report) {
            return Some(Verdict::Clock);
        }
        if report.repeated >= p.frozen_after {
            return Some(Verdict::Frozen);
        }
        match report.fate {
            Fate::NoEstimate => Some(Verdict::NoEstimate),
            Fate::Gated if self.unused >= p.unused_after => Some(Verdict::Jumps),
            Fate::Refused if self.unused >= p.unused_after => Some(Verdict::Refused),
            _ => None,
        }
    }

    /// Delays are differences of one clock and another: what they are cannot be told, how they change can.
    fn has_bad_clock(&self, report: &Report) -> bool {
        let delay = |r: &Report| i128::from(r.arrival) - i128::from(r.origin);
        let now = delay(report);
        let jumped = |last: &Report| {
            (now - delay(last)).unsigned_abs() > u128::from(self.params.clock_jump)
                || report.origin <= last.origin
        };
        now < -i128::from(self.params.clock_ahead)
            || now > i128::from(self.params.timeout)
            || self.last.as_ref().is_some_and(jumped)
    }

    /// The verdict on the sensor.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Since when, ns.
    #[must_use]
    pub fn since(&self) -> u64 {
        self.since
    }

    #[must_use]
    pub fn last(&self) -> Option<&Report> {
        self.last.as_ref()
    }
}

/// Where a sensor's track is, seen from the other's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Agreement {
    /// At the same place.
    Together,
    /// Elsewhere, and this one is to blame.
    Apart,
    /// Either of the two is wrong, and it cannot be told which.
    Disputed,
    /// There is no other sensor to compare with.
    Unknown,
}
