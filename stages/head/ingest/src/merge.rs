//! The clouds of several cameras as one: which take part, and their points in one frame.
//!
//! A merged cloud is ready as soon as each camera that is not late has sent a new cloud, and at the latest when a camera
//! sends its second. Each camera takes part with its newest cloud, unless [`Part`] says why not.

use nalgebra::{Isometry3, Point3};

/// Cameras of a merge at most.
pub const CAMERAS: usize = 4;

/// Rules of a merge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MergeRules {
    /// A camera whose newest cloud was acquired longer than this before the newest of all is late, ns.
    pub max_age: u64,
    /// A cloud with fewer points in the region is that of a blocked camera.
    pub min_points: usize,
    /// Middle of the region, in couch axes, m.
    pub at: [f64; 3],
    /// Half of each side of the region, m.
    pub half: [f64; 3],
}

/// Where a camera is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// From the frame of its clouds to the couch, in whose axes the region is.
    pub couch_from_camera: Isometry3<f64>,
    /// From the couch to the frame of the merged cloud.
    pub merged_from_couch: Isometry3<f64>,
}

/// Whether a camera takes part in a merged cloud, and if not, why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// It takes part.
    Used,
    /// It has sent no cloud yet.
    Waiting,
    /// Its newest cloud is too old.
    Late,
    /// It sees too little of the region.
    Blocked,
    /// It sent the cloud before again, to the bit.
    Frozen,
    /// The measurement of its place is too old.
    OldExtrinsic,
}

impl Part {
    /// The word for people, at most 16 bytes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Used => "used",
            Self::Waiting => "waiting",
            Self::Late => "late",
            Self::Blocked => "blocked",
            Self::Frozen => "frozen",
            Self::OldExtrinsic => "old extrinsic",
        }
    }
}

/// What is known of one camera.
#[derive(Debug, Clone)]
pub struct MergedCamera {
    placement: Placement,
    /// Points of its newest cloud in the region, in the frame of the merged cloud, m; and of the cloud before.
    points: Vec<[f32; 3]>,
    before: Vec<[f32; 3]>,
    /// Acquisition of its newest cloud, ns.
    origin: Option<u64>,
    is_new: bool,
    is_frozen: bool,
    part: Part,
    since: u64,
    used: u64,
    left_out: u64,
}

impl MergedCamera {
    fn new(placement: Placement) -> Self {
        Self {
            placement,
            points: Vec::new(),
            before: Vec::new(),
            origin: None,
            is_new: false,
            is_frozen: false,
            part: Part::Waiting,
            since: 0,
            used: 0,
            left_out: 0,
        }
    }

    /// Its part in the last merged cloud.
    #[must_use]
    pub fn part(&self) -> Part {
        self.part
    }

    /// Time of the merged cloud from which on this has been its part, ns.
    #[must_use]
    pub fn since(&self) -> u64 {
        self.since
    }

    /// Acquisition of its newest cloud, ns; `None` before its first.
    #[must_use]
    pub fn origin(&self) -> Option<u64> {
        self.origin
    }

    /// Merged clouds in which it took part, and from which it was left out.
    #[must_use]
    pub fn counts(&self) -> [u64; 2] {
        [self.used, self.left_out]
    }

    /// Takes the points in the region out of a cloud.
    fn take(&mut self, cloud: &[[f32; 3]], origin: u64, rules: &MergeRules) {
        std::mem::swap(&mut self.points, &mut self.before);
        self.points.clear();
        let Placement { couch_from_camera, merged_from_couch } = self.placement;
        self.points.extend(cloud.iter().filter_map(|point| {
            let couch = couch_from_camera * Point3::from(point.map(f64::from));
            // Written so that NaN is outside.
            let is_inside = (0..3).all(|i| (couch[i] - rules.at[i]).abs() <= rules.half[i]);
            is_inside.then(|| <[f64; 3]>::from((merged_from_couch * couch).coords).map(|c| c as f32))
        }));
        self.is_frozen = self.origin.is_some() && self.points == self.before;
        self.origin = Some(origin);
        self.is_new = true;
    }
}

/// The newest clouds of several cameras.
#[derive(Debug, Clone)]
pub struct Merge {
    rules: MergeRules,
    cameras: Vec<MergedCamera>,
    /// Acquisition of the first cloud of any camera, ns: a camera that has sent none is as old.
    begin: Option<u64>,
    /// Acquisition of the last merged cloud, ns.
    last: Option<u64>,
}

