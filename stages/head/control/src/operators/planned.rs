//! What a config says of targets, checked before the run.

use stillpoint_operator::SetupError;

use crate::channels::{ALL, Channel, Channels};
use crate::goal::PlannedMove;
use crate::operators::target::{MoveParams, ReachParams};
use crate::rig::Rig;

/// Least and greatest distance from the start of each channel that is held.
pub fn reach(params: &ReachParams, channels: &Channels) -> Result<[[f64; 2]; 6], SetupError> {
    let all = [params.x, params.y, params.z, params.pitch, params.roll, params.yaw];
    let mut reach = [[f64::NEG_INFINITY, f64::INFINITY]; 6];
    for (to, channel) in reach.iter_mut().zip(channels.iter()) {
        let name = channel.name();
        let Some([low, high]) = all[channel.place()] else {
            return Err(SetupError(format!(
                "`reach` lacks {name}, which is held: add `{name}: [-5 {0}, 5 {0}]`",
                if channel.unit() == "m" { "mm" } else { "deg" }
            )));
        };
        if !(low <= 0.0 && high >= 0.0) {
            return Err(SetupError(format!(
                "`reach.{name}` is from {low} to {high} {}: it must contain the start, 0",
                channel.unit()
            )));
        }
        *to = [low, high];
    }
    Ok(reach)
}

/// The moves, in the order of the channels that are held.
pub fn planned(params: &[MoveParams], channels: &Channels) -> Result<Vec<PlannedMove>, SetupError> {
    let mut moves: Vec<PlannedMove> = Vec::with_capacity(params.len());
    for (place, given) in params.iter().enumerate() {
        let all = [given.x, given.y, given.z, given.pitch, given.roll, given.yaw];
        let mut to = [None; 6];
        for (to, channel) in to.iter_mut().zip(channels.iter()) {
            *to = all[channel.place()];
        }
        let named = |c: &Channel| all[c.place()].is_some() && !channels.iter().any(|held| held == *c);
        if let Some(stray) = ALL.iter().find(|c| named(c)) {
            let name = stray.name();
            return Err(SetupError(format!(
                "`moves[{place}]` moves {name}, which is not held: add {name} to `channels`, or remove it"
            )));
        }
        if to.iter().all(Option::is_none) {
            return Err(SetupError(format!(
                "`moves[{place}]` moves nothing: name a channel, such as `z: 5 mm`"
            )));
        }
        if let Some(before) = moves.last().filter(|before| before.at > given.at) {
            return Err(SetupError(format!(
                "`moves[{place}]` begins at {} s, before the move above it at {} s: put moves in the order of their times",
                given.at as f64 * 1e-9,
                before.at as f64 * 1e-9
            )));
        }
        moves.push(PlannedMove { at: given.at, over: given.over, profile: given.profile, to });
    }
    Ok(moves)
}

/// Refuses moves beyond the reach.
pub fn refuse_unreachable(
    moves: &[PlannedMove],
    reach: &[[f64; 2]; 6],
    channels: &Channels,
) -> Result<(), SetupError> {
    for (place, planned) in moves.iter().enumerate() {
        for ((to, [low, high]), channel) in planned.to.iter().zip(reach).zip(channels.iter()) {
            if let Some(to) = to.filter(|to| !(*low..=*high).contains(to)) {
                let (name, unit) = (channel.name(), channel.unit());
                return Err(SetupError(format!(
                    "`moves[{place}].{name}` is {to} {unit}, and the bladders reach from {low} to {high} {unit}: move less, or widen `reach.{name}` if the rig can"
                )));
            }
        }
    }
    Ok(())
}

/// Refuses channels that the rig's bladders do not move.
pub fn refuse_unmoved(rig: &Rig, channels: &Channels) -> Result<(), SetupError> {
    let moved = || ALL.iter().filter(|c| rig.moves(**c)).map(|c| c.name()).collect::<Vec<_>>().join(", ");
    match channels.iter().find(|channel| !rig.moves(*channel)) {
        None => Ok(()),
        Some(stuck) => Err(SetupError(format!(
            "`channels` has {}, and the bladders of `rig` move {}: remove it, or name another rig",
            stuck.name(),
            moved()
        ))),
    }
}

/// Refuses moves that the rig's bladders cannot hold.
pub fn refuse_unheld(moves: &[PlannedMove], rig: &Rig, channels: &Channels) -> Result<(), SetupError> {
    let mut from = [0.0; 6];
    for (place, planned) in moves.iter().enumerate() {
        let to = std::array::from_fn(|i| planned.to[i].unwrap_or(from[i]));
        rig.check(&channels.spread(&from), &channels.spread(&to))
            .map_err(|e| SetupError(format!("`moves[{place}]` cannot be held: {e}: move less")))?;
        from = to;
    }
    Ok(())
}
