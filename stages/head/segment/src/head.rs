//! The head among what it touches: cut out of a cluster where that is cheapest.
//!
//! The dissertation takes the largest cluster. That fails where the head touches a pad, a pillow or a shoulder, since
//! these are then one cluster with it. Here a ball of a head's size is sought first (see [`ball`](crate::ball)). Its
//! upper side belongs to the head. What meets the couch beside it, and what is farther from its centre than a head
//! reaches, does not. In between, a minimum cut (Golovinskiy and Funkhouser, 2009) parts the surface where it is
//! creased: heads, pads and shoulders are convex each, and where two convex things touch there is a concave crease
//! (Stein et al., 2014). So the rule knows the size of a head, and no height of pads.

use crate::ball::{Ball, BallSearch};
use crate::cut::{Lean, MinCut};
use crate::forest::{root, unite};
use crate::hills::{Hills, lateral};
use crate::identity::{Candidate, Choice, HeadCandidates, IdentityParams};
use crate::neck::Neck;
use crate::plane::Plane;
use crate::surface::{Patch, Surface};

/// What is known of heads, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadParams {
    /// Mean distance of an adult head's surface from its middle.
    pub radius: f64,
    /// Width of a voxel.
    pub leaf: f64,
    /// Height over the plane at which the voxels start.
    pub height_min: f64,
    /// What a candidate must be to be the head; without it, the highest ball is.
    pub identity: Option<IdentityParams>,
}

impl HeadParams {
    /// Whether the patches that support a ball cover enough of its half that faces the camera.
    pub(crate) fn is_shown(&self, ball: &Ball) -> bool {
        self.part_shown(ball) >= SHOWN
    }

    /// Part of the half of a ball that faces the camera that the patches that support it cover.
    fn part_shown(&self, ball: &Ball) -> f64 {
        let side = PATCH * self.leaf;
        let half_ball = 2.0 * std::f64::consts::PI * ball.radius * ball.radius;
        ball.voters as f64 * side * side / half_ball
    }
}

/// Why nothing over the plane may be a head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unlike {
    /// Nothing is as round as a head of these radii, m.
    Flat { radii: [f64; 2] },
    /// The middle of the roundest thing is this high over the plane, and that of a head of its size at least so high, m: what
    /// lies around it hides the rest, or is taken for the couch.
    Low { height: f64, least: f64 },
    /// Of the half of the roundest thing that faces the camera this part is seen; the least of a head.
    Hidden { shown: f64, least: f64 },
}

/// Why there is no head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoHead {
    /// Nothing has the size and roundness of a head.
    Nothing(Unlike),
    /// No candidate passes the checks of identity.
    Uncertain,
    /// More than one candidate may be the head.
    Ambiguous,
}

/// Heads are from this part of the adult radius to that.
const SIZES: [f64; 2] = [0.6, 1.35];
/// The same where the checks of identity tell a head from all else of its size.
const SIZES_CHECKED: [f64; 2] = [0.45, 1.35];
/// Heads of less than this part of the adult size are cut by their own size.
const SMALL: f64 = 0.8;
/// Width of a patch in voxels.
const PATCH: f64 = 2.0;
/// A head, and a neck, shows at least this part of the half of its ball that faces the camera.
const SHOWN: f64 = 0.35;
/// In radii of its ball, how high over the plane a head's middle is: of a pillow or a shoulder, less than half would be
/// seen.
const LYING: f64 = 0.9;
/// The same where the checks of identity tell it from these: thick hair may lie on the couch.
const LYING_CHECKED: f64 = 0.75;
// Lengths from here on are in radii of the adult head: that of the ball depends on which side is seen.

