//! Many patients: each is planned as if it were alone, some at the same time.
//!
//! A plan is not made again if its folder has a `request.json` of the same request: the content of the case, the arguments
//! on which a plan depends, the content of the files that they name, and the build.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Instant;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use stillpoint_patient::case::read;
use stillpoint_plan::plan_file::PlanFile;
use stillpoint_pool::Build;

use super::arc;
use super::args::PlanArgs;
use super::patient;
use super::request::Patient;
use super::table::beams;
use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};

/// The file that says of which request of a queue a plan is; a plan that is written into its folder removes it.
pub const REQUEST: &str = "request.json";
/// Patients that are planned at the same time with a pool, if nothing else is asked for.
const WITH_POOL: usize = 4;

/// Patients that wait for their plans.
pub struct Queue<'a> {
    args: &'a PlanArgs,
    cases: &'a [PathBuf],
    out: PathBuf,
    jobs: NonZeroUsize,
    /// Threads of each patient.
    threads: NonZeroUsize,
    /// The part of a request that is the same for all patients.
    asked: Value,
}

/// What became of a patient.
enum State {
    /// The plan was made.
    Planned,
    /// The plan was there from an earlier call.
    Found,
    /// There is no plan, for this reason.
    Failed(String),
}

struct Row {
    case: PathBuf,
    out: Option<PathBuf>,
    state: State,
    plan: Option<PlanFile>,
    seconds: f64,
}

impl<'a> Queue<'a> {
    /// Of these case files, on so many threads in all.
    pub fn new(args: &'a PlanArgs, cases: &'a [PathBuf], threads: NonZeroUsize) -> Result<Self, Failure> {
        let of_one = [
            ("--accept-check", args.accept_check.is_some()),
            ("--keep-identity", args.keep_identity.is_some()),
            ("--pool-record", args.pool_record.is_some()),
        ];
        if let Some((option, _)) = of_one.iter().find(|(_, is_given)| *is_given) {
            return Err(Failure::wrong(format!(
                "{option} is for one patient, and there are {} cases: plan that case alone",
                cases.len()
            )));
        }
        let usual = if args.pool.is_given() { WITH_POOL } else { threads.get().div_ceil(2) };
        let jobs = args.jobs.map_or(usual, NonZeroUsize::get).min(cases.len());
        let jobs = NonZeroUsize::new(jobs).unwrap_or(NonZeroUsize::MIN);
        Ok(Self {
            args,
            cases,
            out: args.out.clone().unwrap_or_else(|| PathBuf::from("plans")),
            jobs,
            threads: NonZeroUsize::new(threads.get() / jobs).unwrap_or(NonZeroUsize::MIN),
            asked: asked(args)?,
        })
    }

    /// Plans all patients, and prints a table of them.
    pub fn execute(&self) -> Ended {
        let waiting = Mutex::new((self.cases.iter().enumerate(), BTreeMap::<PathBuf, PathBuf>::new()));
        let rows = Mutex::new(BTreeMap::new());
        std::thread::scope(|scope| {
            for _ in 0..self.jobs.get() {
                scope.spawn(|| {
                    loop {
                        let next = waiting.lock().unwrap_or_else(PoisonError::into_inner).0.next();
                        let Some((place, case)) = next else { return };
                        let claim = |out: &Path| {
                            let taken = &mut waiting.lock().unwrap_or_else(PoisonError::into_inner).1;
                            match taken.get(out) {
                                Some(other) => Err(other.clone()),
                                None => {
                                    taken.insert(out.to_owned(), case.clone());
                                    Ok(())
                                }
                            }
                        };
                        let row = self.row(case, claim);
                        errln!("{}", row.line());
                        rows.lock().unwrap_or_else(PoisonError::into_inner).insert(place, row);
                    }
                });
            }
        });
        let rows: Vec<Row> =
            rows.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect();
        if self.args.json {
            print_json(&rows.iter().map(Row::to_json).collect::<Vec<_>>())?;
        } else {
            print(&rows);
        }
        let is_failed = rows.iter().any(|row| matches!(row.state, State::Failed(_)));
        let is_refused = rows.iter().any(Row::is_refused);
        Ok(match (is_failed, is_refused) {
            (true, _) => Exit::Failed,
            (false, true) => Exit::Refused,
            (false, false) => Exit::Done,
        })
    }

