//! `stillpoint-research plans`: figures of plans, and how far they are from those of a finer grid.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use serde::Serialize;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_patient::case::{Case, NameTable, import_described, phantom};
use stillpoint_plan::beams::{
    Budget, Evaluated, Evaluator, Influence, Method, Ring, RingDoses, choose, class_solution,
};
use stillpoint_plan::dose::{BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::evaluation::{FallOff, OnGrid, StructureDose};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::leaves::{FluenceBeam, LeafOptions, sequence};
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::recompute::{Recompute, WeightedBeam};
use stillpoint_plan::sampling::Sampling;

/// Spacing of the optimiser's points, mm: the default of `stillpoint plan`.
const GRID_MM: f64 = 5.0;
/// Dose whose volume is compared, gray.
const VOLUME_AT_GY: f64 = 10.0;

/// Plan cases with given beams and the built-in objectives. Print the figures by which a plan is accepted, and their largest
/// difference from those of a dose on a finer grid.
///
/// Beams are those of the class solution of their number (equally spaced, except for five and seven); nothing is searched. Doses are in Gy, volumes and isodoses in percent.
#[derive(Args)]
pub struct Plans {
    /// Cases: sixteen pelves, the C-shape of TG-119, or four head-and-neck patients. All but the pelves need the folder of the
    /// reference data; without it the pelves are the phantoms of seeds 0 to 15.
    #[arg(long, value_enum, default_value_t = Which::Pelves)]
    cases: Which,
    /// Run only the first cases.
    #[arg(long, value_name = "NUMBER")]
    first: Option<usize>,
    /// Run only the cases with these numbers, from 0.
    #[arg(long, value_delimiter = ',', value_name = "NUMBERS", conflicts_with = "first")]
    only: Vec<usize>,
    /// Numbers of beams.
    #[arg(long, value_delimiter = ',', default_values_t = [5, 9, 15])]
    beams: Vec<usize>,
    /// Widths of a bixel, mm.
    #[arg(long, value_delimiter = ',', default_values_t = [5.0, 10.0])]
    bixels: Vec<f64>,
    /// Spacing of the grid that figures are compared with, mm.
    #[arg(long, default_value_t = 1.5, value_name = "MM")]
    finer: f64,
    /// In place of figures: sequence the fluences for the leaves of the built-in machine as `stillpoint plan` does, and print
    /// how much the objective rises, in percent, without and with the transmission of the leaves.
    #[arg(long)]
    leaves: bool,
    /// Folder of the reference data; the default is the environment variable STILLPOINT_DATA.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// JSON table of objectives; its entries take precedence over the built-in table.
    #[arg(long, value_name = "FILE")]
    objectives: Option<PathBuf>,
    /// Number of threads; no figure depends on it.
    #[arg(long, default_value_t = NonZeroUsize::MIN)]
    threads: NonZeroUsize,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Which {
    Pelves,
    Tg119,
    Patients,
}

/// A plan and its figures.
#[derive(Serialize)]
struct Row {
    case: String,
    beams: usize,
    bixel_mm: f64,
    structures: Vec<StructureDose>,
    fall_off: Option<FallOff>,
    /// Largest differences from the finer grid, over all structures.
    differences: Differences,
}

/// What leaves cost, as parts of the objective of the fluence.
#[derive(Serialize)]
struct Loss {
    case: String,
    beams: usize,
    bixel_mm: f64,
    segments: usize,
    /// In one fraction.
    monitor_units: f64,
    /// Behind leaves that let nothing through.
    opaque: f64,
    /// With their transmission.
    shaped: f64,
}

#[derive(Clone, Default, Serialize)]
struct Differences {
    /// Of D98, D95, D50, D2, D0.03cc, gray.
    dose_gy: f64,
    /// Structure and figure of that difference, with both values.
    dose_of: String,
    /// Of the part of a target that gets 95 % of its prescription.
    covered: f64,
    /// Of the part of a structure that gets 10 Gy.
    v10: f64,
}

impl Plans {
    pub fn execute(self) -> Ended {
        let table = self.table()?;
        if self.leaves {
            return self.losses(&table);
        }
        let mut rows = Vec::new();
        if !self.json {
            outln!(
                "| case | beams | bixels, mm | V95%, least | D98 | D2 | HI | Paddick | R50 | beyond 2 cm, % | first cm, % | off: dose, Gy | of: reported, finer | off: V95%, % | off: V10, % |"
            );
            outln!("|{}", " --- |".repeat(15));
        }
        for (name, case) in self.cases()? {
            for &bixel_mm in &self.bixels {
                for &beams in &self.beams {
                    let row = self.row(&name, &case, &table, (beams, bixel_mm))?;
                    if !self.json {
                        outln!("{}", row.line(&case));
                    }
                    rows.push(row);
                }
            }
        }
        if self.json {
            print_json(&rows)?;
        }
        Ok(Exit::Done)
    }

    /// What leaves cost.
    fn losses(&self, table: &ObjectiveTable) -> Ended {
        let mut losses = Vec::new();
        if !self.json {
            outln!("| case | beams | bixels, mm | segments | MU | loss, opaque leaves, % | loss, % |");
            outln!("|{}", " --- |".repeat(7));
        }
        for (name, case) in self.cases()? {
            for &bixel_mm in &self.bixels {
                for &beams in &self.beams {
                    let plan = Planned::new(&case, table, (beams, bixel_mm), self.threads);
                    let loss = plan.and_then(|plan| Loss::of(&name, &case, &plan))?;
                    if !self.json {
                        outln!("{}", loss.line());
                    }
                    losses.push(loss);
                }
            }
        }
        if self.json {
            print_json(&losses)?;
        }
        Ok(Exit::Done)
    }

    fn table(&self) -> Result<ObjectiveTable, Failure> {
        let shipped = ObjectiveTable::shipped().map_err(Failure::failed)?;
        let Some(path) = &self.objectives else { return Ok(shipped) };
        let text =
            std::fs::read_to_string(path).map_err(|e| Failure::wrong(format!("{}: {e}", path.display())))?;
        let own =
            ObjectiveTable::parse(&text).map_err(|e| Failure::wrong(format!("{}: {e}", path.display())))?;
        Ok(own.before(shipped))
    }

    fn cases(&self) -> Result<Vec<(String, Case)>, Failure> {
        let data = self.data.clone().or_else(|| std::env::var_os("STILLPOINT_DATA").map(PathBuf::from));
        let Some(data) = data else {
            if !matches!(self.cases, Which::Pelves) {
                return Err(Failure::wrong(
                    "these cases need the folder of the reference data: give it with --data",
                ));
            }
            let of_seed =
                |seed: u64| Ok((format!("pelvis of seed {seed}"), phantom(seed).map_err(Failure::failed)?));
            return (0..16)
                .filter(|place| self.is_requested(*place))
                .map(|place| of_seed(place as u64))
                .collect();
        };
        let root = data.join("planning");
        let files: Vec<PathBuf> = match self.cases {
            Which::Pelves => {
                let others = (1..16).map(|n| root.join(format!("pelvis/pelvis_{n:03}.json")));
                std::iter::once(root.join("pelvis_000/pelvis_000.json")).chain(others).collect()
            }
            Which::Tg119 => vec![root.join("tg119/tg119.json")],
            Which::Patients => (1..=4).map(|n| root.join(format!("openkbp/openkbp_{n}.json"))).collect(),
        };
        let names = NameTable::shipped().map_err(Failure::failed)?;
        let read = |file: &PathBuf| {
            let case = import_described(file, &names).map_err(Failure::failed)?.case;
            Ok((file.file_stem().and_then(|s| s.to_str()).unwrap_or_default().to_owned(), case))
        };
        let requested = files.iter().enumerate().filter(|(place, _)| self.is_requested(*place));
        requested.map(|(_, file)| read(file)).collect()
    }

    fn is_requested(&self, place: usize) -> bool {
        self.first.is_none_or(|first| place < first) && (self.only.is_empty() || self.only.contains(&place))
    }

    fn row(
        &self,
        name: &str,
        case: &Case,
        table: &ObjectiveTable,
        (beams, bixel_mm): (usize, f64),
    ) -> Result<Row, Failure> {
        let plan = Planned::new(case, table, (beams, bixel_mm), self.threads)?;
        let (structures, fall_off) = plan.figures(case, None, self.threads)?;
        let (finer, _) = plan.figures(case, Some(self.finer), self.threads)?;
        let differences = Differences::between(&structures, &finer);
        Ok(Row { case: name.to_owned(), beams, bixel_mm, structures, fall_off, differences })
    }
}

/// The plan of given beams.
struct Planned {
    params: DoseParams,
    points_mm: f64,
    /// The plan with what it was made of.
    ring: Ring,
    doses: RingDoses,
    goals: Goals,
    best: Arc<Evaluated>,
}

impl Planned {
    fn new(
        case: &Case,
        table: &ObjectiveTable,
        (count, bixel_mm): (usize, f64),
        threads: NonZeroUsize,
    ) -> Result<Self, Failure> {
        let sampling = Sampling::new(case, GRID_MM, bixel_mm).map_err(Failure::failed)?;
        let bixels = BixelSpec::of_width(bixel_mm);
        let params = DoseParams { grid: *sampling.grid(), bixels, ..DoseParams::over(case.grid(), GRID_MM) };
        let engine = DoseEngine::of_case(case, machine()?, params).map_err(Failure::failed)?;
        let engine = sampling.engine(&engine);
        let ring = Ring::new(90, 5).map_err(Failure::failed)?;
        ring.check_room(count).map_err(Failure::failed)?;
        let angles = class_solution(count);
        let mut beams: Vec<u16> = angles.iter().map(|angle| ring.nearest(*angle)).collect();
        beams.sort_unstable();
        let folder = tempfile::tempdir().map_err(Failure::failed)?;
        let cache = DoseCache::in_folder(Path::new(folder.path())).map_err(Failure::failed)?;
        let doses = RingDoses::load(&cache, std::slice::from_ref(&engine), ring, &beams, threads, || ())
            .map_err(Failure::failed)?;
        let goals = table
            .for_points(case, &sampling)
            .and_then(|objective_set| objective_set.goals(1))
            .map_err(Failure::failed)?;
        let mut evaluator = Evaluator::new(&doses, &goals, ring, count, Budget { solves: 1 });
        let best = choose(&Method::Class(angles), &mut evaluator, None, 0).map_err(Failure::failed)?.best;
        drop(evaluator);
        let points_mm = sampling.grid().spacing_mm[0];
        Ok(Self { params, points_mm, ring, doses, goals, best })
    }

    /// Figures as `stillpoint plan` tells them, or on a grid of another spacing.
    fn figures(
        &self,
        case: &Case,
        spacing_mm: Option<f64>,
        threads: NonZeroUsize,
    ) -> Result<(Vec<StructureDose>, Option<FallOff>), Failure> {
        let recompute = match spacing_mm {
            None => Recompute::new(case, machine()?, &self.params, self.points_mm),
            Some(mm) => Recompute::with_spacing(case, machine()?, &self.params, mm),
        };
        let recompute = recompute.map_err(Failure::failed)?;
        let weighted = |beam: &u16| WeightedBeam {
            angles: self.ring.angle_deg(*beam).into(),
            weights: self.best.weights_of(*beam).unwrap_or_default(),
            bixels_mm: None,
        };
        let beams: Vec<WeightedBeam<'_>> = self.best.beams.beams().iter().map(weighted).collect();
        let gray = recompute.dose(&beams, [0.0; 3], threads).map_err(Failure::failed)?;
        let on_grid = OnGrid::new(case, recompute.grid());
        let evaluation = on_grid.evaluate(&gray);
        Ok((evaluation.figures(&[VOLUME_AT_GY]), evaluation.fall_off))
    }
}

impl Loss {
    /// With the numbers of `stillpoint plan`.
    fn of(name: &str, case: &Case, plan: &Planned) -> Result<Self, Failure> {
        let machine = machine()?;
        let collimator = machine
            .file()
            .collimator
            .as_ref()
            .ok_or_else(|| Failure::failed("the machine has no collimator"))?;
        let mu_per_weight = collimator.mu_per_weight / f64::from(case.fractions().unwrap_or(1));
        let bixel_mm = plan.params.bixels.width_mm;
        let options = LeafOptions {
            width_mm: bixel_mm,
            least_weight: collimator.least_mu / mu_per_weight,
            ..LeafOptions::PLAN
        };
        let best = &plan.best;
        let beam = |beam: &u16| FluenceBeam {
            doses: plan.doses.beam(*beam),
            bixels_mm: plan.doses.bixels_mm(*beam),
            weights: best.weights_of(*beam).unwrap_or_default(),
        };
        let beams: Vec<FluenceBeam<'_>> = best.beams.beams().iter().map(beam).collect();
        // Segments pay for no modulation, so they are compared by doses.
        let planned = plan.goals.cost_of(&best.plan).map_err(Failure::failed)?;
        let found = sequence(&plan.goals, &beams, collimator, planned, options).map_err(Failure::failed)?;
        let segments = || found.beams.iter().flatten().flat_map(|beam| &beam.segments);
        Ok(Self {
            case: name.to_owned(),
            beams: beams.len(),
            bixel_mm,
            segments: segments().count(),
            monitor_units: mu_per_weight * segments().map(|segment| segment.weight).sum::<f64>(),
            opaque: found.opaque / planned - 1.0,
            shaped: found.plan.certificate.objective / planned - 1.0,
        })
    }

    fn line(&self) -> String {
        format!(
            "| {} | {} | {} | {} | {:.0} | {:.2} | {:.2} |",
            self.case,
            self.beams,
            self.bixel_mm,
            self.segments,
            self.monitor_units,
            100.0 * self.opaque,
            100.0 * self.shaped
        )
    }
}

fn machine() -> Result<Machine, Failure> {
    Machine::shipped().map_err(Failure::failed)
}

impl Differences {
    fn between(reported: &[StructureDose], finer: &[StructureDose]) -> Self {
        let mut largest = Self::default();
        for (a, b) in reported.iter().zip(finer) {
            let doses = |f: &StructureDose| [f.d98_gy, f.d95_gy, f.d50_gy, f.d2_gy, f.d003cc_gy];
            let names = ["D98", "D95", "D50", "D2", "D0.03cc"];
            for (name, (reported, finer)) in names.iter().zip(doses(a).into_iter().zip(doses(b))) {
                if (reported - finer).abs() > largest.dose_gy {
                    largest.dose_gy = (reported - finer).abs();
                    largest.dose_of = format!("{} {name}: {reported:.2}, {finer:.2}", a.name);
                }
            }
            let covered = |f: &StructureDose| f.covered.unwrap_or(0.0);
            let v10 = |f: &StructureDose| f.volumes.first().map_or(0.0, |v| v.fraction);
            largest.covered = largest.covered.max((covered(a) - covered(b)).abs());
            largest.v10 = largest.v10.max((v10(a) - v10(b)).abs());
        }
        largest
    }
}

impl Row {
    /// The row of a table: of the target of the highest prescription, and the least coverage of all targets.
    fn line(&self, case: &Case) -> String {
        let highest = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let targets = || self.structures.iter().filter(|s| s.prescribed_gy.is_some());
        let main = targets().find(|s| s.prescribed_gy == Some(highest));
        let number =
            |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        let percent = |gray: Option<f64>| number(gray.map(|gray| 100.0 * gray / highest), 0);
        let least = targets().filter_map(|s| s.covered).fold(f64::INFINITY, f64::min);
        let fall_off = self.fall_off.as_ref();
        let cells = [
            self.case.clone(),
            self.beams.to_string(),
            self.bixel_mm.to_string(),
            format!("{:.1}", 100.0 * least),
            number(main.map(|s| s.d98_gy), 1),
            number(main.map(|s| s.d2_gy), 1),
            number(main.and_then(|s| s.homogeneity), 3),
            number(main.and_then(|s| s.conformity), 2),
            number(fall_off.map(|f| f.r50), 1),
            percent(fall_off.and_then(|f| f.d2cm_gy)),
            percent(fall_off.and_then(|f| f.first_cm_gy)),
            format!("{:.2}", self.differences.dose_gy),
            self.differences.dose_of.clone(),
            format!("{:.2}", 100.0 * self.differences.covered),
            format!("{:.2}", 100.0 * self.differences.v10),
        ];
        format!("| {} |", cells.join(" | "))
    }
}
