//! Parameters of `track.head`.

use stillpoint_operator::config::tree::{Node, Value};
use stillpoint_operator::params::{ParamField, ParamReader, ParamType, ParamValue, json};
use stillpoint_operator::{Choice, Params};

use crate::align::AlignParams;
use crate::surface::SurfaceParams;
use crate::tracker::TrackParams;

/// What makes the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Method {
    /// All of the face, on the reference's surface.
    Dense,
    /// Three points and the quaternion of their cross-covariance, (4.21)-(4.22).
    ThreePoints,
}

/// Event that makes a face the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum CaptureBy {
    /// It is the first one. A command makes another one it.
    First,
    /// A person's command, `capture`. Until then there is no pose.
    Command,
}

/// Whether a person has to confirm a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Confirm {
    /// Nothing arms before `console.confirm`.
    Required,
    /// Nobody has to. For phantoms and benches alone.
    Waived,
}

/// Whether a reference has to hold each of the six directions of a movement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Directions {
    /// All of them. A face that does not is refused.
    All,
    /// Any number. The others have infinite variance. For round phantoms.
    Any,
}

/// What is done about skin that moves by itself: neck, jaw, cheeks, brows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum SoftTissue {
    /// Nothing: all of the face counts alike, and a neck that bends or a smile is doubted.
    Ignored,
    /// The neck is left out, and a fixed table of how far each part of a face moves weighs the points. Where no nose or no
    /// axes of the couch are found, it is as if ignored.
    Weighted,
}

/// Whether the pieces of the reference are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum SendPieces {
    /// With each frame that was found on the reference.
    Sent,
    /// Never.
    Off,
}

/// Which point of the head is its origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Origin {
    /// The mean of the reference's points: it lies near the face's surface.
    Centroid,
    /// The point nearest to all of the surface's normals: it lies inside the head, where turning moves it least.
    Centre,
}

/// A reference that is known before a face is captured: one of `cloud` and `surface`.
#[derive(Clone, Debug, Params)]
pub struct ReferenceParams {
    /// A PCD file with a face, in the frame of `face`. `reference: FILE` says the same. A `capture` replaces it.
    #[param(file)]
    pub cloud: Option<String>,
    /// The surface of the patient in the planning CT: a case file, or a mesh in mm in the DICOM patient frame (PLY, STL).
    /// A capture looks for this surface in the face, and refuses a face that is not this patient's.
    #[param(file)]
    pub surface: Option<String>,
    /// Place of the machine's isocentre in the frame of the pose: where the plan wants the isocentre of the surface.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-10 m", max = "10 m")]
    pub isocentre: [f64; 3],
    /// Isocentre of the plan in the frame of the surface. Without it the file has to name it, as cases do, and the meshes
    /// of `stillpoint case surface`.
    #[param(unit = "m", min = "-10 m", max = "10 m")]
    pub planned_isocentre: Option<[f64; 3]>,
    /// The surface counts up to this distance from the isocentre along each axis of the couch.
    #[param(unit = "m", default = "150 mm", min = "50 mm", max = "490 mm")]
    pub region: f64,
    /// Largest root mean square distance of a face from the surface, beside the camera's noise, at which it is this
    /// patient's.
    #[param(unit = "m", default = "0.8 mm", above = "0 mm", max = "10 mm")]
    pub max_misfit: f64,
}

/// [`ReferenceParams`] as a config gives them: a text alone is the PCD file.
#[derive(Clone, Debug)]
pub enum Reference {
    /// A face in a PCD file.
    Cloud(String),
    /// The parameters.
    Given(Box<ReferenceParams>),
}

impl ParamValue for Reference {
    const TYPE: ParamType = ParamType::Group(ReferenceParams::FIELDS);

    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        match &node.value {
            Value::Text(_) => String::read(node, &ReferenceParams::FIELDS[0], reader).map(Self::Cloud),
            _ => reader.group(node, field).map(|given| Self::Given(Box::new(given))),
        }
    }

    fn resolved(&self) -> json::Value {
        match self {
            Self::Cloud(name) => name.resolved(),
            Self::Given(params) => params.resolved(),
        }
    }
}

