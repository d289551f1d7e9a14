//! Whether the estimate that a controller takes has the channels that it holds.

use stillpoint_operator::{Feeder, FeederConflict};

use crate::channels::Channel;

/// Refuses channels that the estimate behind an input never has: the controller would be idle to the end.
///
/// # Errors
/// The parameter `follow` of the filter or of the fusion leaves one of `channels` out.
pub fn check(channels: &[Channel], from: &Feeder<'_>) -> Result<(), FeederConflict> {
    let Some(follow) = from.text(&["follow"]).filter(|_| from.kind.starts_with("estimate.")) else {
        return Ok(());
    };
    let followed: &[&str] = match follow {
        "x" => &["x"],
        "y" => &["y"],
        "z" => &["z"],
        "position" => &["x", "y", "z"],
        _ => return Ok(()),
    };
    let lacking: Vec<&str> =
        channels.iter().map(|c| c.name()).filter(|name| !followed.contains(name)).collect();
    if lacking.is_empty() {
        return Ok(());
    }
    Err(FeederConflict {
        reason: format!(
            "{} follows {follow}, so its estimate lacks {}, which is to be held: the controller would be idle to the end",
            from.operator,
            lacking.join(", ")
        ),
        help: format!("write `follow: pose` for {}, or hold fewer channels", from.operator),
    })
}
