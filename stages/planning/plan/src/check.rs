//! The check of a plan, before a person looks at it.
//!
//! An objective can be low on a plan that no one should deliver: with fluence that passes beside the patient, with single
//! bixels that carry a beam, or with a dose that stands only as long as the patient lies to the millimetre. [`check`] is a
//! pure function of what is known of a plan; [`Check::of`] computes what it needs, and [`crate::recipe::PlanSetup::check`] is
//! both for every program that plans. A plan with a [`Fault`] is refused. The [`Bounds`] are choices of this project; the
//! page of results on beams says what plans of drawn and real patients give.

use std::fmt::{Display, Formatter};
use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

use crate::dose::{BeamAngles, DoseError, DoseParams, EngineName, Machine};
use crate::evaluation::{OnGrid, StructureDose};
use crate::recompute::{BeamFluence, Recompute};
use stillpoint_patient::case::{Case, Role};

/// What a plan may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Part of the fluence whose rays do not cross the patient.
    pub outside: f64,
    /// Weight of a bixel, in medians of the weights above zero of its beam.
    pub medians: f64,
    /// Monitor units of a fraction for each centigray of its highest prescription.
    pub mu_per_cgy: f64,
    /// Shift of the patient along each axis, both ways, mm.
    pub shift_mm: f64,
    /// D0.03cc of the patient when shifted, as a part of that as planned.
    pub hottest: f64,
    /// Part of a target that may lose 95 % of its prescription when shifted, beyond what it loses of the planned dose where
    /// that stays in the room: this it loses by its size alone.
    pub uncovered: f64,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { outside: 0.05, medians: 10.0, mu_per_cgy: 10.0, shift_mm: 5.0, hottest: 1.25, uncovered: 0.25 }
    }
}

/// What a plan gives of each quantity that has a bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CheckValues {
    /// Part of the fluence whose rays do not cross the patient.
    pub outside: f64,
    /// The heaviest bixel, in medians of the weights above zero of its beam.
    pub medians: f64,
    /// Monitor units of a fraction for each centigray of its highest prescription; nothing without segments.
    pub mu_per_cgy: Option<f64>,
    /// D0.03cc of the patient in the worst shift, as a part of that as planned.
    pub hottest: f64,
    /// Part of a target that loses 95 % of its prescription in its worst shift beyond what it loses by its size alone, at most
    /// over the targets; 0 where it loses less.
    pub uncovered: f64,
}

/// What the check of a plan found.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// What a plan may be.
    pub bounds: Bounds,
    /// What this one is.
    pub values: CheckValues,
    /// What is beyond a bound; nothing where the plan passes.
    pub faults: Vec<Fault>,
}

/// A beam of a plan that is checked.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedBeam {
    /// Where it comes from.
    pub angles: BeamAngles,
    /// Centres of its bixels, mm.
    pub bixels_mm: Vec<[f64; 2]>,
    /// Their weights as they were optimised.
    pub weights: Vec<f64>,
    /// Fluence that is delivered, and the part of it whose rays do not cross the patient.
    pub delivered: f64,
    /// Of that fluence what passes beside the patient.
    pub outside: f64,
}

/// Doses that a check looks at, as planned or shifted, gray.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckedDose {
    /// Where the patient lies beside where he was planned, mm.
    pub shift_mm: [f64; 3],
    /// D0.03cc of the patient.
    pub hottest_gy: f64,
    /// Targets with a prescription, and the part of each that gets 95 % of it.
    pub covered: Vec<(String, f64)>,
    /// The part of each that would get it of the planned dose, where that stays in the room.
    pub of_planned: Vec<f64>,
}

/// What is known of a plan. Without doses and monitor units, its fluence alone is checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Check {
    /// Its beams.
    pub beams: Vec<CheckedBeam>,
    /// Those of them at which gantry and couch may collide.
    pub closed: Vec<BeamAngles>,
    /// Monitor units of a fraction; nothing where the fluence is not sequenced.
    pub monitor_units: Option<f64>,
    /// Highest prescription of a fraction, gray.
    pub fraction_gy: f64,
    /// The dose as planned.
    pub planned: CheckedDose,
    /// Doses to the shifted patient.
    pub shifted: Vec<CheckedDose>,
}

