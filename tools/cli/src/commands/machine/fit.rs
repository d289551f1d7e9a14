//! `stillpoint machine fit`

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};
use stillpoint_plan::measured::{Bounds, Fitted, Measured, OutputResidual, Residual, fit, read};

use super::page;
use crate::columns::{Columns, Side};
use crate::commands::plan::machine_of;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::quantity::{quantity, within};

/// Fit spectrum, penumbra, fluence and output calibration to depth doses, profiles and output factors.
///
/// The files are CSV tables, W2CAD or PTW (mcc) scans of a water tank. The spectrum follows from depth doses, penumbra and
/// fluence of the open field from profiles, monitor units from calibrations. The command prints how far the machine is from
/// each curve and draws them. It writes no machine file and exits with 1 if a curve or an output factor is beyond the bounds.
#[derive(Args)]
pub struct Fit {
    /// Files with measured doses of one energy.
    #[arg(required = true, value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Output machine file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Machine file to start from, with kernels of about this energy. Default: the built-in generic 6 MV machine.
    #[arg(long, value_name = "FILE")]
    start: Option<PathBuf>,
    /// Nominal energy, such as 6MV. Required if no file states it.
    #[arg(long, value_name = "ENERGY")]
    energy: Option<String>,
    /// Depth from which depth doses are fitted, such as 30mm. Default: 1.5 times the depth of the maximum of each.
    #[arg(long, value_name = "LENGTH")]
    from: Option<String>,
    /// Largest difference of a depth dose, in percent of its maximum.
    #[arg(long, value_name = "PERCENT", default_value = "2")]
    depth_dose_bound: f64,
    /// Largest difference of a depth dose, in percent of the dose at the same depth.
    #[arg(long, value_name = "PERCENT", default_value = "3")]
    local_bound: f64,
    /// Largest difference of a profile inside of the field, in percent of its maximum.
    #[arg(long, value_name = "PERCENT", default_value = "3")]
    inside_bound: f64,
    /// Largest difference of a profile outside of the field, in percent of its maximum.
    #[arg(long, value_name = "PERCENT", default_value = "4")]
    outside_bound: f64,
    /// Largest distance in steep places.
    #[arg(long, value_name = "LENGTH", default_value = "2mm")]
    distance_bound: String,
    /// Largest difference of an output factor, in percent of it, in fields of 40 mm and more.
    #[arg(long, value_name = "PERCENT", default_value = "3")]
    output_bound: f64,
    /// Output page with the residuals and the curves.
    #[arg(long, value_name = "FILE", default_value = "machine-fit.html")]
    page: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Fit {
    fn bounds(&self) -> Result<Bounds, Failure> {
        let part = |option: &str, percent: f64| match (0.0..=20.0).contains(&percent) {
            true => Ok(percent / 100.0),
            false => {
                Err(Failure::wrong(format!("invalid bound: {option} {percent} (allowed: 0 to 20 percent)")))
            }
        };
        let length = |option: &str, text: &str, most: f64| {
            let mm = quantity(text, "mm", &format!("{option} {text}"))?;
            match (0.0..=most).contains(&mm) {
                true => Ok(mm),
                false => Err(Failure::wrong(format!(
                    "invalid length: {option} {text} (allowed: 0 mm to {most} mm)"
                ))),
            }
        };
        Ok(Bounds {
            depth_dose: part("--depth-dose-bound", self.depth_dose_bound)?,
            local: part("--local-bound", self.local_bound)?,
            inside: part("--inside-bound", self.inside_bound)?,
            outside: part("--outside-bound", self.outside_bound)?,
            distance_mm: length("--distance-bound", &self.distance_bound, 10.0)?,
            output: part("--output-bound", self.output_bound)?,
            from_mm: self.from.as_deref().map(|text| length("--from", text, 200.0)).transpose()?,
        })
    }

    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let start = machine_of(self.start.as_deref())?;
        let mut measured = Measured::default();
        if let Some(text) = &self.energy {
            let energy_mv = within("energy", text, "MV", [1.0, 50.0])?;
            measured.state_energy(energy_mv, "--energy").map_err(Failure::wrong)?;
        }
        for path in &self.data {
            let bytes =
                std::fs::read(path).map_err(|e| Failure::wrong(format!("{}: {e}", path.display())))?;
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            measured.add(read(&name, &bytes).map_err(Failure::wrong)?).map_err(Failure::wrong)?;
        }
        let bounds = self.bounds()?;
        let fitted = fit(&start, &measured, bounds).map_err(Failure::wrong)?;
        write(&self.page, &page::page(&fitted)?, "--page")?;
        let missed: Vec<&Residual> = fitted.missed().collect();
        let missed_output = fitted.missed_outputs().next();
        if missed.is_empty() && missed_output.is_none() {
            let text = fitted.machine.file().to_json().map_err(Failure::failed)?;
            write(&self.out, &text, "--out")?;
        }
        if self.json {
            print_json(&reported(&fitted))?;
        } else {
            print(&fitted);
            outln!("{}", self.page.display());
        }
        if let Some(worst) = missed.first() {
            return Err(Failure::failed(format!(
                "no machine file is written: {} of {} curves are beyond the bounds, first {} ({}, line {}) at {:.1} mm; check \
                 this curve in {}, or give wider bounds (such as --depth-dose-bound)",
                missed.len(),
                fitted.residuals.len(),
                worst.name,
                worst.file,
                worst.line,
                worst.beyond_mm.unwrap_or(0.0),
                self.page.display(),
            )));
        }
        if let Some(output) = missed_output {
            let OutputResidual { reading, computed, difference, .. } = output;
            let [x, y] = reading.setup.field_mm;
            return Err(Failure::failed(format!(
                "no machine file is written: the output factor of {x} x {y} mm ({}, line {}) is {:.4}, and {computed:.4} computed \
                 without scatter of the head: {} (allowed: {} %); check its setup and the reading of the 100 mm field, or give \
                 a wider --output-bound",
                reading.file,
                reading.line,
                reading.value,
                percent(*difference),
                self.output_bound,
            )));
        }
        if !self.json {
            outln!("{}", self.out.display());
        }
        Ok(Exit::Done)
    }
}

