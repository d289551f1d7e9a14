//! `stillpoint bladder`

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use stillpoint_mechanics::shell::Shell;
use stillpoint_pipeline::config::quantity::si;
use stillpoint_report::chart::{Chart, Series, Style};

use crate::exit::{Ended, Exit, Failure, print_json};

/// Pa of a pound per square inch.
const PSI: f64 = 6_894.757_293_168_361;
/// Number of parts of a curve.
const PARTS: u32 = 240;

/// Print the pressure of a spherical bladder against its stretch, in the corrected closed form of (2.40): the bladder of
/// the rigs, those of Figs 2.4 to 2.7 of the dissertation, or one of your own. With `--out`, write a picture of each, and
/// the numbers.
#[derive(Args)]
pub struct Bladder {
    /// Inner radius at rest of a bladder of your own, such as `50 mm`.
    #[arg(long, requires_all = ["outer", "c1", "c2"])]
    inner: Option<String>,
    /// Outer radius at rest.
    #[arg(long, requires = "inner")]
    outer: Option<String>,
    /// Modulus C1 of the wall, such as `180 kPa`; with C2 it is the shear modulus.
    #[arg(long, requires = "inner")]
    c1: Option<String>,
    /// Modulus C2 of the wall.
    #[arg(long, requires = "inner")]
    c2: Option<String>,
    /// Inner radius after the deformation. The default is 1.2 times the inner radius at rest.
    #[arg(long, requires = "inner")]
    to: Option<String>,
    /// Folder for one SVG picture of each bladder and `bladders.json`.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print JSON, with every point of the curves.
    #[arg(long)]
    json: bool,
}

/// A bladder, and the inner radius that it is deformed to.
struct Setup {
    name: String,
    shell: Shell,
    moduli: [f64; 2],
    /// m.
    deformed: f64,
    /// Pressure that the dissertation prints, psi.
    printed: Option<f64>,
}

/// A stretch at which the pressure is stationary.
#[derive(Serialize)]
struct LimitPoint {
    stretch: f64,
    pressure_pa: f64,
}

#[derive(Serialize)]
struct Row {
    name: String,
    c1_pa: f64,
    c2_pa: f64,
    /// Inner and outer radius at rest and after the deformation, m.
    radii_at_rest_m: [f64; 2],
    radii_m: [f64; 2],
    stretch: f64,
    pressure_pa: f64,
    pressure_psi: f64,
    /// Pressure that the dissertation prints for this set-up.
    printed_psi: Option<f64>,
    /// External pressure at which a thin shell of this kind may buckle, with a negative sign.
    buckling_pa: f64,
    /// Whether the shell stays round at this pressure.
    is_modelled: bool,
    limit_points: Vec<LimitPoint>,
    /// Inner stretch and pressure, Pa.
    curve: Vec<(f64, f64)>,
}

impl Bladder {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let setups = match self.own()? {
            Some(own) => vec![own],
            None => known()?,
        };
        let rows: Vec<Row> = setups.into_iter().map(row).collect();
        if let Some(folder) = &self.out {
            write(folder, &rows)?;
        }
        if self.json {
            print_json(&rows)?;
        } else {
            print(&rows);
        }
        Ok(Exit::Done)
    }

    fn own(&self) -> Result<Option<Setup>, Failure> {
        let (Some(inner), Some(outer), Some(c1), Some(c2)) = (&self.inner, &self.outer, &self.c1, &self.c2)
        else {
            return Ok(None);
        };
        let (inner, outer) = (number("--inner", inner, "m")?, number("--outer", outer, "m")?);
        let moduli = [number("--c1", c1, "Pa")?, number("--c2", c2, "Pa")?];
        let deformed = match &self.to {
            Some(to) => number("--to", to, "m")?,
            None => 1.2 * inner,
        };
        let setup = setup("a bladder of your own", moduli, [inner, deformed, outer], None)?;
        // A hollow that shrinks takes the outer surface with it.
        let most = GREATEST * inner;
        if !(deformed > 0.01 * inner && deformed < most) {
            return Err(Failure::wrong(format!(
                "--to {} mm: give an inner radius from {} to {} mm",
                deformed * 1e3,
                0.01 * inner * 1e3,
                most * 1e3
            )));
        }
        Ok(Some(setup))
    }
}

/// Greatest inner stretch that is shown.
const GREATEST: f64 = 20.0;

fn number(option: &str, text: &str, unit: &str) -> Result<f64, Failure> {
    si(text.trim(), unit).map_err(|e| Failure::wrong(format!("{option} {text}: {}; {}", e.message, e.help)))
}

fn setup(
    name: &str,
    moduli: [f64; 2],
    [inner, deformed, outer]: [f64; 3],
    printed: Option<f64>,
) -> Result<Setup, Failure> {
    let shell = Shell::new(moduli[0], moduli[1], inner, outer).map_err(Failure::wrong)?;
    Ok(Setup { name: name.to_owned(), shell, moduli, deformed, printed })
}

/// The bladder of the rigs, and the set-ups of the figures: C1 and C2 in Pa, R_i, r_i and R_o in m, printed pressure in psi.
fn known() -> Result<Vec<Setup>, Failure> {
    let all = [
        ("bladder of the rigs", [1.8e5, 5.4e4], [0.050, 0.060, 0.053], None),
        ("Fig 2.4", [11e3, 22e3], [0.10, 0.13, 0.15], Some(14.552)),
        ("Fig 2.5", [5e5, 1e6], [0.075, 0.12, 0.10], Some(14.5193)),
        ("Fig 2.6", [5e5, 1.2e6], [0.12, 0.10, 0.15], Some(-27.3631)),
        ("Fig 2.7", [1.1e12, 2.2e10], [0.10, 0.08, 0.19], Some(-27.3631)),
    ];
    all.into_iter().map(|(name, moduli, radii, printed)| setup(name, moduli, radii, printed)).collect()
}