/// What is beyond a bound.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Fluence passes beside the patient.
    Outside {
        /// Part of the fluence.
        part: f64,
        /// Allowed.
        most: f64,
    },
    /// A bixel carries too much of its beam.
    Peak {
        /// Where the beam comes from.
        angles: BeamAngles,
        /// Centre of the bixel, mm.
        bixel_mm: [f64; 2],
        /// Its weight.
        weight: f64,
        /// Median of the weights above zero of the beam.
        median: f64,
        /// Bixels of the beam above the bound.
        count: usize,
        /// Allowed, in medians.
        most: f64,
    },
    /// Too many monitor units.
    Units {
        /// Monitor units of a fraction.
        monitor_units: f64,
        /// Highest prescription of a fraction, gray.
        fraction_gy: f64,
        /// Allowed for each centigray.
        most: f64,
    },
    /// The patient gets much more dose when shifted.
    Hotter {
        /// The shift, mm.
        shift_mm: [f64; 3],
        /// D0.03cc as planned, gray.
        planned_gy: f64,
        /// The same when shifted.
        shifted_gy: f64,
        /// Allowed, in parts of that as planned.
        most: f64,
    },
    /// A target loses much of its dose when shifted.
    Uncovered {
        /// The target.
        target: String,
        /// The shift, mm.
        shift_mm: [f64; 3],
        /// Part that would get 95 % of its prescription of the planned dose, where that stays in the room.
        planned: f64,
        /// Part that gets it.
        shifted: f64,
        /// Allowed loss.
        most: f64,
    },
    /// Gantry and couch may collide.
    Closed {
        /// The beams that are not in the free angles of the machine.
        angles: Vec<BeamAngles>,
    },
}

impl Display for Fault {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let axes = |[x, y, z]: [f64; 3]| format!("({x}, {y}, {z}) mm");
        match self {
            Self::Outside { part, most } => write!(
                f,
                "{:.1} % of the fluence misses the patient (allowed: {:.1} %): plan without `--flash`, or with \
                 beams that meet the target through the patient",
                100.0 * part,
                100.0 * most
            ),
            Self::Peak { angles, bixel_mm: [x, z], weight, median, count, most } => write!(
                f,
                "the beam at {angles} degrees has {count} bixels above {most} medians; that at x = {x} mm, z = {z} mm \
                 has a weight of {weight:.1} at a median of {median:.2}: look at its fluence"
            ),
            Self::Units { monitor_units, fraction_gy, most } => write!(
                f,
                "{monitor_units:.0} monitor units for a fraction of {fraction_gy:.2} Gy are {:.1} for each cGy (allowed: \
                 {most}): take wider bixels",
                monitor_units / (100.0 * fraction_gy)
            ),
            Self::Hotter { shift_mm, planned_gy, shifted_gy, most } => write!(
                f,
                "with the patient moved by {}, D0.03cc of the patient is {shifted_gy:.1} Gy, {planned_gy:.1} Gy as planned \
                 (allowed: {:.0} % of that): plan static beams with `--robust`",
                axes(*shift_mm),
                100.0 * most
            ),
            Self::Uncovered { target, shift_mm, planned, shifted, most } => write!(
                f,
                "with the patient moved by {}, {:.1} % of {target} gets 95 % of its prescription; of a dose that stays in the \
                 room it would be {:.1} % (allowed loss: {:.0} %): plan static beams with `--robust`",
                axes(*shift_mm),
                100.0 * shifted,
                100.0 * planned,
                100.0 * most
            ),
            Self::Closed { angles } => {
                let angles: Vec<String> = angles.iter().map(ToString::to_string).collect();
                write!(
                    f,
                    "gantry and couch may collide at {}, which `free_angles` of the machine file does not have: give other \
                     angles, or a machine file with the free angles of your machine",
                    angles.join(", ")
                )
            }
        }
    }
}

