//! What a call of the pool costs beside its computation: a worker, the process that carries messages, and loopback.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::process::Stdio;
use std::time::Instant;

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::beams::{Influence, RingDoses, solve_beams};
use stillpoint_plan::dose::{Anatomy, BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, Objective, Overdose, StructureObjectives, Underdose};
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, Call, CallError, ClientSettings, Hash, Home, Pool, answer, goals};

use crate::bench::two_ports;
use crate::pool::{Ends, program};
use crate::water::ring;

const CALLS: usize = 60;
/// Calls that are not counted: the first fetch, and answers that are compared.
const WARM: usize = 5;
/// Points of the small problem: its answer has about 4 KiB.
const POINTS: usize = 160;
/// Spacing by which a dose has about 1 MiB, mm.
const FINE_MM: f64 = 6.4;

struct Problem {
    calls: Vec<Call>,
    contents: BTreeMap<Hash, Vec<u8>>,
    compute: Box<dyn Fn(usize) -> Vec<u8>>,
}

impl Home for Problem {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        self.contents.get(hash).map(Vec::as_slice)
    }

    fn check(&self, _: usize, _: &[u8]) -> Result<(), CallError> {
        Ok(())
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError> {
        Ok((self.compute)(call))
    }
}

/// A cube of water of 150 mm with this spacing.
fn engine(spacing_mm: f64) -> DoseEngine {
    let side = (150.0 / spacing_mm) as usize + 1;
    let grid = Grid {
        counts: [side; 3],
        spacing_mm: [spacing_mm; 3],
        origin_mm: [-0.5 * spacing_mm * (side - 1) as f64; 3],
    };
    let within = |voxel: usize, mm: f64| {
        let at = grid.voxel(voxel);
        (0..3).map(|axis| (grid.origin_mm[axis] + spacing_mm * at[axis] as f64).powi(2)).sum::<f64>()
            <= mm * mm
    };
    let anatomy = Anatomy {
        grid,
        hu: &vec![0; grid.len()],
        external: &Mask::from_fn(grid.len(), |voxel| within(voxel, 74.0)),
        target: &Mask::from_fn(grid.len(), |voxel| within(voxel, 20.0)),
        isocentre_mm: [0.0; 3],
    };
    let params =
        DoseParams { grid, bixels: BixelSpec::of_width(10.0), ..DoseParams::over(&grid, spacing_mm) };
    DoseEngine::new(&anatomy, Machine::shipped().unwrap(), params).unwrap()
}

/// Solves of one beam on few points.
fn solves() -> Problem {
    let engine = engine(10.0);
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let doses = RingDoses::load(&cache, &[engine], ring(), &[0], NonZeroUsize::MIN, || ()).unwrap();
    let rows = doses.beam(0).rows();
    let requested = StructureObjectives {
        name: "target".into(),
        voxels: (0..POINTS).map(|i| (rows / 2 - POINTS / 2 + i) as u32).collect(),
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives: vec![
            Objective::Underdose(Underdose { dose: 60.0, weight: 200.0 }),
            Objective::Overdose(Overdose { dose: 63.0, weight: 100.0 }),
        ],
    };
    let goals = Goals::new(vec![requested], rows).unwrap();
    let goals_bytes = goals::to_bytes(&goals);
    let dose = doses.files(0).next().unwrap().bytes().to_vec();
    let (goals_hash, dose_hash) = (Hash::of(&goals_bytes), Hash::of(&dose));
    let tolerance = |i: usize| 1e-4 * (1.0 + 1e-3 * i as f64);
    let calls =
        (0..CALLS).map(|i| Call::solve(goals_hash, vec![vec![dose_hash]], None, tolerance(i))).collect();
    let contents = BTreeMap::from([(goals_hash, goals_bytes), (dose_hash, dose)]);
    let compute = move |i: usize| {
        let _ = &folder;
        answer::of_plan(
            &solve_beams(&goals, &[doses.beam(0)], None, tolerance(i), NonZeroUsize::MIN).unwrap(),
        )
    };
    Problem { calls, contents, compute: Box::new(compute) }
}

/// Doses of a fine grid.
fn doses() -> Problem {
    let engine = engine(FINE_MM);
    let bytes = engine.to_bytes().unwrap();
    let name = Hash::of(&bytes);
    let angle = |i: usize| 3.0 * i as f64;
    let calls = (0..CALLS).map(|i| Call::dose(name, angle(i))).collect();
    let compute = move |i: usize| engine.beam_file(angle(i)).unwrap();
    Problem { calls, contents: BTreeMap::from([(name, bytes)]), compute: Box::new(compute) }
}

fn reported(what: &str, times: &mut [f64]) {
    times.sort_by(f64::total_cmp);
    let at = |share: usize| times[times.len() * share / 100] * 1e3;
    eprintln!("{what}: p50 {:.2} ms, p90 {:.2} ms, least {:.2} ms", at(50), at(90), at(0));
}

/// The time until the answer of each call is there, s.
fn asked(endpoint: &str, problem: &Problem) -> Vec<f64> {
    let courier = ChildCourier::start(program(&["plan-client", "--connect", endpoint])).unwrap();
    let settings = ClientSettings { checked: 0.0, ..ClientSettings::new(Build::here().unwrap()) };
    let mut pool = Pool::new(courier, settings);
    let mut times = Vec::new();
    for place in 0..CALLS {
        // One call, at its place.
        let one = Problem {
            calls: Vec::new(),
            contents: problem.contents.clone(),
            compute: Box::new(|_| panic!("a call of its own is computed by the worker")),
        };
        let begun = Instant::now();
        let answers = match place < WARM {
            true => pool.call_all(&problem.calls[..WARM], problem),
            false => pool.call_all(&problem.calls[place..=place], &one),
        };
        times.push(begun.elapsed().as_secs_f64());
        assert!(!answers.unwrap().is_empty());
    }
    assert_eq!(pool.tally().hedged, 0, "a call was late");
    times.split_off(WARM)
}

#[test]
#[ignore = "a measurement of a minute: .ci/soak runs it"]
fn overhead_of_a_call_of_the_pool() {
    for (name, problem) in [("solve", solves()), ("dose", doses())] {
        let folder = tempfile::tempdir().unwrap();
        let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
        let cache = folder.path().join("cache");
        let arguments = [
            "worker",
            "--listen",
            &endpoint,
            "--slots",
            "1",
            "--name",
            "w",
            "--cache",
            cache.to_str().unwrap(),
        ];
        let _worker = Ends(program(&arguments).stdout(Stdio::null()).spawn().unwrap());
        let answer = (problem.compute)(WARM).len();
        let fresh = asked(&endpoint, &problem);
        let mut alone: Vec<f64> = Vec::new();
        for place in WARM..CALLS {
            let begun = Instant::now();
            (problem.compute)(place);
            alone.push(begun.elapsed().as_secs_f64());
        }
        let mut over: Vec<f64> = fresh.iter().zip(&alone).map(|(there, here)| there - here).collect();
        eprintln!("{name}, answers of {answer} bytes, {} calls one after the other", over.len());
        reported("  computed here", &mut alone);
        reported("  by the worker, more than that", &mut over);
        // The worker has these answers: nothing is computed.
        reported("  answers that the worker has", &mut asked(&endpoint, &problem));
    }
}
