//! The figures of a plan, for people.

use stillpoint_plan::check::Checked;
use stillpoint_plan::dose::BeamAngles;
use stillpoint_plan::evaluation::{FallOff, StructureDose};
use stillpoint_plan::objectives::ObjectiveResult;
use stillpoint_plan::plan_file::{PlanFile, PlanFileCouch, PlanFileHigher};
use stillpoint_plan::protocol::{Judged, Served};

use super::leaves::Leaves;
use super::outcome::Outcome;
use super::page::parts::{number, value, word};
use super::page::setup::served_by;
use super::prepared::Prepared;
use super::request::Request;
use crate::columns::{Columns, Side};
use stillpoint_plan::recipe::PlanRun;

/// Prints what was found.
pub fn print(
    request: &Request,
    prepared: &Prepared,
    (runs, seconds): (&[PlanRun], &[f64]),
    outcome: &Outcome<'_>,
) {
    if runs.len() > 1 {
        outln!();
        searches(runs, seconds);
    }
    let best = &outcome.run.choice.best;
    outln!(
        "\n{}: beams {} by {}{}, objective {:.4} (at most {:.1e} above the optimum of these beams), {} solves, {} prices",
        request.setup.case.name(),
        angles(&outcome.angles),
        if request.has_weights { "weights that were given" } else { outcome.run.name.word() },
        with_leaves(outcome.run),
        best.solved_cost(),
        best.plan.certificate.excess / best.solved_cost(),
        outcome.run.solves(),
        outcome.run.prices
    );
    if let Some(text) = request.couch.as_ref().map(couch) {
        outln!("{text}");
    }
    if let Some(text) = outcome.worst_case(request) {
        outln!("{text}");
    }
    if let Some(searched_by) = request.searched_by {
        let found = runs.iter().map(|run| run.choice.best.solved_cost()).fold(f64::INFINITY, f64::min);
        outln!(
            "searched by the engine {searched_by} (objective {found:.4}); fluence and dose by {}",
            request.setup.engine_name()
        );
    }
    outln!();
    outln!(
        "dose ({}) recomputed on a grid of {:.2} mm:\n",
        request.setup.engine_name(),
        outcome.grid().spacing_mm[0]
    );
    if let Some(caution) = outcome.caution(request) {
        outln!("caution: {caution}\n");
    }
    structures(&outcome.figures, &prepared.volumes_at_gy);
    explain();
    if let Some(fall_off) = &outcome.fall_off {
        outln!("{}", describe(fall_off));
    }
    out!("{}", objectives(&outcome.objectives));
    if let Some(sequenced) = &outcome.leaves {
        leaves(request, prepared, sequenced);
        let file = sequenced.file(request, outcome.run);
        let seconds = file.seconds(&request.setup.spec.machine.arc_limits());
        outln!(
            "delivery: {:.1} min for monitor units, leaves and gantry; nothing for the beam to go on and off, nor for a couch",
            seconds / 60.0
        );
    }
    if let Some(protocol) = request.protocol() {
        // Of what is exported, as on the page.
        let (of, judged) = match &outcome.leaves {
            Some(leaves) => ("segments", &leaves.limits),
            None => ("planned fluence", &outcome.limits),
        };
        out!("{}", limits(&protocol.name, of, judged, &request.setup.served));
    }
    out!("{}", check(&outcome.checked, request.accept_check.as_deref()));
    if let Some(reference) = &outcome.reference {
        outln!("\nthe reference dose of the case, on the same grid:\n");
        structures(reference, &prepared.volumes_at_gy);
    }
    if !outcome.moved.is_empty() {
        outln!("\nranges over {} set-ups, including the planned one:\n", request.setups_mm.len());
        setups(outcome);
    }
}

/// The leaves that a search had under way, where there were several.
pub fn with_leaves(run: &PlanRun) -> String {
    match run.leaves.get() {
        1 => String::new(),
        leaves => format!(" with {leaves} leaves under way"),
    }
}

