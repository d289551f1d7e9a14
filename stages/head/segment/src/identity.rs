//! Which of the balls over the couch is the head: the checks that a candidate must pass before anything is cut out.
//!
//! A shoulder, a chest, a fist or a pillow may be as round as a head. What tells the head is where it lies (a region in
//! the couch's axes), that it is set off from what lies footwards of it (a valley along its ridge, or a neck across it),
//! and that a body lies there. Each check gives a number from 0 to 1 that is 0.5 at its limit; a candidate's certainty
//! is the least of them. Exactly one candidate may reach 0.5, and no other may come near it.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::ball::Ball;
use crate::plane::Plane;
use crate::surface::Patch;

/// Where the head must be, in the couch's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Middle along x and y, m.
    pub at: [f64; 2],
    /// How far the head's middle may be from there along each of the two, m.
    pub half: f64,
    /// Height of the head's middle over the supporting plane, m: least and greatest.
    pub height: [f64; 2],
}

/// What a candidate must be to be the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentityParams {
    /// From the cloud's frame into that of the couch (x to the left of a supine patient, y to the head end, z up).
    pub couch_from_cloud: Isometry3<f64>,
    /// Where it must be; `None` where that is waived.
    pub region: Option<Region>,
    /// Whether a body must lie footwards of it, with a neck or a valley between.
    pub needs_body: bool,
    /// A candidate whose certainty is less than this below the best one's is a rival.
    pub margin: f64,
}

/// A thing of a head's size, with what speaks for its being the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Its ball.
    pub ball: Ball,
    /// The ball's centre in the couch's frame, m.
    pub place: Vector3<f64>,
    /// Height of the centre over the supporting plane, m.
    pub height: f64,
    /// Depth of the ridge's saddle between it and what lies footwards, over its radius.
    pub valley: f64,
    /// Lesser of its width (of at most a head of its ball) and that of what lies footwards, over the least width between.
    pub neck: f64,
    /// How far the surface of a head of this ball and this width is from the centre, m: the greater of the ball's radius
    /// and half the width, as far as nothing lies beside it.
    pub reach: f64,
    /// Its size over that of an adult's head, as far as its width, its length and its ball tell: the greatest.
    pub size: f64,
    /// Surface seen footwards of it, m2.
    pub body_area: f64,
    /// Width of what lies footwards over its own.
    pub body_width: f64,
    /// Lesser over greater reach, to either side of it, of the widest of what lies footwards: 1 on the midline.
    pub midline: f64,
    /// How far footwards of its centre it ends, m: a little beyond where the neck is lowest. Infinite without a body.
    pub end: f64,
    /// Certainty that it lies in the region.
    pub in_region: f64,
    /// Certainty that it has the shape of a head with a body.
    pub shape: f64,
    /// Certainty that nothing else, an arm or a pad, was cut out with it; 1 before it is cut out.
    pub alone: f64,
}

impl Candidate {
    /// Certainty that it is the head, from 0 to 1; it takes 0.5.
    #[must_use]
    pub fn certainty(&self) -> f64 {
        self.in_region.min(self.shape).min(self.alone)
    }

    /// What of a head with a body its shape lacks most.
    #[must_use]
    pub fn lacks(&self) -> ShapeLack {
        let set_off = at_limit(self.valley, VALLEY).max(at_limit(self.neck, NECK));
        let all = [
            (set_off, ShapeLack::Neck),
            (at_limit(self.body_area, AREA), ShapeLack::Body),
            (at_limit(self.body_width, WIDTH), ShapeLack::Shoulders),
            (at_limit(self.midline, MIDLINE), ShapeLack::Midline),
        ];
        let least = all.into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b));
        least.map_or(ShapeLack::Body, |(_, lack)| lack)
    }
}

/// What a thing of a head's size may lack of a head with a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeLack {
    /// Neither a valley nor a narrower place sets it off from what lies footwards.
    Neck,
    /// Too little surface is seen footwards.
    Body,
    /// What lies footwards is hardly wider.
    Shoulders,
    /// What lies footwards reaches much farther to one side.
    Midline,
}