/// Balls nearer to each other are of one head.
const ONE_HEAD: f64 = 0.95;
/// Nothing farther from the ball's centre is the head. A neck ends before.
const REACH: f64 = 3.0;
/// How far the surface of a head and its neck is mostly.
const NEARBY: f64 = 2.0;
/// Beside the ball's centre: what meets the couch farther out is not the head.
const FOOT: f64 = 1.1;
/// Over the ball's centre, in its own radii: the surface of the ball that is higher is the head.
const CAP: f64 = 0.2;
/// Over the least height: what is lower there meets the couch.
const FOOT_HEIGHT: f64 = 0.3;
/// So far may two patches be apart that are seen beside each other, since one hides what is between.
const HIDDEN: f64 = 0.6;
/// Weight against the head of the patches of another object's summit.
const OTHERS: f64 = -8.0;
/// Weight for the head of a patch that faces away from it: a patch that belongs to no other object belongs to the head.
const SUPPORT: f64 = 0.15;
/// Cost of a cut between two neighbouring patches of a flat surface.
const FLAT: f64 = 1000.0;
/// Cost of a cut between two patches that are only seen beside each other, for each pair of pixels.
const SEEN: f64 = 10.0;
/// A crease whose surroundings lie this part of a patch before it costs a factor e less.
const CREASE: f64 = 0.07;
/// Cost of one patch on the side where it is less likely.
const LEANING: f64 = 80.0;

/// The search with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct HeadFinder {
    surface: Surface,
    search: BallSearch,
    graph: MinCut,
    /// Pairs of patches that border on each other, then those that are seen beside each other.
    edges: Vec<[u32; 2]>,
    hills: Hills,
    identity: HeadCandidates,
    neck: Option<Neck>,
    parents: Vec<u32>,
    head: Vec<bool>,
}

impl HeadFinder {
    /// A search without buffers yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Gathers `voxels` (metres), `leaf` metres wide, into patches; says for each voxel which patch it is in.
    pub fn gather(&mut self, voxels: &[[f32; 3]], leaf: f64) -> &[u32] {
        self.surface.gather(voxels, PATCH * leaf);
        self.surface.patch_of_voxel()
    }

    /// Finds the head over `plane` among the patches that were gathered last; `seen` are pairs of patches that are seen
    /// beside each other in the camera's image.
    ///
    /// # Errors
    /// Nothing has the size and roundness of a head, or by the checks of its identity none or several may be it.
    pub fn find(&mut self, seen: &[[u32; 2]], plane: &Plane, params: &HeadParams) -> Result<(), NoHead> {
        self.head.clear();
        self.identity.clear();
        let sizes = if params.identity.is_some() { SIZES_CHECKED } else { SIZES };
        let radii = sizes.map(|size| size * params.radius);
        let height = |ball: &Ball| plane.normal.dot(&ball.centre);
        // Where several things are round, such as pads and shoulders, the head lies on or over them.
        let balls = self.search.find(self.surface.patches(), radii).iter();
        let lying = if params.identity.is_some() { LYING_CHECKED } else { LYING };
        let lies_on = |ball: &Ball| height(ball) + plane.offset > lying * ball.radius;
        let shown = || balls.clone().filter(|ball| lies_on(ball) && params.is_shown(ball));
        if shown().next().is_none() {
            // The thing that is the roundest is what a person would take for the head.
            let round = balls.filter(|ball| params.part_shown(ball) > SHOWN / 2.0);
            let unlike = match round.max_by_key(|ball| ball.voters) {
                None => Unlike::Flat { radii },
                Some(ball) if lies_on(ball) => {
                    Unlike::Hidden { shown: params.part_shown(ball), least: SHOWN }
                }
                Some(ball) => Unlike::Low { height: height(ball) + plane.offset, least: lying * ball.radius },
            };
            return Err(NoHead::Nothing(unlike));
        }
        let patches = self.surface.patches();
        // Balls of one thing, and with the checks of identity that of the head alone.
        let mut radius = params.radius;
        let middle = match &params.identity {
            None => None,
            Some(identity) => {
                let side = PATCH * params.leaf;
                let all = shown().copied();
                match self.identity.judge(all, patches, plane, identity, params.radius, side) {
                    Choice::Head(number) => self.identity.candidates().get(number).map(|candidate| {
                        if candidate.size < SMALL {
                            radius *= candidate.size.max(SIZES_CHECKED[0]);
                        }
                        candidate.ball.centre
                    }),
                    Choice::None(_) => return Err(NoHead::Uncertain),
                    Choice::Ambiguous(_) => return Err(NoHead::Ambiguous),
                }
            }
        };
        let is_chosen = |ball: &&Ball| {
            middle.is_none_or(|middle| (ball.centre - middle).norm() < ONE_HEAD * params.radius)
        };
        let highest = shown().filter(is_chosen).max_by(|a, b| height(a).total_cmp(&height(b)));
        let Some(highest) = highest.copied() else { return Err(NoHead::Uncertain) };
        let params = &HeadParams { radius, ..*params };
        // A face is round, too, and may be higher than the cranium, of which more is seen.
        let near = |ball: &&Ball| (ball.centre - highest.centre).norm() < ONE_HEAD * params.radius;
        let cranium = shown().filter(near).max_by_key(|ball| ball.voters).copied();
        self.collect_edges(seen, params);
        let ball = self.find_neck(cranium.unwrap_or(highest), highest, plane, params);
        self.build(&ball, plane, params);
        self.graph.cut();
        self.keep_what_hangs_together(&ball, plane, params.identity.as_ref());
        match params.identity.as_ref().map(|identity| self.stray(identity)) {
            Some(stray) if !self.identity.cut_out(stray) => {
                self.head.clear();
                Err(NoHead::Uncertain)
            }
            _ => Ok(()),
        }
    }