/// What of this plan is beyond a bound; no fault where nothing is.
pub fn check(plan: &Check, bounds: &Bounds) -> Checked {
    let mut faults = Vec::new();
    let mut values = CheckValues::default();
    let delivered: f64 = plan.beams.iter().map(|beam| beam.delivered).sum();
    let part = plan.beams.iter().map(|beam| beam.outside).sum::<f64>() / delivered.max(f64::MIN_POSITIVE);
    values.outside = part;
    if !is_within(part, bounds.outside) {
        faults.push(Fault::Outside { part, most: bounds.outside });
    }
    for beam in &plan.beams {
        let Some(median) = median(&beam.weights) else { continue };
        values.medians = beam.weights.iter().fold(values.medians, |most, weight| most.max(weight / median));
        faults.extend(peak(beam, median, bounds.medians));
    }
    if let Some(monitor_units) = plan.monitor_units {
        let (fraction_gy, most) = (plan.fraction_gy, bounds.mu_per_cgy);
        values.mu_per_cgy = (fraction_gy > 0.0).then(|| monitor_units / (100.0 * fraction_gy));
        if !is_within(monitor_units, most * 100.0 * fraction_gy) {
            faults.push(Fault::Units { monitor_units, fraction_gy, most });
        }
    }
    let planned = &plan.planned;
    let hottest = worst(&plan.shifted, |moved| moved.hottest_gy);
    values.hottest = match hottest {
        Some(moved) if planned.hottest_gy > 0.0 => moved.hottest_gy / planned.hottest_gy,
        _ => 0.0,
    };
    faults.extend(
        hottest.filter(|moved| !is_within(moved.hottest_gy, bounds.hottest * planned.hottest_gy)).map(
            |moved| Fault::Hotter {
                shift_mm: moved.shift_mm,
                planned_gy: planned.hottest_gy,
                shifted_gy: moved.hottest_gy,
                most: bounds.hottest,
            },
        ),
    );
    for (at, (target, _)) in planned.covered.iter().enumerate() {
        let shifted = |moved: &CheckedDose| moved.covered.get(at).map_or(0.0, |(_, covered)| *covered);
        let of_planned = |moved: &CheckedDose| moved.of_planned.get(at).copied().unwrap_or_default();
        let lost = |moved: &CheckedDose| of_planned(moved) - shifted(moved);
        let Some(worst) = worst(&plan.shifted, lost) else { continue };
        values.uncovered = values.uncovered.max(lost(worst));
        if !is_within(lost(worst), bounds.uncovered) {
            faults.push(Fault::Uncovered {
                target: target.clone(),
                shift_mm: worst.shift_mm,
                planned: of_planned(worst),
                shifted: shifted(worst),
                most: bounds.uncovered,
            });
        }
    }
    if !plan.closed.is_empty() {
        faults.push(Fault::Closed { angles: plan.closed.clone() });
    }
    Checked { bounds: *bounds, values, faults }
}

/// The shift with the greatest value; one that is not a number, of either sign, is worse than all numbers.
fn worst(shifted: &[CheckedDose], value: impl Fn(&CheckedDose) -> f64) -> Option<&CheckedDose> {
    let rank = |moved: &CheckedDose| if value(moved).is_nan() { f64::INFINITY } else { value(moved) };
    shifted.iter().max_by(|a, b| rank(a).total_cmp(&rank(b)))
}

/// Whether a number is at most a bound; what is not a number is within nothing.
fn is_within(value: f64, most: f64) -> bool {
    value <= most
}

/// The median of the weights above zero.
fn median(weights: &[f64]) -> Option<f64> {
    let mut lit: Vec<f64> = weights.iter().copied().filter(|weight| *weight > 0.0).collect();
    lit.sort_by(f64::total_cmp);
    lit.get(lit.len() / 2).copied()
}

/// A peak is also so many times what nine of ten lit bixels do not exceed, or the mean of the bixels around it: a field
/// with a wide rim of little weight has a low median, and no peak.
const OVER_THE_OTHERS: f64 = 3.0;