    fn row(&self, path: &Path, claim: impl Fn(&Path) -> Result<(), PathBuf>) -> Row {
        let began = Instant::now();
        let mut row =
            Row { case: path.to_owned(), out: None, state: State::Planned, plan: None, seconds: 0.0 };
        // A panic is a fault of this program, and no reason to leave the other patients without a plan.
        let planned = catch_unwind(AssertUnwindSafe(|| self.plan(path, claim, &mut row.out)));
        let planned = planned.unwrap_or_else(|_| Err(Failure::failed("the plan panicked, see above")));
        row.seconds = began.elapsed().as_secs_f64();
        match planned {
            Ok((state, plan)) => (row.state, row.plan) = (state, Some(plan)),
            Err(failure) => row.state = State::Failed(failure.text),
        }
        row
    }

    fn plan(
        &self,
        path: &Path,
        claim: impl Fn(&Path) -> Result<(), PathBuf>,
        to: &mut Option<PathBuf>,
    ) -> Result<(State, PlanFile), Failure> {
        let case = read(path).map_err(Failure::wrong)?;
        let out = to.insert(self.out.join(case.name())).clone();
        claim(&out).map_err(|other| {
            Failure::wrong(format!(
                "its plan would go into {}, where that of {} goes: rename one of the cases",
                out.display(),
                other.display()
            ))
        })?;
        let request = json!({ "case": digest(path)?, "request": self.asked });
        let file = out.join(REQUEST);
        let recorded = std::fs::read(&file).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        if recorded.as_ref() == Some(&request)
            && let Ok(plan) = plan_of(&out)
        {
            return Ok((State::Found, plan));
        }
        let fault = |e: std::io::Error| Failure::failed(format!("{}: {e}", file.display()));
        let patient = Patient {
            case: Some(path),
            out: Some(out.clone()),
            threads: self.threads,
            is_quiet: true,
            weights: None,
        };
        match &self.args.arc {
            Some(arcs) => arc::plan(self.args, &patient, arcs).map(|_| ())?,
            None => patient::plan(self.args, &patient, |_| Ok(())).map(|_| ())?,
        }
        let text = serde_json::to_vec_pretty(&request).map_err(Failure::failed)?;
        stillpoint_map::publish(&file, |file| std::io::Write::write_all(file, &text)).map_err(fault)?;
        Ok((State::Planned, plan_of(&out)?))
    }
}

/// What is asked for every patient, as far as a plan depends on it.
fn asked(args: &PlanArgs) -> Result<Value, Failure> {
    // Each argument is named, so that none is forgotten.
    let PlanArgs {
        cases: _,
        out: _,
        doses: _,
        threads: _,
        jobs: _,
        pool: _,
        pool_record: _,
        json: _,
        // A queue has none.
        start: _,
        accept_check,
        keep_identity,
        beams,
        budget,
        method,
        prior,
        network,
        leaves,
        angles,
        arc,
        couch,
        compare,
        robust,
        robust_by,
        objectives,
        protocol,
        machine,
        engine,
        fluence_only,
        grid,
        dose_grid,
        bixel,
        body_margin,
        flash,
        seed,
    } = args;
    let content = |file: &Option<PathBuf>| file.as_deref().map(digest).transpose();
    let prior: Vec<&str> = prior.iter().map(|prior| prior.word()).collect();
    Ok(json!({
        "build": Build::here().map_err(Failure::failed)?.text(),
        "beams": beams,
        "budget": budget,
        "method": method.word(),
        "prior": prior,
        "network": content(network)?,
        "leaves": leaves,
        "angles": angles,
        "arc": arc,
        "couch": couch,
        "compare": compare,
        "robust": robust,
        "robust_by": format!("{robust_by:?}").to_lowercase(),
        "objectives": content(objectives)?,
        "protocol": content(protocol)?,
        "machine": content(machine)?,
        "engine": engine.word(),
        "fluence_only": fluence_only,
        "grid": grid,
        "dose_grid": dose_grid,
        "bixel": bixel,
        "body_margin": body_margin,
        "flash": flash,
        "seed": seed,
        // The plan does not depend on these two, and its DICOM files do.
        "accept_check": accept_check,
        "keep_identity": keep_identity,
    }))
}

