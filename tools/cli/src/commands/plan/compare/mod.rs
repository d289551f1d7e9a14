//! `stillpoint plan compare`: two plans of one case side by side.
//!
//! - `compared`: a plan.json that is compared
//! - `side_by_side`: the rows of both plans
//! - `page`: compare.html

mod compared;
mod page;
mod side_by_side;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::page::parts::{value, word};
use super::table;
use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};
use compared::Compared;
use side_by_side::SideBySide;

/// Names of both plans in tables.
const NAMES: [&str; 2] = ["A", "B"];

/// Show two plans of one case side by side, as text and as a page: angles, objective, figures of structures, limits,
/// histograms, monitor units. The figures are those of plan.json: of the dose of the segments where a plan has segments, of
/// the planned fluence otherwise.
#[derive(Args)]
pub struct Compare {
    /// The folder of the first plan, or its plan.json.
    a: PathBuf,
    /// The folder of the second plan, or its plan.json.
    b: PathBuf,
    /// The page to be written.
    #[arg(long, value_name = "FILE", default_value = "compare.html")]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Compare {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let plans = [Compared::read(&self.a)?, Compared::read(&self.b)?];
        let side_by_side = SideBySide::new(&plans)?;
        let page = page::page(&side_by_side)?;
        let fault = |e: &dyn std::fmt::Display| {
            Failure::failed(format!("{}: {e}; give another file with --out", self.out.display()))
        };
        stillpoint_map::publish(&self.out, |file| std::io::Write::write_all(file, page.as_bytes()))
            .map_err(|e| fault(&e))?;
        if self.json {
            let both = json!({
                "case": { "name": plans[0].case().name, "hash": plans[0].case().hash },
                "same_objectives": side_by_side.is_of_the_same_objectives(),
                "plans": side_by_side.to_json(),
                "files": [&self.out],
            });
            print_json(&both)?;
        } else {
            print(&side_by_side);
            outln!("\n{}", self.out.display());
        }
        Ok(Exit::Done)
    }
}

fn print(side_by_side: &SideBySide<'_>) {
    outln!("two plans of {}:\n", side_by_side.plans[0].case().name);
    let mut rows = Columns::new([(Side::Left, ""), (Side::Left, NAMES[0]), (Side::Left, NAMES[1])]);
    for (name, values) in side_by_side.rows() {
        rows.row(std::iter::once(name).chain(values));
    }
    out!("{rows}");
    for note in side_by_side.notes() {
        outln!("{note}");
    }
    outln!();
    let volumes = side_by_side.volumes_at_gy();
    // One column, because a wide table repeats its first column alone.
    let rows = side_by_side.structures().map(|(names, figures)| (vec![names.join(", ")], figures));
    out!("{}", table::of_structures(&["structure, plan"], rows, &volumes));
    table::explain();
    let [a, b] = side_by_side.limits();
    if a.is_empty() {
        return;
    }
    let head = ["structure", "limit"].map(|name| (Side::Left, name));
    let head = head.into_iter().chain(NAMES.map(|name| (Side::Right, name)));
    let mut limits = Columns::new(head.chain(["result of A", "of B", "source"].map(|n| (Side::Left, n))));
    for (a, b) in a.iter().zip(&b).map(|(a, b)| (a.as_ref(), b.as_ref())) {
        let Some(limit) = a.or(b) else { continue };
        let values = [value(a), value(b), word(a).to_owned(), word(b).to_owned()];
        let names = [limit.structure.clone(), limit.limit.clone()];
        limits.row(names.into_iter().chain(values).chain([limit.source.clone()]));
    }
    out!("\n{limits}");
}
