//! Tables of clusters.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::names::bits;
use crate::{Layout, Sample, SampleKind, Shape, YesNo};

/// What stood over a plane, one row per cluster, the largest first.
pub struct ClusterTable;

/// The values of the whole table.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout,
)]
#[repr(C)]
pub struct ClusterTableShape {
    /// Clusters found; more than were sent where the port's capacity was less.
    pub found: u32,
    /// Number of rows.
    pub length: u32,
}

bits! {
    /// Where a cluster ends without its own end: bits.
    ClusterEdge {
        /// It reaches the edge of the image.
        AT_IMAGE_EDGE = 1, "image edge";
        /// It reaches the greatest height, where points are cut off.
        AT_CEILING = 2, "ceiling";
        /// It reaches the edge of the hull, where points are cut off.
        AT_HULL_EDGE = 4, "hull edge";
        /// Only a part of it is the face.
        CUT = 8, "cut";
    }
}

/// One cluster.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Cluster {
    /// Mean of its voxels in the port's frame.
    #[unit("m")]
    pub centroid: [f64; 3],
    /// Standard deviations of its voxels along its principal axes, falling.
    #[unit("m")]
    pub spread: [f64; 3],
    /// Height of its lowest voxel over the plane.
    #[unit("m")]
    pub height_min: f64,
    /// Height of its highest voxel over the plane.
    #[unit("m")]
    pub height_max: f64,
    /// Its voxels.
    pub voxels: u32,
    /// Where it ends without its own end: bits of [`ClusterEdge`].
    #[bits(ClusterEdge)]
    pub touches: u32,
    /// Voxels of it that are the face's.
    pub face_voxels: u32,
    /// 1 for the cluster that holds most of the face, else 0.
    #[codes(YesNo)]
    pub chosen: u32,
}

impl Sample for ClusterTable {
    type Body = ClusterTableShape;
    type Element = Cluster;
    const NAME: &'static str = "ClusterTable";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "What stood over a plane, one row per cluster, the largest first.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