/// The heaviest bixel of a beam that is above so many medians, and above the other heavy ones or its neighbours.
fn peak(beam: &CheckedBeam, median: f64, most: f64) -> Option<Fault> {
    let mut lit: Vec<f64> = beam.weights.iter().copied().filter(|weight| *weight > 0.0).collect();
    lit.sort_by(f64::total_cmp);
    let others = lit.get(lit.len().saturating_sub(1) * 9 / 10)?;
    let is_peak = |at: usize, weight: f64| {
        !is_within(weight, most * median)
            && (!is_within(weight, OVER_THE_OTHERS * others)
                || !is_within(weight, OVER_THE_OTHERS * around(beam, at).unwrap_or(f64::INFINITY)))
    };
    let all = beam.bixels_mm.iter().zip(&beam.weights).enumerate();
    let peaks: Vec<_> =
        all.filter(|(at, (_, weight))| is_peak(*at, **weight)).map(|(_, peak)| peak).collect();
    let (bixel_mm, weight) = peaks.iter().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    Some(Fault::Peak {
        angles: beam.angles,
        bixel_mm: **bixel_mm,
        weight: **weight,
        median,
        count: peaks.len(),
        most,
    })
}

/// The mean weight of the bixels next to one, corners included; `None` where there is none.
fn around(beam: &CheckedBeam, at: usize) -> Option<f64> {
    let centre = beam.bixels_mm.get(at)?;
    let distance = |bixel: &[f64; 2]| (bixel[0] - centre[0]).hypot(bixel[1] - centre[1]);
    let others = || beam.bixels_mm.iter().zip(&beam.weights).enumerate().filter(|(other, _)| *other != at);
    let nearest = others().map(|(_, (bixel, _))| distance(bixel)).fold(f64::INFINITY, f64::min);
    let next: Vec<f64> = others()
        .filter(|(_, (bixel, _))| distance(bixel) <= 1.5 * nearest)
        .map(|(_, (_, weight))| *weight)
        .collect();
    (!next.is_empty()).then(|| next.iter().sum::<f64>() / next.len() as f64)
}

/// Spacing of the grid on which doses of shifts are compared, mm.
const SPACING_MM: f64 = 4.0;

/// A plan of which a check computes what it needs.
#[derive(Clone, Copy, Debug)]
pub struct CheckedPlan<'a> {
    /// The patient.
    pub case: &'a Case,
    /// The machine.
    pub machine: &'a Machine,
    /// How dose is computed; the grid does not count.
    pub params: &'a DoseParams,
    /// The fluence as it was optimised.
    pub planned: &'a [BeamFluence],
    /// The fluence that is delivered: that of the segments where there are some.
    pub delivered: &'a [BeamFluence],
    /// Monitor units of a fraction, where the fluence is sequenced.
    pub monitor_units: Option<f64>,
    /// Where the patient lies for whom it was planned beside the planned set-up of the case, mm.
    pub moved_mm: [f64; 3],
}

