//! Tables that plan.html and compare.html share.

use stillpoint_plan::evaluation::StructureDose;
use stillpoint_plan::objectives::ObjectiveResult;
use stillpoint_plan::protocol::Judged;
use stillpoint_report::page::{Cell, Mood, Table};

/// Limits that stand beside each other; nothing where a plan was not compared with the limit.
pub type SideBySide = Vec<Option<Judged>>;

/// A row for each limit: values under the first headings, pass and fail under the others. All columns are as long.
pub fn limits(caption: String, values: &[(&str, SideBySide)], results: &[(&str, SideBySide)]) -> Table {
    let mut columns = vec!["structure", "limit"];
    columns.extend(values.iter().chain(results).map(|(name, _)| *name));
    columns.push("source");
    let mut table = Table::new(caption, &columns);
    let rows = values.first().map_or(0, |(_, column)| column.len());
    for row in 0..rows {
        let mut of_row = values.iter().chain(results).filter_map(|(_, column)| column[row].as_ref());
        let Some(limit) = of_row.next() else { continue };
        let mut cells = vec![Cell::text(&limit.structure), Cell::text(&limit.limit)];
        cells.extend(values.iter().map(|(_, column)| Cell::number(value(column[row].as_ref()))));
        cells.extend(results.iter().map(|(_, column)| result(column[row].as_ref())));
        cells.push(Cell::text(&limit.source));
        table.row(cells);
    }
    table
}

/// The objectives that bound one quantity, with its true value beside the cost; nothing where none does.
pub fn objectives(results: &[ObjectiveResult]) -> Option<Table> {
    let caption =
        "Objectives of the planned fluence: values of the whole structures, costs at the optimised points";
    let mut table = Table::new(caption.to_owned(), &["structure", "objective", "planned", "cost", "result"]);
    let bounding = || results.iter().filter_map(|r| Some((r, r.measured.as_ref()?)));
    for (result, measured) in bounding() {
        let (mood, word) = if measured.met() { (Mood::Good, "met") } else { (Mood::Bad, "not met") };
        table.row([
            Cell::text(&result.structure),
            Cell::text(measured.requested()),
            Cell::number(format!("{:.1} {}", measured.value, measured.unit)),
            Cell::number(format!("{:.4}", result.cost)),
            Cell::State(mood, word.to_owned()),
        ]);
    }
    bounding().next().map(|_| table)
}

/// The value of a limit, for people.
pub fn value(judged: Option<&Judged>) -> String {
    match judged.and_then(|j| j.value) {
        Some(value) if value < 10.0 => format!("{value:.2}"),
        Some(value) => format!("{value:.1}"),
        None => "-".to_owned(),
    }
}

/// Whether a plan keeps a limit, for people.
pub fn word(judged: Option<&Judged>) -> &'static str {
    match judged.map(|j| j.passed) {
        Some(Some(true)) => "pass",
        Some(Some(false)) => "FAIL",
        Some(None) => "not in the case",
        None => "-",
    }
}

fn result(judged: Option<&Judged>) -> Cell {
    let text = word(judged);
    match judged.and_then(|j| j.passed) {
        Some(passed) => Cell::State(if passed { Mood::Good } else { Mood::Bad }, text.to_owned()),
        None => Cell::text(text),
    }
}

/// Figures of structures; the cells in front of the figures stand under the first headings.
pub fn figures<'a>(
    caption: &str,
    first: &[&str],
    rows: impl Iterator<Item = (Vec<String>, &'a StructureDose)>,
) -> Table {
    let names = ["cm3", "D98, Gy", "D95", "D50", "D2", "D0.03cc", "mean", "V95%", "HI", "CI"];
    let mut table = Table::new(caption, &[first, &names].concat());
    for (first, f) in rows {
        let numbers = [f.volume_cm3, f.d98_gy, f.d95_gy, f.d50_gy, f.d2_gy, f.d003cc_gy, f.mean_gy];
        let optional = |value: Option<f64>, digits: usize| number(value, digits);
        let target = [
            optional(f.covered.map(|c| 100.0 * c), 1),
            optional(f.homogeneity, 2),
            optional(f.conformity, 2),
        ];
        let numbers = numbers.into_iter().map(|n| format!("{n:.1}")).chain(target).map(Cell::number);
        table.row(first.into_iter().map(Cell::text).chain(numbers));
    }
    table
}

/// Volumes that receive doses, in cm3 and percent.
pub fn volumes(figures: &[StructureDose]) -> Table {
    let doses = figures.first().map_or(&[][..], |f| &f.volumes);
    let names: Vec<String> = doses.iter().map(|v| format!("V{} Gy", v.dose_gy)).collect();
    let columns: Vec<&str> =
        ["structure", "cm3"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let mut table = Table::new("Volumes at doses, cm3 (percent of the structure)".to_owned(), &columns);
    for f in figures {
        let at = f
            .volumes
            .iter()
            .map(|v| Cell::number(format!("{:.1} ({:.1} %)", v.fraction * f.volume_cm3, 100.0 * v.fraction)));
        let first = [Cell::text(&f.name), Cell::number(format!("{:.1}", f.volume_cm3))];
        table.row(first.into_iter().chain(at));
    }
    table
}

/// A number with so many digits, or a dash.
pub fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}