impl ShapeLack {
    /// As the end of a sentence about it.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Neck => "has no neck that sets it off",
            Self::Body => "has no body footwards of it",
            Self::Shoulders => "has no shoulders",
            Self::Midline => "is beside its body's midline",
        }
    }
}

impl IdentityParams {
    /// Whether a place (m, in the cloud's frame) may be of the head that this candidate is, by where it ends.
    #[must_use]
    pub fn holds(&self, candidate: &Candidate, place: &Vector3<f64>) -> bool {
        let offset = self.couch_from_cloud.rotation * (place - candidate.ball.centre);
        let radius = candidate.ball.radius;
        let is_within =
            -offset.y < candidate.end && offset.x.abs() < HALF_WIDTH * radius && offset.z < TOP * radius;
        !self.needs_body || is_within
    }

    /// Whether a place (m, in the cloud's frame) that was cut out with this candidate is farther from it than the surface
    /// of a head, its neck aside.
    #[must_use]
    pub fn is_stray(&self, candidate: &Candidate, place: &Vector3<f64>) -> bool {
        let offset = self.couch_from_cloud.rotation * (place - candidate.ball.centre);
        self.needs_body
            && offset.norm() > FAR * candidate.reach
            && offset.y > -NECKWARDS * candidate.ball.radius
    }
}

/// Certainty from which a candidate is taken for the head.
pub const ENOUGH: f64 = 0.5;
/// Balls nearer to each other than this part of the adult radius are of one thing.
const ONE_THING: f64 = 1.15;
/// In radii of the ball: what of the neck beyond its lowest place is kept, and the half width of a head.
const NECK_RETAINED: f64 = 0.5;
const HALF_WIDTH: f64 = 1.6;
/// The same above its centre.
const TOP: f64 = 2.2;
/// In reaches: the surface of a head is hardly farther from the centre than this, except its neck, which is farther
/// footwards than the other, in radii of the ball.
const FAR: f64 = 1.5;
const NECKWARDS: f64 = 0.8;
/// In diameters of the ball: no head is wider than the first, and what is wider than the second has arms, pads or
/// shoulders beside it.
const WIDE: f64 = 1.3;
const BESIDES: f64 = 1.6;
/// Balls are of one thing if they are no farther apart than this across the couch and along it, in radii of the larger.
const ASIDE: f64 = 0.7;
const LENGTH: f64 = 2.2;
/// Width, length from the crown to where the neck is lowest, and diameter of the ball of an adult's head, m.
const ADULT_WIDTH: f64 = 0.155;
const ADULT_LENGTH: f64 = 0.235;
const ADULT_BALL: f64 = 0.17;
/// Limits of the checks, at which the certainty is 0.5, and the way from there to 0 or 1.
const VALLEY: [f64; 2] = [0.25, 0.2];
const NECK: [f64; 2] = [1.35, 0.25];
const AREA: [f64; 2] = [0.030, 0.030];
const WIDTH: [f64; 2] = [1.75, 0.6];
const MIDLINE: [f64; 2] = [0.35, 0.2];
/// The same of the part of what was cut out that is stray, for its complement.
const ALONE: [f64; 2] = [0.75, 0.1];
/// A ball that this many times more patches support is a cranium, and the one footwards is its jaw, neck or hand.
const MORE: f64 = 1.2;
/// Part of the region's half width over which the certainty goes from 0.5 to 0 or 1.
const REGION_MARGIN: f64 = 0.2;
/// Width of a slice across the couch, m.
const SLICE: f64 = 0.015;
/// Slices: from two radii headwards of the middle to the end of the body that is looked at.
const SLICES: usize = 48;
/// Slices before the middle.
const BEFORE: f64 = 0.15;
/// In radii: where the body begins, and how far from there it is looked at, m.
const BODY: f64 = 1.5;
const BODY_LENGTH: f64 = 0.22;
/// In radii of the ball, beside its middle: the ridge.
const RIDGE: f64 = 0.5;
/// In radii below the middle: the level at which widths are taken.
const LEVEL: f64 = 0.5;
/// Half of the greatest width that is looked at, m, and the width of a column.
const SIDE: f64 = 0.36;
const COLUMN: f64 = 0.012;
const COLUMNS: usize = 60;
/// So many empty columns end a width.
const GAP: usize = 3;