impl Check {
    /// Of a plan. The doses of the shifts are computed by pencil beams on a grid of 4 mm, as that without a shift is for the comparison.
    ///
    /// # Errors
    /// Doses cannot be computed.
    pub fn of(plan: &CheckedPlan<'_>, bounds: &Bounds, threads: NonZeroUsize) -> Result<Self, DoseError> {
        let CheckedPlan { case, machine, params, moved_mm, .. } = *plan;
        // Doses of shifts are compared with each other alone, so the fast method serves.
        let params = DoseParams { engine: EngineName::Pencil, ..*params };
        let recompute = Recompute::with_spacing(case, machine.clone(), &params, SPACING_MM)?;
        let on_grid = OnGrid::new(case, recompute.grid());
        let beams = BeamFluence::weighted(plan.delivered);
        let dose = |shift_mm: [f64; 3]| {
            let place_mm = std::array::from_fn(|axis| moved_mm[axis] + shift_mm[axis]);
            recompute.dose(&beams, place_mm, threads)
        };
        let figures = |gray: &[f32]| on_grid.evaluate(gray).figures(&[]);
        let planned = dose([0.0; 3])?;
        let mut shifted = Vec::new();
        for axis in 0..3 {
            for shift in [-bounds.shift_mm, bounds.shift_mm] {
                let shift_mm: [f64; 3] = std::array::from_fn(|at| if at == axis { shift } else { 0.0 });
                let covered = CheckedDose::of(shift_mm, &figures(&dose(shift_mm)?));
                // A voxel of the moved patient is in the room where that of the planned patient was that far away.
                let in_room = |voxel: usize| {
                    let centre_mm = on_grid.grid().centre_mm(on_grid.grid().voxel(voxel));
                    let place_mm = std::array::from_fn(|at| centre_mm[at] + shift_mm[at]);
                    on_grid.grid().value_at(&planned, place_mm)
                };
                let stays: Vec<f32> = (0..planned.len()).map(in_room).collect();
                let of_planned = figures(&stays).into_iter().filter_map(|f| f.covered).collect();
                shifted.push(CheckedDose { of_planned, ..covered });
            }
        }
        let highest_gy = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let mut checked = Vec::new();
        for beam in plan.planned {
            // Beams without segments are not delivered.
            let (mut delivered, mut outside) = (0.0, 0.0);
            for given in plan.delivered.iter().filter(|given| given.angles == beam.angles) {
                let parts = recompute.parts_outside(given.angles, &given.bixels_mm, moved_mm)?;
                delivered += given.weights.iter().sum::<f64>();
                outside += given.weights.iter().zip(parts).map(|(weight, part)| weight * part).sum::<f64>();
            }
            let BeamFluence { angles, bixels_mm, weights } = beam.clone();
            checked.push(CheckedBeam { angles, bixels_mm, weights, delivered, outside });
        }
        let free = machine.free_angles();
        let is_closed = |angles: &BeamAngles| !free.iter().any(|range| range.holds(*angles));
        Ok(Self {
            closed: checked.iter().map(|beam| beam.angles).filter(is_closed).collect(),
            beams: checked,
            monitor_units: plan.monitor_units,
            fraction_gy: highest_gy / f64::from(case.fractions().unwrap_or(1)),
            planned: CheckedDose::of([0.0; 3], &figures(&planned)),
            shifted,
        })
    }
}

