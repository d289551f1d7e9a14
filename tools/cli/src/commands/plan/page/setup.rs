//! What the plan is made for and with: prescription, fractions, isocentre, machine, objectives, notes.

use stillpoint_plan::dose::EngineName;
use stillpoint_plan::fluence::Modulation;
use stillpoint_plan::protocol::Served;
use stillpoint_plan::recipe::RobustBy;
use stillpoint_report::page::{Block, Cell, Table};

use super::super::request::Request;

/// The blocks of the section for static beams.
pub fn blocks(request: &Request, notes: &[String]) -> Vec<Block> {
    let mut blocks = of_all(request, request.searched_by);
    if let Some(Modulation { neighbours, peaks, times_mean }) = request.setup.goals.modulation() {
        blocks.push(Block::Text(format!(
            "Modulation: a weight of {neighbours} on the mean square of differences between neighbouring bixels, of {peaks} \
             on that of what is above {times_mean} means of a beam."
        )));
    }
    blocks.extend(notes.iter().map(|note| Block::Warning(note.clone())));
    blocks
}

/// The blocks for arcs: they have no fluence whose modulation could cost, and their leaves are searched by pencil beams.
pub fn of_arcs(request: &Request, notes: &[String]) -> Vec<Block> {
    let is_other = request.setup.engine_name() != EngineName::Pencil;
    let mut blocks = of_all(request, is_other.then_some(EngineName::Pencil));
    blocks.extend(notes.iter().map(|note| Block::Warning(note.clone())));
    blocks
}

fn of_all(request: &Request, searched_by: Option<EngineName>) -> Vec<Block> {
    let mut blocks =
        vec![Block::Table(prescription(request, searched_by)), Block::Table(objectives(request))];
    if !request.setup.served.is_empty() {
        blocks.push(Block::Table(served(request)));
    }
    blocks
}

fn prescription(request: &Request, searched_by: Option<EngineName>) -> Table {
    let case = &request.setup.case;
    let mut table = Table::new("Setup".to_owned(), &["quantity", "value"]);
    let mut row = |name: &str, value: String| table.row([Cell::text(name), Cell::text(value)]);
    let fractions = case.fractions();
    for p in case.prescription() {
        let each =
            fractions.map_or(String::new(), |n| format!(", {:.2} Gy a fraction", p.dose_gy / f64::from(n)));
        row(&format!("prescription to {}", p.structure), format!("{:.2} Gy{each}", p.dose_gy));
    }
    row("fractions", fractions.map_or("not stated: one is exported".to_owned(), |n| n.to_string()));
    let [x, y, z] = case.isocentre_mm();
    row("isocentre, mm of the patient", format!("x {x:.1} (left), y {y:.1} (back), z {z:.1} (head)"));
    row("position of the patient", case.position().term().to_owned());
    let machine = request.setup.spec.machine.file();
    row(
        "machine",
        format!("{} MV, source to axis {} mm; {}", machine.energy_mv, machine.sad_mm, machine.provenance),
    );
    let engine = request.setup.engine_name();
    row("dose engine", format!("{engine}: {}", engine.about()));
    if let Some(searched_by) = searched_by {
        row("dose engine of the search", format!("{searched_by}: {}", searched_by.about()));
    }
    row(
        "leaves",
        match request.collimator() {
            Some(leaves) => format!(
                "{} pairs, transmission {} %, at least {} monitor units a segment, {}",
                leaves.pairs(),
                100.0 * leaves.transmission,
                leaves.least_mu,
                match leaves.jaws_over_axis_mm {
                    Some(_) => "jaws that follow each segment",
                    None => "jaws that stand still in a beam",
                }
            ),
            None => "none: the fluence is not sequenced".to_owned(),
        },
    );
    let edge = match request.setup.spec.inside_mm {
        mm if mm < 0.0 => format!("flash of {} mm", -mm),
        mm => format!("at least {mm} mm within the edge of the patient"),
    };
    row("bixels", format!("{} mm, {edge}", request.setup.spec.bixel_mm));
    let set_ups = match (request.setups_mm.len(), request.setup.spec.robust_by) {
        (1, _) => "the planned one".to_owned(),
        (count, RobustBy::Mean) => format!("{count}, by their mean"),
        (count, RobustBy::Worst) => format!("{count}, by the worst"),
    };
    row("set-ups", set_ups);
    row("case", format!("{}, hash {}", case.name(), request.setup.hash));
    row("comes from", case.provenance().to_owned());
    table
}

/// Objectives as they were solved.
fn objectives(request: &Request) -> Table {
    let mut table = Table::new(
        "Objectives, in the order in which voxels are taken".to_owned(),
        &["structure", "objective", "weight"],
    );
    for structure in &request.setup.objective_set.structures {
        for objective in &structure.objectives {
            let (aim, weight) = (objective.aim().to_string(), objective.weight());
            table.row([Cell::text(&structure.name), Cell::text(aim), Cell::number(format!("{weight}"))]);
        }
    }
    table
}

/// Which objective serves each limit.
fn served(request: &Request) -> Table {
    let caption = "Limits of the protocol, and the objectives that serve them".to_owned();
    let mut table = Table::new(caption, &["structure", "limit", "served by"]);
    for served in &request.setup.served {
        table.row([Cell::text(&served.structure), Cell::text(&served.limit), Cell::text(served_by(served))]);
    }
    table
}

/// The objective that serves a limit, for people.
pub fn served_by(served: &Served) -> String {
    let Some((name, objective)) = &served.by else { return "no objective".to_owned() };
    let derived = if served.is_derived { " (derived from the limit)" } else { "" };
    format!("{name}: {}{derived}", objective.aim())
}