fn row(setup: Setup) -> Row {
    let Setup { name, shell, moduli: [c1_pa, c2_pa], deformed, printed } = setup;
    let stretch = deformed / shell.inner_radius();
    let pressure = shell.pressure(stretch);
    let (from, to) = (0.85 * stretch.min(1.0), 1.25 * stretch.max(1.0));
    let at = |i: u32| from + (to - from) * f64::from(i) / f64::from(PARTS);
    let limit_points = shell.limit_points();
    Row {
        name,
        c1_pa,
        c2_pa,
        radii_at_rest_m: [shell.inner_radius(), shell.outer_radius()],
        radii_m: [deformed, shell.surface_radius(stretch)],
        stretch,
        pressure_pa: pressure,
        pressure_psi: pressure / PSI,
        printed_psi: printed,
        buckling_pa: shell.buckling_pressure(),
        is_modelled: pressure > shell.buckling_pressure(),
        limit_points: limit_points
            .iter()
            .map(|l| LimitPoint { stretch: l.inner_stretch, pressure_pa: l.pressure })
            .collect(),
        curve: (0..=PARTS).map(|i| (at(i), shell.pressure(at(i)))).collect(),
    }
}

/// A pressure in a unit in which its digits can be read.
fn readable(pa: f64) -> (f64, &'static str) {
    match pa.abs() {
        p if p >= 1e9 => (1e-9, "GPa"),
        p if p >= 1e6 => (1e-6, "MPa"),
        _ => (1e-3, "kPa"),
    }
}

fn print(rows: &[Row]) {
    outln!(
        "{:<22} {:>9} {:>10} {:>10} {:>16} {:>12} {:>12}  limit points",
        "",
        "stretch",
        "r_i, mm",
        "r_o, mm",
        "pressure",
        "psi",
        "printed, psi"
    );
    for row in rows {
        let (scale, unit) = readable(row.pressure_pa);
        let limits: Vec<String> = row
            .limit_points
            .iter()
            .map(|l| format!("{:.1} {unit} at {:.3}", l.pressure_pa * scale, l.stretch))
            .collect();
        let limits = if limits.is_empty() { "none".to_owned() } else { limits.join(", ") };
        let buckled = if row.is_modelled { "" } else { "; below the pressure at which a thin shell buckles" };
        outln!(
            "{:<22} {:>9.4} {:>10.2} {:>10.2} {:>12.3} {unit} {:>12.5} {:>12}  {limits}{buckled}",
            row.name,
            row.stretch,
            row.radii_m[0] * 1e3,
            row.radii_m[1] * 1e3,
            row.pressure_pa * scale,
            row.pressure_psi,
            row.printed_psi.map_or_else(|| "-".to_owned(), |p| p.to_string()),
        );
    }
}

/// Pressure against stretch, with the point of the deformation.
fn picture(row: &Row) -> Result<String, Failure> {
    let most = row.curve.iter().map(|(_, p)| p.abs()).fold(0.0, f64::max);
    let (scale, unit) = readable(most);
    let line = |name: String, points: Vec<(f64, f64)>, style: Style| Series { name, points, style };
    let scaled = |points: &[(f64, f64)]| points.iter().map(|(l, p)| (*l, p * scale)).collect::<Vec<_>>();
    let here = [(row.stretch, row.pressure_pa)];
    let [inner, outer] = row.radii_at_rest_m.map(|r| r * 1e3);
    let mut series = vec![
        line(format!("R_i {inner:.0} mm, R_o {outer:.0} mm"), scaled(&row.curve), Style::Line),
        line(
            format!("{:.4}: {:.3} {unit}", row.stretch, row.pressure_pa * scale),
            scaled(&here),
            Style::Dots,
        ),
    ];
    let shown = |l: &&LimitPoint| {
        row.curve.first().zip(row.curve.last()).is_some_and(|(a, b)| (a.0..=b.0).contains(&l.stretch))
    };
    let limits: Vec<(f64, f64)> =
        row.limit_points.iter().filter(shown).map(|l| (l.stretch, l.pressure_pa)).collect();
    if !limits.is_empty() {
        series.push(line("limit points".to_owned(), scaled(&limits), Style::Dots));
    }
    let chart = Chart {
        title: format!("{}: pressure against stretch, closed form of (2.40)", row.name),
        x: "inner stretch r_i / R_i".into(),
        y: format!("pressure inside over outside, {unit}"),
        series,
    };
    chart.svg(720, 420).map_err(Failure::failed)
}

fn write(folder: &Path, rows: &[Row]) -> Result<(), Failure> {
    let failure =
        |path: &Path, e: &dyn std::fmt::Display| Failure::failed(format!("{}: {e}", path.display()));
    std::fs::create_dir_all(folder).map_err(|e| failure(folder, &e))?;
    for row in rows {
        let name = row.name.to_lowercase().replace([' ', '.'], "-");
        let path = folder.join(format!("{name}.svg"));
        std::fs::write(&path, picture(row)?).map_err(|e| failure(&path, &e))?;
    }
    let path = folder.join("bladders.json");
    let text = serde_json::to_string_pretty(rows).map_err(Failure::failed)?;
    std::fs::write(&path, text + "\n").map_err(|e| failure(&path, &e))
}