/// What the leaves give.
fn leaves(request: &Request, prepared: &Prepared, leaves: &Leaves<'_>) {
    let (segments, monitor_units) = leaves.totals();
    let [opaque, loss] = leaves.losses().map(|part| 100.0 * part);
    let transmission = request.collimator().map_or(0.0, |c| 100.0 * c.transmission);
    outln!(
        "\nsequenced for step and shoot: {segments} segments, {monitor_units:.0} monitor units a fraction; the objective \
         rises by {opaque:.1} %, with a transmission of {transmission} % by {loss:.1} %\n"
    );
    structures(&leaves.figures, &prepared.volumes_at_gy);
    if let Some(fall_off) = &leaves.fall_off {
        outln!("{}", describe(fall_off));
    }
}

/// What the check of the plan says.
pub fn check(checked: &Checked, accepted: Option<&str>) -> String {
    if checked.faults.is_empty() {
        return "\nplan check: passed\n".to_owned();
    }
    let mut text = "\nplan check: refused\n".to_owned();
    for fault in &checked.faults {
        text += &format!("  {fault}\n");
    }
    text + &match accepted {
        Some(reason) => format!("the plan is exported all the same: {reason}\n"),
        None => {
            "the plan is not exported; a person who has looked at it can export it with --accept-check REASON\n".to_owned()
        }
    }
}

/// What couch angles changed, for people.
pub fn couch(couch: &PlanFileCouch) -> String {
    let gain = 100.0 * (1.0 - couch.objective / couch.coplanar_objective);
    let mut text = format!(
        "couch angles: objective of the search {:.4}, {gain:.1} % below {:.4} of the best beams without them; doses of {} of {} \
         directions were needed",
        couch.objective, couch.coplanar_objective, couch.doses, couch.candidates
    );
    for higher in &couch.higher {
        let PlanFileHigher { structure, coplanar_gy, mean_gy } = higher;
        text += &format!(
            "\n  {structure} gets more by the doses of the search: mean {mean_gy:.1} Gy, {coplanar_gy:.1} Gy without couch angles"
        );
    }
    text
}

/// The beams of a plan for people: their angles, or its arcs.
pub fn beams(plan: &PlanFile) -> String {
    match &plan.arcs {
        Some(arcs) => arcs.arcs.iter().map(|arc| format!("arc {}", arc.arc)).collect::<Vec<_>>().join(", "),
        None => angles(&plan.angles()),
    }
}

/// Angles for people.
pub fn angles(angles: &[BeamAngles]) -> String {
    let angles: Vec<String> = angles.iter().map(|angle| format!("{angle}\u{b0}")).collect();
    angles.join(" ")
}

fn searches(runs: &[PlanRun], seconds: &[f64]) {
    let right = ["objective", "solves", "prices", "s"].map(|name| (Side::Right, name));
    let head = [(Side::Left, "method")].into_iter().chain(right).chain([(Side::Left, "beams")]);
    let mut table = Columns::new(head);
    for (run, seconds) in runs.iter().zip(seconds) {
        let beams = run.choice.best.beams.beams();
        table.row([
            run.label(),
            format!("{:.4}", run.choice.best.cost),
            run.solves().to_string(),
            run.prices.to_string(),
            format!("{seconds:.1}"),
            angles(&run.directions.all(beams)),
        ]);
    }
    out!("{table}");
}

fn structures(figures: &[StructureDose], volumes_at_gy: &[f64]) {
    let rows = figures.iter().map(|f| (vec![f.name.clone()], f));
    out!("{}", of_structures(&["structure"], rows, volumes_at_gy));
}

/// Figures of structures; the cells in front of the figures stand under the first headings.
pub fn of_structures<'a>(
    first: &[&str],
    rows: impl Iterator<Item = (Vec<String>, &'a StructureDose)>,
    volumes_at_gy: &[f64],
) -> Columns {
    let doses = ["cm3", "D98", "D95", "D50", "D10", "D2", "D0.03", "mean"].map(str::to_owned);
    let volumes = volumes_at_gy.iter().map(|dose| format!("V{dose}"));
    let right = doses.into_iter().chain(volumes).chain(["V95%", "HI", "CI"].map(str::to_owned));
    let head = first.iter().map(|name| (Side::Left, (*name).to_owned()));
    let mut table = Columns::new(head.chain(right.map(|name| (Side::Right, name))));
    for (first, f) in rows {
        let doses = [f.d98_gy, f.d95_gy, f.d50_gy, f.d10_gy, f.d2_gy, f.d003cc_gy, f.mean_gy];
        let percents = f.volumes.iter().map(|volume| 100.0 * volume.fraction);
        let numbers = [f.volume_cm3].into_iter().chain(doses).chain(percents);
        let target =
            [number(f.covered.map(|c| 100.0 * c), 1), number(f.homogeneity, 2), number(f.conformity, 2)];
        let cells = numbers.map(|number| format!("{number:.1}")).chain(target);
        table.row(first.into_iter().chain(cells));
    }
    table
}