fn write(path: &Path, text: &str, option: &str) -> Result<(), Failure> {
    stillpoint_map::publish(path, |file| file.write_all(text.as_bytes()))
        .map_err(|e| Failure::failed(format!("{}: {e}; choose another file with {option}", path.display())))
}

/// A part in percent.
pub fn percent(part: f64) -> String {
    format!("{:+.2} %", 100.0 * part)
}

/// A difference with its place.
pub fn placed((part, at_mm): (f64, f64)) -> String {
    format!("{} at {at_mm:.0} mm", percent(part))
}

/// The result of a curve.
pub fn word(residual: &Residual) -> &'static str {
    if residual.beyond_mm.is_none() { "pass" } else { "FAIL" }
}

/// The cells of a curve: name, rms, largest, largest of the dose there, distance, build-up.
pub fn cells(residual: &Residual) -> [String; 6] {
    let or_none = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    [
        residual.name.clone(),
        format!("{:.2} %", 100.0 * residual.rms),
        placed(residual.largest),
        or_none(residual.largest_local.map(placed)),
        or_none(residual.largest_mm.map(|(mm, at)| format!("{mm:.2} mm at {at:.0} mm"))),
        or_none(residual.build_up.map(placed)),
    ]
}

/// Headings of these cells.
pub const HEADINGS: [&str; 6] = [
    "curve",
    "rms",
    "largest",
    "largest, of the dose there",
    "largest, steep places",
    "build-up, not fitted",
];

/// What was fitted, a sentence each.
pub fn summary(fitted: &Fitted) -> Vec<String> {
    let file = fitted.machine.file();
    let [before, after] = fitted.mean_energy_mev;
    let mut lines = vec![format!("mean energy of the photons: {after:.3} MeV (start: {before:.3} MeV)")];
    lines.push(match fitted.has_penumbra {
        true => format!("penumbra: {:.2} mm", file.penumbra_fwhm_at_iso_mm),
        false => {
            format!("penumbra: {:.2} mm, of the start: there is no profile", file.penumbra_fwhm_at_iso_mm)
        }
    });
    lines.push(match fitted.has_fluence {
        true => "fluence of the open field: fitted".to_owned(),
        false => {
            "fluence of the open field: of the start, as no profile has a field of 90 mm or more".to_owned()
        }
    });
    lines.push(
        "pencil kernels: of the start, so `plan` takes superposition for the dose of plans with this machine"
            .to_owned(),
    );
    lines.push(match fitted.calibration {
        Some(calibration) => format!(
            "calibration: {:.2} monitor units for a weight of 1, which gives 1 Gy at the isocentre, 100 mm deep, in an even field \
             of 100 mm (readings: {}, at most {:.2} % from their mean)",
            calibration.mu_per_weight,
            calibration.readings,
            100.0 * calibration.largest
        ),
        None => "calibration: of the start, as there is no reading; monitor units are not those of this machine".to_owned(),
    });
    lines
}

fn print(fitted: &Fitted) {
    let headings =
        HEADINGS.iter().enumerate().map(|(i, name)| (if i == 0 { Side::Left } else { Side::Right }, *name));
    let mut table = Columns::new(headings.chain([(Side::Left, "result")]));
    for residual in &fitted.residuals {
        table.row(cells(residual).into_iter().chain([word(residual).to_owned()]));
    }
    out!("{table}");
    outln!("");
    for line in summary(fitted) {
        outln!("{line}");
    }
    for output in &fitted.outputs {
        let [x, y] = output.reading.setup.field_mm;
        outln!(
            "output factor {x} x {y} mm, {} mm deep: measured {:.4}, computed {:.4} without scatter of the head ({}){}",
            output.reading.depth_mm,
            output.reading.value,
            output.computed,
            percent(output.difference),
            if output.is_beyond { ": FAIL" } else { "" }
        );
    }
}

fn reported(fitted: &Fitted) -> Value {
    let file = fitted.machine.file();
    json!({
        "curves": fitted.residuals,
        "outputs": fitted.outputs,
        "calibration": fitted.calibration,
        "mean_energy_mev": fitted.mean_energy_mev,
        "penumbra_fwhm_at_iso_mm": file.penumbra_fwhm_at_iso_mm,
        "primary_fluence_r_mm_value": file.primary_fluence_r_mm_value,
        "missed": fitted.missed().count(),
        "missed_outputs": fitted.missed_outputs().count(),
    })
}
