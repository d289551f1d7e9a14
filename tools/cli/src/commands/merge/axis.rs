//! The time of each session against that of the first.

use stillpoint_operator::outside::ClockOffset;

use super::part::MergedPart;
use super::wrong;
use crate::exit::Failure;

/// Time of each session minus time of the first one.
///
/// Each pair of hosts has the measurement of the least uncertainty. Where another measurement of the pair contradicts
/// it, as a clock that was set during the run does, the uncertainty grows until it holds that one, too. A host that
/// exchanged no sample with the first one is placed through others.
pub fn clocks(parts: &[MergedPart]) -> Result<Vec<ClockOffset>, Failure> {
    one_run(parts)?;
    let mut clocks: Vec<Option<ClockOffset>> = vec![None; parts.len()];
    clocks[0] = Some(ClockOffset { offset: 0, uncertainty: 0 });
    // A way has at most as many steps as there are sessions.
    for _ in 1..parts.len() {
        for (from, to) in pairs(parts.len()) {
            let (Some(known), Some(pair)) = (clocks[from], between(&parts[from], &parts[to])) else {
                continue;
            };
            let uncertainty = known.uncertainty.saturating_add(pair.uncertainty);
            if clocks[to].is_none_or(|clock| uncertainty < clock.uncertainty) {
                let offset = known.offset.saturating_add(pair.offset);
                clocks[to] = Some(ClockOffset { offset, uncertainty });
            }
        }
    }
    let placed = clocks.into_iter().zip(parts).map(|(clock, part)| {
        clock.ok_or_else(|| {
            wrong(format!(
                "{}: no session holds the offset of the clock of `{}` against that of `{}`: no sample passed between \
                 them while they were recorded",
                part.path.display(),
                part.host,
                parts[0].host
            ))
        })
    });
    let placed: Vec<ClockOffset> = placed.collect::<Result<_, _>>()?;
    at_one_time(parts, &placed)?;
    Ok(placed)
}

/// Sessions of one run overlap; those of two runs of a pipeline have the same hosts and settings, too.
fn at_one_time(parts: &[MergedPart], clocks: &[ClockOffset]) -> Result<(), Failure> {
    let span = |number: usize| {
        let (span, clock) = (parts[number].span?, clocks[number]);
        let [first, last] = span.map(|at| i128::from(at) - i128::from(clock.offset));
        Some([first - i128::from(clock.uncertainty), last + i128::from(clock.uncertainty)])
    };
    for number in 0..parts.len() {
        let Some([first, last]) = span(number) else { continue };
        let others = || (0..parts.len()).filter(|other| *other != number).filter_map(span);
        // From the nearest other one, ns.
        let apart = others().map(|[begins, ends]| (begins - last).max(first - ends)).min();
        if let Some(apart) = apart.filter(|apart| *apart > 0) {
            return Err(wrong(format!(
                "{} is {:.3} s apart from the other sessions: it is of another run; give the sessions of one run",
                parts[number].path.display(),
                apart as f64 * 1e-9
            )));
        }
    }
    Ok(())
}

fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..count).flat_map(move |from| (0..count).filter(move |to| *to != from).map(move |to| (from, to)))
}

/// The sessions are those of different hosts that ran the same pipeline.
fn one_run(parts: &[MergedPart]) -> Result<(), Failure> {
    for (number, part) in parts.iter().enumerate() {
        let first = &parts[0];
        if part.pipeline != first.pipeline || part.sets != first.sets {
            return Err(wrong(format!(
                "{} and {} are sessions of different pipelines or settings: give those of one run",
                first.path.display(),
                part.path.display()
            )));
        }
        if let Some(other) = parts[..number].iter().find(|other| other.host == part.host) {
            return Err(wrong(format!(
                "{} and {} are both sessions of the host `{}`: give one session for each host",
                other.path.display(),
                part.path.display(),
                part.host
            )));
        }
    }
    Ok(())
}

/// Time of the second session minus time of the first, as both measured it.
fn between(one: &MergedPart, other: &MergedPart) -> Option<ClockOffset> {
    let of = |part: &MergedPart, host: &str, sign: i64| -> Vec<ClockOffset> {
        let found = part.measured.iter().filter(|(of, _)| of == host);
        found.map(|(_, clock)| ClockOffset { offset: clock.offset.saturating_mul(sign), ..*clock }).collect()
    };
    joint(&[of(one, &other.host, 1), of(other, &one.host, -1)].concat())
}

/// The measurement of the least uncertainty, widened by those that contradict it.
fn joint(measured: &[ClockOffset]) -> Option<ClockOffset> {
    let best = measured.iter().min_by_key(|clock| clock.uncertainty)?;
    let far = |clock: &ClockOffset| i64::try_from(clock.offset.abs_diff(best.offset)).unwrap_or(i64::MAX);
    let contradicts = |clock: &&ClockOffset| far(clock) > clock.uncertainty.saturating_add(best.uncertainty);
    let widest =
        measured.iter().filter(contradicts).map(|clock| far(clock).saturating_add(clock.uncertainty));
    Some(ClockOffset { uncertainty: widest.max().unwrap_or(0).max(best.uncertainty), ..*best })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(offset: i64, uncertainty: i64) -> ClockOffset {
        ClockOffset { offset, uncertainty }
    }

    #[test]
    fn the_surest_measurement_counts_and_one_that_contradicts_it_makes_it_less_sure() {
        assert_eq!(joint(&[]), None);
        assert_eq!(joint(&[clock(3_000, 400), clock(3_100, 50)]), Some(clock(3_100, 50)));
        // The clock was set by 5 us during the run.
        assert_eq!(joint(&[clock(3_100, 50), clock(8_100, 60)]), Some(clock(3_100, 5_060)));
        assert_eq!(joint(&[clock(i64::MIN, 1), clock(i64::MAX, 0)]), Some(clock(i64::MAX, i64::MAX)));
    }
}