/// What lies in one slice across the couch.
#[derive(Debug, Clone, Copy)]
struct Slice {
    /// Highest point of the ridge over the plane, m.
    ridge: f64,
    /// Columns with surface at the level of the widths.
    columns: [bool; COLUMNS],
}

impl Slice {
    const EMPTY: Self = Self { ridge: f64::NAN, columns: [false; COLUMNS] };

    /// How far what hangs together with the middle reaches to either side, m; zeros where nothing is there.
    fn reaches(&self) -> [f64; 2] {
        let middle = COLUMNS / 2;
        let Some(start) = (middle.saturating_sub(GAP)..=middle + GAP).find(|c| self.columns[*c]) else {
            return [0.0; 2];
        };
        let end = |columns: &mut dyn Iterator<Item = usize>| {
            let (mut end, mut empty) = (start, 0);
            for column in columns {
                empty = if self.columns[column] { 0 } else { empty + 1 };
                if empty > GAP {
                    break;
                }
                if empty == 0 {
                    end = column;
                }
            }
            end
        };
        let (right, left) = (end(&mut (start..COLUMNS)), end(&mut (0..start).rev()));
        // Half of the middle column is on either side.
        let reach = |columns: usize| (columns as f64 + 0.5) * COLUMN;
        [reach(middle.saturating_sub(left)), reach(right.saturating_sub(middle))]
    }

    /// Width of what hangs together with the middle, m.
    fn width(&self) -> f64 {
        let [left, right] = self.reaches();
        left + right
    }
}

/// Which candidate is the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Choice {
    /// This one, by its number.
    Head(usize),
    /// None is certain enough; the number of the best.
    None(Option<usize>),
    /// Two may be it.
    Ambiguous([usize; 2]),
}

/// The candidates of a frame; after the first frames it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct HeadCandidates {
    candidates: Vec<Candidate>,
    slices: Vec<Slice>,
}

impl HeadCandidates {
    /// The candidates of the last frame, the best first.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// Notes which part of what was cut out as the best candidate is stray. Says whether the candidate is certain enough
    /// still.
    pub fn cut_out(&mut self, stray: f64) -> bool {
        let Some(best) = self.candidates.first_mut() else { return true };
        best.alone = at_limit(1.0 - stray, ALONE);
        best.certainty() >= ENOUGH
    }

    /// Forgets them.
    pub fn clear(&mut self) {
        self.candidates.clear();
    }

    /// Judges balls over a plane among the patches of a frame, `side` metres wide each, and says which is the head. `radius`
    /// is that of the adult head, m.
    pub fn judge(
        &mut self,
        balls: impl Iterator<Item = Ball>,
        patches: &[Patch],
        plane: &Plane,
        params: &IdentityParams,
        radius: f64,
        side: f64,
    ) -> Choice {
        self.candidates.clear();
        for ball in balls {
            let candidate = self.candidate(&ball, patches, plane, params, side);
            self.join(candidate, params.margin, radius);
        }
        self.candidates.sort_by(|a, b| b.certainty().total_cmp(&a.certainty()));
        let certainty = |number: usize| self.candidates.get(number).map(Candidate::certainty);
        match (certainty(0), certainty(1)) {
            (Some(best), _) if best < ENOUGH => Choice::None(Some(0)),
            (Some(best), Some(next)) if next >= ENOUGH.min(best - params.margin) => Choice::Ambiguous([0, 1]),
            (Some(_), _) => Choice::Head(0),
            (None, _) => Choice::None(None),
        }
    }

    /// Adds a candidate. Of all that are of one thing with it, the one that stands for the thing stays.
    fn join(&mut self, mut candidate: Candidate, margin: f64, radius: f64) {
        // The one that stays may be of one thing with others than the one that was added.
        while let Some(at) = self.candidates.iter().position(|c| is_one_thing(c, &candidate, radius)) {
            let other = self.candidates.swap_remove(at);
            if is_better(&other, &candidate, margin) {
                candidate = other;
            }
        }
        self.candidates.push(candidate);
    }

