//! Samples: what operators exchange, defined once for shared memory, recording and wire.
//!
//! ```
//! use stillpoint_samples::{Pose, Sample};
//! assert!(Pose::KIND.type_name().starts_with("Pose@"));
//! ```
//!
//! A sample is `Header ++ Body ++ [Element]`. Its bytes in shared memory are the little-endian CDR body that a recording
//! holds. To add a type, add a file with its structs and one line in [`all`].
//!
//! - `layout`: the field table, its size and its hash
//! - `names`: what the numbers of a field mean
//! - `kind`: the sample type, typed and at run time
//! - `bytes`: aligned buffers and typed views
//! - one file per sample type

#![forbid(unsafe_code)]
// Outsiders use it.
#![warn(missing_docs)]
// The derive names this crate by its path, here too.
extern crate self as stillpoint_samples;

mod actuation;
mod boxes;
mod bytes;
mod cloud;
mod clusters;
mod console;
mod contacts;
mod datagram;
mod depth;
mod diagnostics;
mod duties;
mod far_end;
mod gate;
mod grey;
mod health;
mod hull;
mod journal;
mod kind;
mod layout;
mod names;
mod plan;
mod plane;
mod pool;
mod pose;
mod pose_report;
mod rejection;
mod rig_state;
mod setting;
mod surface_pieces;
mod target;
mod track;

pub use actuation::{Actuation, ActuationElement, ActuationReason, ActuationState};
pub use boxes::{FaceBox, FaceBoxes, FaceBoxesShape};
pub use bytes::{AlignedBytes, BytesError, Pieces, View};
pub use cloud::{CloudShape, Point, PointCloud};
pub use clusters::{Cluster, ClusterEdge, ClusterTable, ClusterTableShape};
pub use console::{Command, ConsoleCommand, Verb};
pub use contacts::{Contacts, ContactsElement};
pub use datagram::Datagram;
pub use depth::{DepthImage, Intrinsics};
pub use diagnostics::{Diagnostics, Metric};
pub use duties::{Duties, DutiesElement, DutyReason};
pub use far_end::{FarEnd, FarEndDoing, FarEndElement};
pub use gate::{Gate, GateElement, GateReason};
pub use grey::{GreyImage, GreyShape};
pub use health::{Health, SensorHealth};
pub use hull::{Corner, Hull, HullShape};
pub use journal::{Cause, Entry, Journal, JournalBody, JournalRef, Outcome, RefKind};
pub use kind::{Sample, SampleKind, Shape};
pub use layout::{Field, Layout, Primitive, fields_size, fnv1a, fnv1a_start, hash_fields};
pub use names::{Angle, Axis, Channel, Code, Codes, NO_BITS, Names, OnOff, Quaternion, ValveOrder, YesNo};
pub use plan::{
    BixelWeight, PlanRefusal, PlanRequest, PlanRequestElement, PlanStanding, PlanUpdate, PlanUpdateBody,
};
pub use plane::{Plane, PlaneElement};
pub use pool::{LONGEST_POOL_MESSAGE, PoolMessage, PoolMessageBody, PoolWord};
pub use pose::{Pose, PoseElement};
pub use pose_report::{IdentityPart, PoseReport, PoseReportElement, PoseStatus, Proof, Unproven};
pub use rejection::{Rejection, RejectionElement};
pub use rig_state::{RigFault, RigMode, RigState, RigStateElement};
pub use setting::{Setting, SettingAnswer, SettingAnswerElement, SettingElement, filled};
pub use stillpoint_derive::{Codes, Layout};
pub use surface_pieces::{PieceState, SurfacePiece, SurfacePieces, SurfacePiecesShape};
pub use target::{Refusal, Target, TargetElement, TargetStatus};
pub use track::{Standing, Track, TrackElement};

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// Bytes of a [`Header`].
pub const HEADER_SIZE: usize = 32;

/// What every sample starts with. Logical time only: wall time never enters a sample.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct Header {
    /// Time of the activation that made the sample, ns since the epoch.
    #[unit("ns")]
    pub stamp: u64,
    /// Acquisition time of the oldest sensor sample behind it, ns since the epoch.
    #[unit("ns")]
    pub origin: u64,
    /// Number of the sample on its topic, from 0 in each incarnation of the producer.
    pub sequence: u64,
    /// Which life of the producer made it, from 0.
    pub incarnation: u32,
    /// Number of elements. It stands last so that the bytes from here on are a CDR sequence.
    pub count: u32,
}

const _: () = assert!(size_of::<Header>() == HEADER_SIZE);

/// The fields of [`Header`].
pub const HEADER_FIELDS: &[Field] = Header::FIELDS;

/// Every sample type of the project, in the order of their names.
pub fn all() -> &'static [&'static SampleKind] {
    &[
        Actuation::KIND,
        ClusterTable::KIND,
        ConsoleCommand::KIND,
        Contacts::KIND,
        Datagram::KIND,
        DepthImage::KIND,
        Diagnostics::KIND,
        Duties::KIND,
        FaceBoxes::KIND,
        FarEnd::KIND,
        Gate::KIND,
        GreyImage::KIND,
        Health::KIND,
        Hull::KIND,
        Journal::KIND,
        PlanRequest::KIND,
        PlanUpdate::KIND,
        Plane::KIND,
        PointCloud::KIND,
        PoolMessage::KIND,
        Pose::KIND,
        PoseReport::KIND,
        Rejection::KIND,
        RigState::KIND,
        Setting::KIND,
        SettingAnswer::KIND,
        SurfacePieces::KIND,
        Target::KIND,
        Track::KIND,
    ]
}

/// The sample type of this name.
pub fn by_name(name: &str) -> Option<&'static SampleKind> {
    all().iter().copied().find(|k| k.name == name)
}