/// Parameters of `track.head`.
#[derive(Clone, Debug, Params)]
pub struct HeadParams {
    /// Method of the pose that is sent as `pose`. The pose by three points is always sent beside it.
    #[param(default = "dense")]
    pub method: Method,
    /// Event that makes a face the reference.
    #[param(default = "first")]
    pub capture: CaptureBy,
    /// Whether a person must confirm a reference (`console.confirm`) before valves arm and the beam is allowed.
    #[param(default = "required")]
    pub confirm: Confirm,
    /// A reference that is known before a face is captured: a PCD file with a face, or the surface of the planning CT.
    pub reference: Option<Reference>,
    /// Directions of a movement that a captured face has to hold. A ball holds three, and a face of which too little is seen
    /// may hold five: neither is captured.
    #[param(default = "all")]
    pub directions: Directions,
    /// Number of frames of a reference. The head may move: each frame is aligned with the first.
    #[param(default = 1, min = 1, max = 16)]
    pub capture_frames: u32,
    /// Of the last ten frames, so many must show a face where it lies, before a person's command takes one. Noise makes a
    /// shoulder or a fist pass for a head in single frames. Frames without a face count if `rejection` is connected. With
    /// the surface of a planning CT, and for `capture: first`, one face is enough.
    #[param(default = 4, min = 1, max = 10)]
    pub capture_seen: u32,
    /// For so long, from the first frame after it, a person's command holds. A face that comes later was not there when
    /// the person asked: it has to be asked for again. With the surface of a planning CT a command holds until it is met.
    #[param(unit = "ns", default = "1200 ms", min = "100 ms", max = "60 s")]
    pub capture_within: u64,
    /// Origin of the head where no known surface gives an isocentre. The axes of the head are those of the pose's frame at
    /// the capture.
    #[param(default = "centroid")]
    pub origin: Origin,
    /// Skin that moves by itself: with `weighted`, a smile costs the beam and lets go of nothing.
    #[param(default = "weighted")]
    pub soft_tissue: SoftTissue,
    /// The pieces of the reference on the output `pieces`, for people who look on.
    #[param(default = "sent")]
    pub pieces: SendPieces,
    /// Place of the point of the head whose pose is sent, from the isocentre of a known surface, else from `origin`, along
    /// the axes of the head. Targets, controllers and the gate judge this point.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-300 mm", max = "300 mm")]
    pub point: [f64; 3],
    /// Distance between the patches of the reference's surface.
    #[param(unit = "m", default = "4 mm", min = "1 mm", max = "20 mm")]
    pub spacing: f64,
    /// Radius of the points that a patch is fitted to; it grows where the reference has too few points.
    #[param(unit = "m", default = "8 mm", min = "2 mm", max = "40 mm")]
    pub smoothing: f64,
    /// A point within this distance lies on the reference.
    #[param(unit = "m", default = "5 mm", min = "0.1 mm", max = "50 mm")]
    pub tolerance: f64,
    /// Part of a face's points that must lie on the reference, and of the reference under them, else the head is lost.
    #[param(default = 0.5, min = 0.1, max = 1)]
    pub min_overlap: f64,
    /// Mean square that the surface must move along its normals per unit of movement, else the direction is refused.
    #[param(default = 0.005, min = 0.0001, max = 0.5)]
    pub min_sensitivity: f64,
    /// Points of a face that the last iterations use at most, spread evenly.
    #[param(default = 6000, min = 500, max = 1000000)]
    pub points: u32,
    /// Points that a face needs.
    #[param(default = 500, min = 100, max = 1000000)]
    pub min_points: u32,
    /// Points of a face and of the reference at most: shared memory is laid out by it.
    #[param(default = 100000, min = 1000, max = 4194304)]
    pub max_points: u32,
    /// Standard deviation of each of the three points, for the covariance of their pose.
    #[param(unit = "m", default = "2 mm", above = "0 mm", max = "100 mm")]
    pub three_points_sd: f64,
}

impl HeadParams {
    /// What of them the tracker needs.
    #[must_use]
    pub fn tracking(&self) -> TrackParams {
        TrackParams {
            surface: SurfaceParams { spacing: self.spacing, smoothing: self.smoothing },
            align: AlignParams { tolerance: self.tolerance, least_sensitivity: self.min_sensitivity },
            points: self.points as usize,
            min_points: self.min_points as usize,
            min_overlap: self.min_overlap,
        }
    }
}