impl Merge {
    /// A merge of the clouds of cameras at these places.
    #[must_use]
    pub fn new(rules: MergeRules, placements: &[Placement]) -> Self {
        Self {
            rules,
            cameras: placements.iter().copied().map(MergedCamera::new).collect(),
            begin: None,
            last: None,
        }
    }

    /// The cameras, in the order of their places.
    #[must_use]
    pub fn cameras(&self) -> &[MergedCamera] {
        &self.cameras
    }

    /// Takes a cloud (m, in the frame of its camera) that was acquired at `origin`, ns, and says whether a merged cloud is
    /// ready.
    pub fn take(&mut self, camera: usize, cloud: &[[f32; 3]], origin: u64) -> bool {
        self.begin.get_or_insert(origin);
        let Some(taken) = self.cameras.get_mut(camera) else { return false };
        let is_second = taken.is_new;
        taken.take(cloud, origin, &self.rules);
        let newest = self.newest();
        let is_late = |camera: &MergedCamera| self.is_late(camera, newest);
        self.cameras.get(camera).is_some_and(|c| !is_late(c))
            && (is_second || self.cameras.iter().all(|c| c.is_new || is_late(c)))
    }

    /// Decides which cameras take part at `time`, ns. `is_placed` says whether the measured place of a camera is valid.
    /// Returns the acquisition of the oldest cloud that takes part, ns, or of the newest where none does.
    pub fn close(&mut self, time: u64, is_placed: impl Fn(usize) -> bool) -> u64 {
        let newest = self.newest();
        let last = self.last;
        let parts = self.cameras.iter().enumerate().map(|(k, camera)| {
            // A cloud that was merged before, or that is older than what was, would set the time of the surface back.
            let is_over = !camera.is_new && camera.origin.is_some_and(|origin| last >= Some(origin));
            match self.part(k, newest, &is_placed) {
                Part::Used if is_over => Part::Late,
                part => part,
            }
        });
        let parts: Vec<Part> = parts.collect();
        for (camera, part) in self.cameras.iter_mut().zip(parts) {
            if camera.part != part || camera.since == 0 {
                (camera.part, camera.since) = (part, time);
            }
            let count = if part == Part::Used { &mut camera.used } else { &mut camera.left_out };
            *count += 1;
            camera.is_new = false;
        }
        let origin = self.used().filter_map(|c| c.origin).min().unwrap_or(newest);
        self.last = Some(origin);
        origin
    }

    /// The points of the cameras that take part, camera by camera, m, in the frame of the merged cloud.
    pub fn points(&self) -> impl Iterator<Item = &[[f32; 3]]> {
        self.used().map(|camera| camera.points.as_slice())
    }

    fn used(&self) -> impl Iterator<Item = &MergedCamera> {
        self.cameras.iter().filter(|c| c.part == Part::Used)
    }

    fn newest(&self) -> u64 {
        self.cameras.iter().filter_map(|c| c.origin).max().unwrap_or(0)
    }

    fn is_late(&self, camera: &MergedCamera, newest: u64) -> bool {
        let origin = camera.origin.or(self.begin).unwrap_or(newest);
        newest.saturating_sub(origin) > self.rules.max_age
    }