/// What the headings mean.
pub const HEADINGS: &str = "D98 is the dose in Gy that 98 % of the structure receive at least, D0.03 that of 0.03 cm3; V60 is the percentage that receives 60 Gy;\n\
    V95% is the percentage of a target that receives 95 % of its prescription; HI is (D2 - D98) / D50;\n\
    CI is Paddick's conformity index of the 95 % isodose";

/// Says what the headings mean.
pub fn explain() {
    outln!("{HEADINGS}");
}

/// The objectives that bound one quantity, with its true value beside the cost.
pub fn objectives(results: &[ObjectiveResult]) -> String {
    let bounding = || results.iter().filter_map(|r| Some((r, r.measured.as_ref()?)));
    if bounding().next().is_none() {
        return String::new();
    }
    let left = ["structure", "objective"].map(|name| (Side::Left, name));
    let right = ["plan", "cost"].map(|name| (Side::Right, name));
    let mut table = Columns::new(left.into_iter().chain(right).chain([(Side::Left, "result")]));
    for (result, measured) in bounding() {
        table.row([
            result.structure.clone(),
            measured.requested(),
            format!("{:.1} {}", measured.value, measured.unit),
            format!("{:.4}", result.cost),
            if measured.met() { "met" } else { "NOT MET" }.to_owned(),
        ]);
    }
    format!(
        "\nobjectives with a limit: values of the whole structures, costs at the optimised points\n\n{table}"
    )
}

/// The limits of a protocol, with the values of the plan.
pub fn limits(protocol: &str, of: &str, limits: &[Judged], served: &[Served]) -> String {
    let head =
        [(Side::Left, "structure"), (Side::Left, "limit"), (Side::Right, "plan"), (Side::Left, "result")];
    let mut table = Columns::new(head.into_iter().chain([(Side::Left, "served by"), (Side::Left, "source")]));
    for j in limits.iter().filter(|j| j.passed.is_some()) {
        let (value, word) = (value(Some(j)), word(Some(j)).to_owned());
        let own = served.iter().find(|s| s.structure == j.structure && s.limit == j.limit);
        let by = own.map_or("-".to_owned(), served_by);
        table.row([j.structure.clone(), j.limit.clone(), value, word, by, j.source.clone()]);
    }
    let count = |requested: Option<bool>| limits.iter().filter(|j| j.passed == requested).count();
    let mut text = format!(
        "\nprotocol {protocol}, dose of the {of}: {} limits passed, {} failed\n\n{table}",
        count(Some(true)),
        count(Some(false))
    );
    let missing: Vec<&str> =
        limits.iter().filter(|j| j.passed.is_none()).map(|j| j.structure.as_str()).collect();
    if !missing.is_empty() {
        text += &format!("not in the case: {}\n", missing.join(", "));
    }
    text
}

/// The fall-off of the dose around the targets.
pub fn describe(fall_off: &FallOff) -> String {
    let gray = |dose: Option<f64>| dose.map_or("-".to_owned(), |gray| format!("{gray:.1} Gy"));
    format!(
        "R50 (volume of the 50 % isodose / volume of the targets) is {:.1}; D0.03 beyond 2 cm from the targets is {}, \
         within 1 cm of the skin {}",
        fall_off.r50,
        gray(fall_off.d2cm_gy),
        gray(fall_off.first_cm_gy)
    )
}

fn setups(outcome: &Outcome<'_>) {
    let Some(first) = outcome.moved.first() else { return };
    let right = ["D98", "D95", "D2", "mean"].map(|name| (Side::Right, name));
    let mut table = Columns::new([(Side::Left, "structure")].into_iter().chain(right));
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
        table.row([
            f.name.clone(),
            range(|f| f.d98_gy),
            range(|f| f.d95_gy),
            range(|f| f.d2_gy),
            range(|f| f.mean_gy),
        ]);
    }
    out!("{table}");
}
