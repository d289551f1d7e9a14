//! `stillpoint dose check`

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use serde_json::{Value, json};
use stillpoint_plan::monte_carlo::{
    Comparison, JudgedPlace, MonteCarloError, Phantom, SETTINGS, SPECTRUM, Setting, compare,
};

use super::page;
use crate::columns::{Columns, Side};
use crate::commands::plan::machine_of;
use crate::exit::{Ended, Exit, Failure, print_json};

/// Compute the doses of a machine file on phantoms of water, lung, bone and air, and compare them with Monte Carlo.
///
/// Both dose engines are compared with the depth doses and profiles of a Monte Carlo program in sharp square fields of 1, 2
/// and 5 cm. The command prints the deviations at named places and draws the profiles. It exits with 1 if the superposition
/// misses a bound. A machine of another spectrum than that of the reference is expected to differ from it.
#[derive(Args)]
pub struct Check {
    /// Machine file; the default is the built-in generic 6 MV machine.
    machine: Option<PathBuf>,
    /// A phantom; several are several options. Default: all phantoms.
    #[arg(long = "phantom", value_name = "PHANTOM", value_parser = PossibleValuesParser::new(Phantom::ALL.map(Phantom::key)))]
    phantoms: Vec<String>,
    /// Output page with the table and the profiles.
    #[arg(long, value_name = "FILE", default_value = "dose-check.html")]
    page: PathBuf,
    /// Number of threads; no number depends on it. Default: all cores.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let machine = machine_of(self.machine.as_deref())?;
        let name =
            self.machine.as_ref().map_or("built-in 6 MV".to_owned(), |path| path.display().to_string());
        let threads = match self.threads {
            Some(threads) => threads,
            None => std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
        };
        let is_asked = |setting: &Setting| {
            self.phantoms.is_empty() || self.phantoms.iter().any(|key| key == setting.phantom.key())
        };
        let settings: Vec<Setting> = SETTINGS.into_iter().filter(is_asked).collect();
        let all = compare(&machine, &settings, threads).map_err(|fault| match fault {
            MonteCarloError::Damaged(_) => Failure::failed(fault),
            _ => Failure::wrong(fault),
        })?;
        let text = page::page(&name, &all)?;
        stillpoint_map::publish(&self.page, |file| file.write_all(text.as_bytes())).map_err(|e| {
            Failure::failed(format!("{}: {e}; choose another file with --page", self.page.display()))
        })?;
        if self.json {
            print_json(&reported(&name, &all))?;
        } else {
            print(&name, &all);
            outln!("{}", self.page.display());
        }
        Ok(if missed(&all) == 0 { Exit::Done } else { Exit::Failed })
    }
}

/// What the numbers mean.
pub fn about(machine: &str) -> String {
    format!(
        "machine {machine}; the reference has the spectrum {SPECTRUM}, and a machine of another spectrum is expected to differ"
    )
}

/// Bounds that the superposition misses.
pub fn missed(all: &[Comparison]) -> usize {
    places(all).filter(|(_, place)| place.is_met() == Some(false)).count()
}

/// Every place of every setting.
pub fn places(all: &[Comparison]) -> impl Iterator<Item = (&Comparison, &JudgedPlace)> {
    all.iter().flat_map(|one| one.places.iter().map(move |place| (one, place)))
}

/// A deviation in percent.
pub fn percent(part: f64) -> String {
    format!("{:+.1} %", 100.0 * part)
}

/// The result of a place.
pub fn word(place: &JudgedPlace) -> &'static str {
    match place.is_met() {
        Some(true) => "pass",
        Some(false) => "FAIL",
        None => "-",
    }
}

/// A bound in percent.
pub fn bound(place: &JudgedPlace) -> String {
    place.bound.map_or("-".to_owned(), |part| format!("{:.1} %", 100.0 * part))
}

fn print(machine: &str, all: &[Comparison]) {
    let left = ["phantom and field", "place"].map(|name| (Side::Left, name));
    let right = ["superposition", "bound", "pencil"].map(|name| (Side::Right, name));
    let mut table = Columns::new(left.into_iter().chain(right).chain([(Side::Left, "result")]));
    for (one, place) in places(all) {
        let (ours, pencil) = (percent(place.superposition), percent(place.pencil));
        let names = [one.setting.to_string(), place.name.to_owned()];
        table.row(names.into_iter().chain([ours, bound(place), pencil, word(place).to_owned()]));
    }
    outln!("{}\n", about(machine));
    out!("{table}");
    let judged = places(all).filter(|(_, place)| place.is_met().is_some()).count();
    outln!(
        "\n{} of {judged} bounds of the superposition are met; a place with - has none",
        judged - missed(all)
    );
}

fn reported(machine: &str, all: &[Comparison]) -> Value {
    let place = |(one, place): (&Comparison, &JudgedPlace)| {
        json!({
            "phantom": one.setting.phantom,
            "field_cm": one.setting.field_cm,
            "place": place.name,
            "superposition": place.superposition,
            "pencil": place.pencil,
            "bound": place.bound,
            "met": place.is_met(),
        })
    };
    json!({
        "machine": machine,
        "spectrum_of_reference": SPECTRUM,
        "missed": missed(all),
        "places": places(all).map(place).collect::<Vec<_>>(),
    })
}