    fn candidate(
        &mut self,
        ball: &Ball,
        patches: &[Patch],
        plane: &Plane,
        params: &IdentityParams,
        side: f64,
    ) -> Candidate {
        let place = (params.couch_from_cloud * Point3::from(ball.centre)).coords;
        let height = plane.normal.dot(&ball.centre) + plane.offset;
        let mut candidate = Candidate {
            ball: *ball,
            place,
            height,
            valley: f64::NAN,
            neck: f64::NAN,
            reach: ball.radius,
            size: 1.0,
            body_area: f64::NAN,
            body_width: f64::NAN,
            midline: f64::NAN,
            end: f64::INFINITY,
            in_region: params.region.map_or(1.0, |region| region.certainty(&place, height)),
            shape: 1.0,
            alone: 1.0,
        };
        if params.needs_body {
            self.measure(&mut candidate, patches, plane, params, side);
        }
        candidate
    }

    /// Measures what lies footwards.
    fn measure(
        &mut self,
        candidate: &mut Candidate,
        patches: &[Patch],
        plane: &Plane,
        params: &IdentityParams,
        side: f64,
    ) {
        let ball = &candidate.ball;
        let axes = params.couch_from_cloud.rotation.inverse();
        let up = plane.normal;
        let foot = axes * -Vector3::y();
        let foot = (foot - up * up.dot(&foot)).normalize();
        let across = up.cross(&foot);
        let level = candidate.height - LEVEL * ball.radius;
        self.slices.clear();
        self.slices.resize(SLICES, Slice::EMPTY);
        let mut area = 0.0;
        for patch in patches {
            let offset = patch.place - ball.centre;
            let (along, lateral) = (foot.dot(&offset), across.dot(&offset));
            let slice = (along + BEFORE) / SLICE;
            if lateral.abs() >= SIDE || !(slice >= 0.0 && slice < SLICES as f64) {
                continue;
            }
            let height = up.dot(&patch.place) + plane.offset;
            let slice = &mut self.slices[slice as usize];
            if lateral.abs() < RIDGE * ball.radius {
                slice.ridge = if slice.ridge >= height { slice.ridge } else { height };
            }
            if height > level {
                let column = ((lateral + SIDE) / COLUMN) as usize;
                slice.columns[column.min(COLUMNS - 1)] = true;
            }
            if (BODY * ball.radius..BODY * ball.radius + BODY_LENGTH).contains(&along) {
                // A patch shows as much surface as its side, seen along the normal; what faces sideways shows more.
                area += side * side;
            }
        }
        let radius = ball.radius;
        let slices = |from: f64, to: f64| {
            let number = |along: f64| (((along + BEFORE) / SLICE).max(0.0) as usize).min(SLICES);
            number(from)..number(to).max(number(from) + 1).min(SLICES)
        };
        let highest = |range: core::ops::Range<usize>, all: &[Slice]| {
            all[range].iter().map(|s| s.ridge).fold(f64::NAN, f64::max)
        };
        let own = highest(slices(-0.8 * radius, 0.9 * radius), &self.slices);
        let body = highest(slices(BODY * radius, BODY * radius + BODY_LENGTH), &self.slices);
        let between = slices(0.5 * radius, 2.2 * radius);
        let saddle = self.slices[between.clone()].iter().map(|s| s.ridge).fold(f64::NAN, f64::min);
        let valley = (own.min(body) - saddle) / radius;
        candidate.valley = if valley.is_finite() { valley } else { 0.0 };
        let widest = |range: core::ops::Range<usize>, all: &[Slice]| {
            all[range].iter().map(Slice::width).fold(0.0, f64::max)
        };
        let head = widest(slices(-0.6 * radius, 0.6 * radius), &self.slices);
        let lowest = between.clone().min_by(|a, b| {
            let ridge = |n: &usize| {
                if self.slices[*n].ridge.is_nan() { f64::INFINITY } else { self.slices[*n].ridge }
            };
            ridge(a).total_cmp(&ridge(b))
        });
        let middle = (BEFORE / SLICE) as usize;
        let crown = (0..=middle).rev().take_while(|n| self.slices[*n].width() > 0.0).last().unwrap_or(middle);
        let along = |slice: usize| (slice as f64 + 0.5) * SLICE - BEFORE;
        candidate.end = lowest.map_or(f64::INFINITY, |lowest| along(lowest) + NECK_RETAINED * radius);
        let length = lowest.map_or(0.0, |lowest| lowest.saturating_sub(crown) as f64 * SLICE);
        let footwards = slices(BODY * radius, BODY * radius + BODY_LENGTH);
        let widest_body =
            self.slices[footwards].iter().max_by(|a, b| a.width().total_cmp(&b.width())).map(Slice::reaches);
        let [left, right] = widest_body.unwrap_or_default();
        let shoulders = left + right;
        candidate.midline = if shoulders > 0.0 { left.min(right) / left.max(right) } else { 0.0 };
        let narrow =
            self.slices[between].iter().map(Slice::width).filter(|w| *w > 0.0).fold(f64::INFINITY, f64::min);
        // Two shoulders with a dent between are no neck: the width of what is not the candidate's does not count.
        let own_width = head.min(WIDE * 2.0 * radius);
        candidate.neck = if narrow.is_finite() { own_width.min(shoulders) / narrow } else { 0.0 };
        candidate.reach = if head <= BESIDES * 2.0 * radius { radius.max(head / 2.0) } else { radius };
        candidate.size = (head / ADULT_WIDTH).max(length / ADULT_LENGTH).max(2.0 * radius / ADULT_BALL);
        candidate.body_area = area;
        candidate.body_width = shoulders / (2.0 * radius);
        let set_off = at_limit(candidate.valley, VALLEY).max(at_limit(candidate.neck, NECK));
        let has_body = at_limit(area, AREA).min(at_limit(candidate.body_width, WIDTH));
        candidate.shape = set_off.min(has_body).min(at_limit(candidate.midline, MIDLINE));
    }
}