/// The SHA-256 of a file.
fn digest(path: &Path) -> Result<String, Failure> {
    let bytes = std::fs::read(path).map_err(|e| Failure::wrong(format!("{}: {e}", path.display())))?;
    Ok(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}

fn plan_of(folder: &Path) -> Result<PlanFile, Failure> {
    let path = folder.join("plan.json");
    let fault = |why: &dyn std::fmt::Display| Failure::failed(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(&path).map_err(|e| fault(&e))?;
    PlanFile::from_json(&bytes).map_err(|e| fault(&e))
}

impl Row {
    fn is_refused(&self) -> bool {
        let check = self.plan.as_ref().and_then(|plan| plan.check.as_ref());
        check.is_some_and(|check| !check.faults.is_empty() && check.accepted.is_none())
    }

    fn word(&self) -> &'static str {
        match (&self.state, self.is_refused()) {
            (State::Failed(_), _) => "FAILED",
            (State::Planned, false) => "planned",
            (State::Planned, true) => "planned, REFUSED",
            (State::Found, false) => "was there",
            (State::Found, true) => "was there, REFUSED",
        }
    }

    fn name(&self) -> String {
        match &self.plan {
            Some(plan) => plan.case.name.clone(),
            None => self.case.display().to_string(),
        }
    }

    /// The row as soon as it is known.
    fn line(&self) -> String {
        match &self.state {
            State::Failed(reason) => format!("{}: FAILED: {reason}", self.case.display()),
            _ => format!("{}: {} after {:.1} s", self.case.display(), self.word(), self.seconds),
        }
    }

    fn to_json(&self) -> Value {
        let plan = self.plan.as_ref();
        let reason = match &self.state {
            State::Failed(reason) => Some(reason),
            State::Planned | State::Found => None,
        };
        json!({
            "file": self.case,
            "case": plan.map(|plan| &plan.case.name),
            "folder": self.out,
            "state": match self.state {
                State::Planned => "planned",
                State::Found => "was there",
                State::Failed(_) => "failed",
            },
            "reason": reason,
            "refused": self.is_refused(),
            "objective": plan.map(|plan| plan.objective),
            "angles_deg": plan.map(PlanFile::angles_deg),
            "couches_deg": plan.map(PlanFile::couches_deg),
            "solves": plan.map(solves),
            "limits_failed": plan.map(limits_failed),
            "seconds": self.seconds,
        })
    }
}

fn solves(plan: &PlanFile) -> usize {
    plan.searches.iter().map(|search| search.solves).sum()
}

fn limits_failed(plan: &PlanFile) -> usize {
    plan.limits().iter().filter(|limit| limit.passed == Some(false)).count()
}

fn print(rows: &[Row]) {
    let right = ["objective", "solves", "limits failed", "s"].map(|name| (Side::Right, name));
    let left = [(Side::Left, "plan"), (Side::Left, "beams")];
    let mut table = Columns::new([(Side::Left, "patient")].into_iter().chain(right).chain(left));
    for row in rows {
        let of_plan = |cell: fn(&PlanFile) -> String| row.plan.as_ref().map_or("-".to_owned(), cell);
        table.row([
            row.name(),
            of_plan(|plan| format!("{:.4}", plan.objective)),
            of_plan(|plan| solves(plan).to_string()),
            of_plan(|plan| limits_failed(plan).to_string()),
            format!("{:.1}", row.seconds),
            row.word().to_owned(),
            of_plan(beams),
        ]);
    }
    out!("{table}");
    for row in rows {
        if let State::Failed(reason) = &row.state {
            outln!("{}: {reason}", row.case.display());
        }
    }
}