    /// The things of a head's size of the last search, the likeliest head first; empty without checks of identity.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate] {
        self.identity.candidates()
    }

    /// Forgets the candidates of the last search.
    pub fn forget(&mut self) {
        self.identity.clear();
    }

    /// For each voxel whether it is the head's; empty where there is none.
    #[must_use]
    pub fn is_head(&self) -> &[bool] {
        &self.head
    }

    /// Borders, and pairs of patches seen beside each other that are no neighbours: one hides a part of the other.
    fn collect_edges(&mut self, seen: &[[u32; 2]], params: &HeadParams) {
        self.edges.clear();
        self.edges.extend_from_slice(self.surface.borders());
        let patches = self.surface.patches();
        for &[a, b] in seen {
            // Most are neighbours.
            if self.surface.are_neighbours(a, b) {
                continue;
            }
            let apart = (patches[a as usize].place - patches[b as usize].place).norm();
            if apart < HIDDEN * params.radius {
                self.edges.push([a, b]);
            }
        }
    }

    /// Looks for the neck of the cranium, then of the face, and for what lies beside. Says whose ball it is.
    fn find_neck(&mut self, cranium: Ball, face: Ball, plane: &Plane, params: &HeadParams) -> Ball {
        let (patches, radius) = (self.surface.patches(), params.radius);
        self.hills.measure(patches, plane);
        // Where one thing hides a part of another, a pixel's step leads over the valley between them: no such steps
        // yet.
        self.hills.find(self.surface.borders());
        self.hills.part(radius);
        let (balls, hills) = (self.search.balls(), &mut self.hills);
        // Often they are one.
        let face_too = (face != cranium).then_some(face);
        let found = [cranium].into_iter().chain(face_too).find_map(|ball| {
            hills.separate(patches, &ball, plane, radius, true);
            let neck = Neck::of_balls(balls, &ball, plane, params);
            Some((ball, neck.or_else(|| Neck::of_face(hills.own(patches), &ball, plane, radius))?))
        });
        self.neck = found.map(|(_, neck)| neck);
        if self.neck.is_none() {
            self.hills.find(&self.edges);
            self.hills.part(radius);
            self.hills.separate(patches, &face, plane, radius, false);
        }
        found.map_or(face, |(ball, _)| ball)
    }

    fn build(&mut self, ball: &Ball, plane: &Plane, params: &HeadParams) {
        let (patches, neck) = (self.surface.patches(), self.neck);
        let borders = self.surface.borders().len();
        let side = PATCH * params.leaf;
        let low = params.height_min + FOOT_HEIGHT * params.radius;
        self.graph.start(patches.len());
        for (number, (patch, &height)) in patches.iter().zip(self.hills.heights()).enumerate() {
            let from_centre = patch.place - ball.centre;
            let distance = from_centre.norm() / params.radius;
            let foot = height < low && lateral(&patch.place, ball, plane) > FOOT * params.radius;
            let is_head = is_cap(patch, ball, plane) || neck.is_some_and(|neck| neck.is_core(patch));
            let lean = if is_head {
                Lean::Source
            } else if distance > REACH || foot {
                Lean::Sink
            } else if self.hills.are_others(number) && !neck.is_some_and(|neck| neck.holds(patch)) {
                Lean::Cost((LEANING * OTHERS) as i32)
            } else {
                // A head's surface faces away from its middle; what it lies on faces up from below.
                let outward = patch.normal.dot(&from_centre) / from_centre.norm().max(1e-9);
                let round = (2.0 * outward).clamp(SUPPORT, 1.0);
                let near = (NEARBY - distance).clamp(-1.0, 1.0);
                let lean = neck.and_then(|neck| neck.lean(patch)).unwrap_or(round.min(near));
                Lean::Cost((LEANING * lean) as i32)
            };
            self.graph.lean(number as u32, lean);
        }
        let crease = CREASE * side;
        for (number, &[a, b]) in self.edges.iter().enumerate() {
            self.graph.join(a, b, || {
                let bent: f64 = [a, b].iter().map(|&patch| patches[patch as usize].bend.max(0.0)).sum();
                let capacity = match number < borders {
                    true if bent > 0.0 => FLAT * libm::exp(-bent / 2.0 / crease),
                    true => FLAT,
                    false => SEEN,
                };
                capacity as u32 + 1
            });
        }
    }

    /// Part of the voxels that were cut out that are farther from the head's ball than the surface of a head.
    fn stray(&self, identity: &IdentityParams) -> f64 {
        let Some(candidate) = self.identity.candidates().first() else { return 0.0 };
        let patches = self.surface.patches();
        let all = self.surface.patch_of_voxel().iter().zip(&self.head).filter(|(_, is_head)| **is_head);
        let (mut count, mut stray) = (0.0, 0.0);
        for (&patch, _) in all {
            count += 1.0;
            stray += f64::from(u8::from(identity.is_stray(candidate, &patches[patch as usize].place)));
        }
        if count > 0.0 { stray / count } else { 0.0 }
    }

    /// Keeps what is joined to the cap, or to the neck, by patches on the head's side of the cut, and does not lie beyond the
    /// head's end.
    fn keep_what_hangs_together(&mut self, ball: &Ball, plane: &Plane, identity: Option<&IdentityParams>) {
        let chosen = identity.zip(self.identity.candidates().first());
        let patches = self.surface.patches();
        self.parents.clear();
        self.parents.extend(0..patches.len() as u32 + 1);
        let cap = patches.len() as u32;
        for &[a, b] in &self.edges {
            if self.graph.with_source(a) && self.graph.with_source(b) {
                unite(&mut self.parents, a, b);
            }
        }
        // A chin may hide where the neck joins the head.
        let is_neck = |patch: &Patch| self.neck.is_some_and(|neck| neck.holds(patch));
        for (number, patch) in patches.iter().enumerate() {
            let number = number as u32;
            if is_cap(patch, ball, plane) || (is_neck(patch) && self.graph.with_source(number)) {
                unite(&mut self.parents, number, cap);
            }
        }
        let head = root(&mut self.parents, cap);
        for &patch in self.surface.patch_of_voxel() {
            let within = chosen.is_none_or(|(identity, candidate)| {
                identity.holds(candidate, &patches[patch as usize].place)
            });
            let is = within && self.graph.with_source(patch) && root(&mut self.parents, patch) == head;
            self.head.push(is);
        }
    }
}

/// Whether a patch is on the upper side of the ball's surface.
fn is_cap(patch: &Patch, ball: &Ball, plane: &Plane) -> bool {
    let from_centre = patch.place - ball.centre;
    let distance = from_centre.norm();
    distance < 1.3 * ball.radius
        && distance > 0.7 * ball.radius
        && plane.normal.dot(&from_centre) > CAP * ball.radius
        && patch.normal.dot(&from_centre) > 0.6 * distance
}