impl CheckedDose {
    /// Of the figures of a dose.
    pub fn of(shift_mm: [f64; 3], figures: &[StructureDose]) -> Self {
        let body = figures.iter().find(|f| f.role == Role::External);
        let covered = figures.iter().filter_map(|f| Some((f.name.clone(), f.covered?)));
        Self {
            shift_mm,
            hottest_gy: body.map_or(0.0, |f| f.d003cc_gy),
            covered: covered.collect(),
            of_planned: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dose(shift: f64, hottest_gy: f64, covered: f64) -> CheckedDose {
        let covered = vec![("PTV".into(), covered)];
        CheckedDose { shift_mm: [shift, 0.0, 0.0], hottest_gy, covered, of_planned: vec![0.9] }
    }

    fn good() -> Check {
        let beam = CheckedBeam {
            angles: 40.0.into(),
            bixels_mm: vec![[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0]],
            weights: vec![1.0, 2.0, 3.0, 0.0],
            delivered: 6.0,
            outside: 0.1,
        };
        Check {
            beams: vec![beam],
            closed: Vec::new(),
            monitor_units: Some(600.0),
            fraction_gy: 2.0,
            planned: dose(0.0, 75.0, 0.97),
            shifted: vec![dose(5.0, 78.0, 0.85), dose(-5.0, 74.0, 0.9)],
        }
    }

    #[test]
    fn a_good_plan_passes_and_each_harm_is_named_with_its_number() {
        let Checked { values, faults, .. } = check(&good(), &Bounds::default());
        assert_eq!(faults, []);
        assert_eq!((values.mu_per_cgy, values.medians), (Some(3.0), 1.5));
        assert!((values.outside - 0.1 / 6.0).abs() < 1e-12 && (values.hottest - 78.0 / 75.0).abs() < 1e-12);
        assert!((values.uncovered - 0.05).abs() < 1e-12);
        let words = |harm: &dyn Fn(&mut Check)| {
            let mut plan = good();
            harm(&mut plan);
            let faults = check(&plan, &Bounds::default()).faults;
            assert_eq!(faults.len(), 1, "{faults:?}");
            faults[0].to_string()
        };
        assert!(words(&|plan| plan.beams[0].outside = 2.22).contains("37.0 % of the fluence misses"));
        let peak = words(&|plan| plan.beams[0].weights[3] = 2432.6);
        assert!(
            peak.contains("at 40 degrees") && peak.contains("x = 30 mm") && peak.contains("2432.6"),
            "{peak}"
        );
        assert!(
            words(&|plan| plan.monitor_units = Some(14_897.0)).contains("74.5 for each cGy (allowed: 10)")
        );
        assert!(words(&|plan| plan.shifted[1].hottest_gy = 97.0).contains("moved by (-5, 0, 0) mm"));
        assert!(words(&|plan| plan.shifted[0].covered[0].1 = 0.6).contains("60.0 % of PTV"));
        let closed = words(&|plan| plan.closed = vec![[90.0, 90.0].into(), 40.0.into()]);
        assert!(closed.contains("may collide at 90@90, 40, which `free_angles`"), "{closed}");
    }

    /// A field of 9 by 9 bixels: the middle 5 by 5 of weight 10, a rim of weight 0.5.
    fn field() -> CheckedBeam {
        let places = (0..81).map(|i| [i % 9, i / 9]);
        let is_middle = |at: &[i32; 2]| at.iter().all(|k| (2..7).contains(k));
        CheckedBeam {
            angles: 40.0.into(),
            bixels_mm: places.clone().map(|at| at.map(|k| 10.0 * f64::from(k))).collect(),
            weights: places.map(|at| if is_middle(&at) { 10.0 } else { 0.5 }).collect(),
            delivered: 278.0,
            outside: 0.0,
        }
    }

    fn peaks(change: impl Fn(&mut CheckedBeam)) -> usize {
        let mut plan = good();
        plan.beams = vec![field()];
        change(&mut plan.beams[0]);
        let faults = check(&plan, &Bounds::default()).faults;
        faults.iter().map(|f| if let Fault::Peak { count, .. } = f { *count } else { 0 }).sum()
    }

    #[test]
    fn a_rim_of_little_fluence_is_no_peak_and_single_heavy_bixels_are_however_many() {
        assert_eq!(peaks(|_| ()), 0);
        assert_eq!(peaks(|beam| beam.weights[40] = 40.0), 1);
        // Each fourth bixel of the rim: more than one in ten, so nine of ten say nothing.
        let spread = |beam: &mut CheckedBeam| {
            let corners = (0..81).filter(|i| i % 9 % 2 == 0 && i / 9 % 2 == 0);
            corners.for_each(|i| beam.weights[i] = 200.0);
        };
        assert!(peaks(spread) > 8);
    }

    #[test]
    fn what_is_not_a_number_passes_no_check() {
        let faults = |harm: &dyn Fn(&mut Check)| {
            let mut plan = good();
            harm(&mut plan);
            check(&plan, &Bounds::default()).faults.len()
        };
        assert!(faults(&|plan| plan.beams[0].outside = f64::NAN) > 0);
        assert!(faults(&|plan| plan.monitor_units = Some(f64::NAN)) > 0);
        assert!(faults(&|plan| plan.beams[0].weights[0] = f64::NAN) > 0);
        // What a processor makes of zero by zero has the sign of a negative number.
        for nan in [f64::NAN, -f64::NAN] {
            assert!(faults(&|plan| plan.shifted[0].hottest_gy = nan) > 0);
            assert!(faults(&|plan| plan.shifted[0].covered[0].1 = nan) > 0);
        }
    }

    #[test]
    fn a_plan_without_fluence_or_segments_is_not_divided_by_zero() {
        let mut plan = good();
        plan.monitor_units = None;
        plan.beams[0].weights.fill(0.0);
        (plan.beams[0].delivered, plan.beams[0].outside) = (0.0, 0.0);
        let found = check(&plan, &Bounds::default());
        assert_eq!((found.faults, found.values.outside, found.values.medians), (vec![], 0.0, 0.0));
    }
}