/// Whether two balls are of one thing: near each other, or one footwards of the other by less than a head is long, as the
/// face and the neck are of a cranium.
fn is_one_thing(a: &Candidate, b: &Candidate, radius: f64) -> bool {
    let offset = b.place - a.place;
    let (across, along) = (offset.x.abs(), offset.y.abs());
    let radii = a.ball.radius.max(b.ball.radius);
    offset.norm() < ONE_THING * radius || (across < ASIDE * radii && along < LENGTH * radii)
}

/// Whether `a` rather than `b` stands for the one thing that both are of: the headward one, unless it is the less certain
/// and no more of it is seen.
fn is_better(a: &Candidate, b: &Candidate, margin: f64) -> bool {
    let (headward, other) = if a.place.y >= b.place.y { (a, b) } else { (b, a) };
    let is_more = headward.ball.voters as f64 > MORE * other.ball.voters as f64;
    let is_sure = headward.certainty() >= ENOUGH.max(other.certainty() - margin) || is_more;
    let better = if is_sure || headward.certainty() >= other.certainty() { headward } else { other };
    core::ptr::eq(better, a)
}

impl Region {
    /// The origin of the couch's frame lies below the head: up to 160 mm beside it, its middle 30 to 270 mm over the plane.
    pub const DEFAULT: Self = Self { at: [0.0, 0.0], half: 0.16, height: [0.03, 0.27] };

    fn certainty(&self, place: &Vector3<f64>, height: f64) -> f64 {
        let margin = REGION_MARGIN * self.half;
        let lateral = (place.x - self.at[0]).abs().max((place.y - self.at[1]).abs());
        let [low, high] = self.height;
        let inside = (self.half - lateral).min(height - low).min(high - height);
        (0.5 + inside / (2.0 * margin)).clamp(0.0, 1.0)
    }
}

/// 0.5 at the limit, 0 and 1 a way below and above it.
fn at_limit(value: f64, [limit, margin]: [f64; 2]) -> f64 {
    (0.5 + (value - limit) / (2.0 * margin)).clamp(0.0, 1.0)
}
