//! Where samples end.
//!
//! - `null`: `sink.null`, which counts

mod null;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<null::SinkNull>()];
