//! The figures of a plan, for people.

use stillpoint_plan::evaluation::StructureDose;

use super::ground::Ground;
use super::outcome::Outcome;
use super::request::Request;
use super::search::Run;

/// Prints what was found.
pub fn print(request: &Request, ground: &Ground<'_>, runs: &[Run], outcome: &Outcome<'_>) {
    if runs.len() > 1 {
        outln!();
        searches(request, runs);
    }
    let best = &outcome.run.choice.best;
    outln!(
        "\n{}: {} by {}, objective {:.4} (at most {:.1e} above the optimum of these beams), {} solves, {} prices",
        request.case.name(),
        angles(&outcome.angles_deg),
        outcome.run.way.word(),
        best.cost,
        best.plan.certificate.excess / best.cost,
        outcome.run.history.len(),
        outcome.run.prices
    );
    outln!();
    structures(&outcome.figures, &ground.volumes_at_gy);
    if let Some(reference) = &outcome.reference {
        outln!("\nthe dose that came with the case, on the same grid:\n");
        structures(reference, &ground.volumes_at_gy);
    }
    if !outcome.moved.is_empty() {
        outln!("\nover {} set-ups, the planned one with them:\n", request.setups_mm.len());
        setups(outcome);
    }
}

/// Angles for people.
pub fn angles(angles_deg: &[f64]) -> String {
    let angles: Vec<String> = angles_deg.iter().map(|angle| format!("{angle}\u{b0}")).collect();
    angles.join(" ")
}

fn searches(request: &Request, runs: &[Run]) {
    outln!("{:<12} {:>12} {:>7} {:>7} {:>8}  beams", "method", "objective", "solves", "prices", "s");
    for run in runs {
        let beams = run.choice.best.beams.beams();
        outln!(
            "{:<12} {:>12.4} {:>7} {:>7} {:>8.1}  {}",
            run.way.word(),
            run.choice.best.cost,
            run.history.len(),
            run.prices,
            run.seconds,
            angles(&beams.iter().map(|beam| request.ring.angle_deg(*beam)).collect::<Vec<_>>())
        );
    }
}

fn structures(figures: &[StructureDose], volumes_at_gy: &[f64]) {
    let name = widest(figures.iter());
    out!(
        "{:<name$} {:>9} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6}",
        "structure",
        "cm3",
        "D98",
        "D95",
        "D50",
        "D10",
        "D2",
        "max",
        "mean"
    );
    for dose in volumes_at_gy {
        out!(" {:>6}", format!("V{dose}"));
    }
    outln!(" {:>6} {:>5} {:>5}", "V95%", "HI", "CI");
    for f in figures {
        out!("{:<name$} {:>9.1}", f.name, f.volume_cm3);
        for dose in [f.d98_gy, f.d95_gy, f.d50_gy, f.d10_gy, f.d2_gy, f.max_gy, f.mean_gy] {
            out!(" {dose:>6.1}");
        }
        for volume in &f.volumes {
            out!(" {:>6.1}", 100.0 * volume.fraction);
        }
        let or_dash =
            |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        outln!(
            " {:>6} {:>5} {:>5}",
            or_dash(f.covered.map(|c| 100.0 * c), 1),
            or_dash(f.homogeneity, 2),
            or_dash(f.conformity, 2)
        );
    }
    outln!(
        "D: doses in Gy that so many percent get at least; V: percent that gets so many Gy; V95%: percent of a target that gets \
         95 % of its prescription;\nHI: (D2 - D98) / D50; CI: Paddick's conformity of the 95 % isodose"
    );
}

fn setups(outcome: &Outcome<'_>) {
    let Some(first) = outcome.moved.first() else { return };
    let name = widest(first.iter());
    outln!("{:<name$} {:>13} {:>13} {:>13} {:>13}", "structure", "D98", "D95", "D2", "mean");
    for f in first {
        let all = || {
            let planned = outcome.figures.iter().filter(|g| g.name == f.name);
            planned.chain(outcome.moved.iter().flatten().filter(|g| g.name == f.name))
        };
        let range = |of: fn(&StructureDose) -> f64| {
            let values = || all().map(of);
            let (low, high) =
                (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
            format!("{low:.1} to {high:.1}")
        };
        outln!(
            "{:<name$} {:>13} {:>13} {:>13} {:>13}",
            f.name,
            range(|f| f.d98_gy),
            range(|f| f.d95_gy),
            range(|f| f.d2_gy),
            range(|f| f.mean_gy)
        );
    }
}

fn widest<'a>(figures: impl Iterator<Item = &'a StructureDose>) -> usize {
    figures.map(|f| f.name.chars().count()).fold(9, usize::max)
}
