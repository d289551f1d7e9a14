//! Requests for plans, and plans.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Axis, Codes, Layout, Quaternion, Sample, SampleKind, Shape, YesNo};

/// Asks for a plan of a case in a set-up.
pub struct PlanRequest;

/// The fields of a [`PlanRequest`]. The set-up is a motion of the patient from where the plan was made, in the frame of
/// the couch (IEC 61217 table top).
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct PlanRequestElement {
    /// How far the point of the patient at the isocentre has moved.
    #[unit("m")]
    #[parts(Axis)]
    pub position: [f64; 3],
    /// The turn of the patient about that point: unit quaternion, scalar first.
    #[parts(Quaternion)]
    pub orientation: [f64; 4],
    /// Content hash of the case, 32 bytes as four little-endian words.
    pub case_hash: [u64; 4],
    /// Number of beams of the plan.
    pub beams: u32,
    /// Number of solves that the search may make.
    pub budget: u32,
}

impl Sample for PlanRequest {
    type Body = ();
    type Element = PlanRequestElement;
    const NAME: &'static str = "PlanRequest";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Asks for a plan of a case in a set-up.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

/// The best plan so far for a request: beams, figures and fluence. It is an offer: only a person accepts it.
pub struct PlanUpdate;

/// The values of the whole plan.
///
/// Doses of the target are of the target with the highest prescription, in the set-up of the request, at the points
/// that are optimised. They are no recomputation on a finer grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct PlanUpdateBody {
    /// Sequence of the request.
    pub request: u64,
    /// Objective of the plan; NaN as long as there is no plan.
    pub objective: f64,
    /// Dose that 98 % of the target get at least; NaN as long as there is no plan.
    #[unit("Gy")]
    pub target_d98: f64,
    /// Dose that 2 % of the target get at least; NaN as long as there is no plan.
    #[unit("Gy")]
    pub target_d2: f64,
    /// The same as `target_d98` for the standing plan; NaN as long as it is not known.
    #[unit("Gy")]
    pub standing_d98: f64,
    /// The same as `target_d2` for the standing plan; NaN as long as it is not known.
    #[unit("Gy")]
    pub standing_d2: f64,
    /// Gantry angles (IEC 61217); NaN beyond `beams`.
    #[unit("rad")]
    pub angles: [f64; 12],
    /// Content hash of the case of the operator, 32 bytes as four little-endian words.
    pub case_hash: [u64; 4],
    /// Number of beams of the plan; 0 as long as there is no plan.
    pub beams: u32,
    /// Number of solves so far.
    pub solves: u32,
    /// A [`PlanStanding`] as its number.
    #[codes(PlanStanding)]
    pub standing: u32,
    /// 1 if the work on this request has ended, else 0.
    #[codes(YesNo)]
    pub ended: u32,
    /// Why the request is refused, as a [`PlanRefusal`]; 0 where it is not.
    #[codes(PlanRefusal)]
    pub refusal: u32,
    /// Number of bixels.
    pub length: u32,
}

/// The weight of one bixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct BixelWeight {
    /// Centre on the isocentre plane, along x and z of the beam's frame.
    #[unit("m")]
    pub centre: [f32; 2],
    /// Weight.
    pub weight: f32,
    /// Index of the beam in `angles`.
    pub beam: u32,
}

/// Whether the standing plan holds in the set-up of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum PlanStanding {
    /// It is not known: there is no standing plan, or its doses in this set-up are not computed yet.
    Unknown = 0,
    /// The target gets its dose, and the limits of the operator are kept.
    Holds = 1,
    /// The target does not get its dose, or a limit is broken.
    Fails = 2,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum PlanRefusal {
    /// It is not refused.
    #[word("not refused")]
    None = 0,
    /// The request names another case.
    Case = 1,
    /// A plan cannot have that many beams.
    Beams = 2,
    /// The budget of solves is zero or too large.
    Budget = 3,
    /// The set-up is no rigid motion.
    Pose = 4,
    /// The patient is turned too far.
    Turn = 5,
    /// The patient has moved too far.
    Shift = 6,
    /// The plan can have more bixels than an update holds.
    Bixels = 7,
    /// No finished plan is offered for the request that a person accepted; `request` is the number that was accepted.
    Accept = 8,
    /// No worker of the pool was there for the time of patience, and the operator keeps the plans that it has.
    Pool = 9,
    /// A worker that was shut out has given answers for the standing plan, which stands no longer; `request` is the number
    /// of that plan.
    Doubt = 10,
    /// The plan check: too much fluence passes beside the patient.
    CheckOutside = 11,
    /// The plan check: a bixel carries too much of its beam.
    CheckPeak = 12,
    /// The plan check: too many monitor units.
    CheckUnits = 13,
    /// The plan check: the patient gets much more dose when shifted.
    CheckHotter = 14,
    /// The plan check: a target loses much of its dose when shifted.
    CheckUncovered = 15,
    /// The plan check: gantry and couch may collide.
    CheckClosed = 16,
}

impl PlanRefusal {
    /// The reason, as text.
    pub const fn words(self) -> &'static str {
        match self {
            Self::None => "not refused",
            Self::Case => "the request names another case",
            Self::Beams => "a plan cannot have that many beams",
            Self::Budget => "the budget of solves is zero or too large",
            Self::Pose => "the set-up is not a rigid motion of finite numbers",
            Self::Turn => "the patient is turned too far: doses are computed for shifts only",
            Self::Shift => "the patient has moved beyond the reach of the bixels",
            Self::Bixels => "the plan can have more bixels than an update holds",
            Self::Accept => "no finished plan is offered for the accepted request",
            Self::Pool => "no worker of the planning pool was there for the time of patience",
            Self::Doubt => "the current plan has answers of a worker that was excluded, and is withdrawn",
            Self::CheckOutside => "the plan check: too much fluence misses the patient",
            Self::CheckPeak => "the plan check: a bixel carries too much of its beam",
            Self::CheckUnits => "the plan check: too many monitor units",
            Self::CheckHotter => "the plan check: the patient gets much more dose when shifted",
            Self::CheckUncovered => "the plan check: a target loses much of its dose when shifted",
            Self::CheckClosed => "the plan check: gantry and couch may collide",
        }
    }
}

impl PlanUpdateBody {
    /// Whether the standing plan holds. A number that no build of this version wrote counts as unknown.
    pub fn standing(&self) -> PlanStanding {
        match self.standing {
            1 => PlanStanding::Holds,
            2 => PlanStanding::Fails,
            _ => PlanStanding::Unknown,
        }
    }

    /// Why the request is refused; `None` for a number that no build of this version wrote.
    pub const fn refusal(&self) -> Option<PlanRefusal> {
        PlanRefusal::from_number(self.refusal)
    }
}

impl Sample for PlanUpdate {
    type Body = PlanUpdateBody;
    type Element = BixelWeight;
    const NAME: &'static str = "PlanUpdate";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "The best plan so far for a request: beams, figures and fluence.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