    fn part(&self, k: usize, newest: u64, is_placed: &impl Fn(usize) -> bool) -> Part {
        let camera = &self.cameras[k];
        match camera {
            _ if !is_placed(k) => Part::OldExtrinsic,
            c if c.origin.is_none() => Part::Waiting,
            c if self.is_late(c, newest) => Part::Late,
            c if c.points.len() < self.rules.min_points => Part::Blocked,
            c if c.is_frozen => Part::Frozen,
            _ => Part::Used,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    const MS: u64 = 1_000_000;
    const RULES: MergeRules =
        MergeRules { max_age: 100 * MS, min_points: 2, at: [0.0; 3], half: [0.5, 0.5, 0.5] };

    /// Two cameras, 1 m to the right and to the left, and a merged frame 2 m over the couch.
    fn merge() -> Merge {
        let at = |x: f64| Placement {
            couch_from_camera: Translation3::new(x, 0.0, 0.0).into(),
            merged_from_couch: Translation3::new(0.0, 0.0, -2.0).into(),
        };
        Merge::new(RULES, &[at(1.0), at(-1.0)])
    }

    /// Points about the middle of the couch, seen from a camera at x; others with each number.
    fn cloud(x: f32, number: u16) -> Vec<[f32; 3]> {
        let shift = f32::from(number) * 1e-3;
        vec![[-x + shift, 0.0, 0.1], [-x, shift, 0.2], [f32::NAN; 3], [0.0, 9.0, 0.0]]
    }

    fn parts(merge: &Merge) -> Vec<Part> {
        merge.cameras().iter().map(MergedCamera::part).collect()
    }

    #[test]
    fn a_pair_of_clouds_is_one_in_the_axes_of_the_couch_without_what_lies_elsewhere() {
        let mut merge = merge();
        assert!(!merge.take(1, &cloud(-1.0, 1), 10 * MS), "the other camera has sent nothing yet");
        assert!(merge.take(0, &cloud(1.0, 0), 12 * MS));
        assert_eq!(merge.close(13 * MS, |_| true), 10 * MS, "the older of both");
        let points: Vec<[f32; 3]> = merge.points().flatten().copied().collect();
        let expected = [[0.0, 0.0, -1.9], [0.0, 0.0, -1.8], [0.001, 0.0, -1.9], [0.0, 0.001, -1.8]];
        assert_eq!(points.len(), 4);
        for (point, expected) in points.iter().zip(expected) {
            let off = point.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-6, "{point:?} {expected:?}");
        }
    }

    #[test]
    fn a_camera_that_falls_silent_holds_the_other_up_by_one_frame_at_most() {
        let mut merge = merge();
        merge.take(0, &cloud(1.0, 0), 0);
        assert!(merge.take(1, &cloud(-1.0, 0), 0));
        merge.close(0, |_| true);
        assert!(!merge.take(0, &cloud(1.0, 1), 50 * MS));
        assert!(merge.take(0, &cloud(1.0, 2), 100 * MS), "its second");
        assert_eq!(merge.close(100 * MS, |_| true), 100 * MS, "the time never repeats");
        assert_eq!(parts(&merge), [Part::Used, Part::Late], "merged before");
        assert!(merge.take(0, &cloud(1.0, 3), 150 * MS), "nobody waits for the other any more");
        assert_eq!(merge.close(150 * MS, |_| true), 150 * MS);
        assert_eq!(parts(&merge), [Part::Used, Part::Late]);
        // An old cloud that arrives now makes no merged one, and a new one takes part.
        assert!(!merge.take(1, &cloud(-1.0, 1), 20 * MS) && !merge.take(1, &cloud(-1.0, 2), 40 * MS));
        assert!(!merge.take(1, &cloud(-1.0, 3), 190 * MS) || parts(&merge).len() == 2);
        assert!(merge.take(0, &cloud(1.0, 4), 200 * MS));
        assert_eq!(merge.close(200 * MS, |_| true), 190 * MS);
        assert_eq!(parts(&merge), [Part::Used, Part::Used]);
        assert_eq!(merge.cameras()[1].counts(), [2, 2]);
    }

    #[test]
    fn cameras_that_are_blocked_frozen_or_were_placed_long_ago_are_left_out_with_the_cause() {
        let mut merge = merge();
        let mut pair = |first: &[[f32; 3]], second: &[[f32; 3]], at: u64, placed: bool| {
            merge.take(0, first, at * MS);
            merge.take(1, second, at * MS);
            merge.close(at * MS, |k| placed || k == 0);
            (parts(&merge)[1], merge.points().flatten().count())
        };
        // A plate in front of the lens is outside of the region.
        let plate = vec![[0.0, 0.0, 0.1]; 100];
        assert_eq!(pair(&cloud(1.0, 0), &plate, 0, true), (Part::Blocked, 2));
        assert_eq!(pair(&cloud(1.0, 1), &cloud(-1.0, 1), 10, true), (Part::Used, 4));
        assert_eq!(pair(&cloud(1.0, 2), &cloud(-1.0, 1), 20, true), (Part::Frozen, 2));
        assert_eq!(pair(&cloud(1.0, 3), &cloud(-1.0, 3), 30, false), (Part::OldExtrinsic, 2));
        assert_eq!(pair(&plate, &cloud(-1.0, 3), 40, false), (Part::OldExtrinsic, 0));
    }

    #[test]
    fn a_camera_that_never_sends_is_waited_for_as_long_as_a_late_one() {
        let mut merge = merge();
        let ready: Vec<bool> = (0..5)
            .map(|k| {
                let ready = merge.take(0, &cloud(1.0, k), u64::from(k) * 101 * MS);
                if ready {
                    merge.close(u64::from(k) * 101 * MS, |_| true);
                }
                ready
            })
            .collect();
        assert_eq!(ready, [false, true, true, true, true]);
        assert_eq!(parts(&merge), [Part::Used, Part::Waiting]);
    }
}
