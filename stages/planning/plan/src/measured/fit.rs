//! The machine that is nearest to measured curves.

use serde::Serialize;

use super::curve::{Curve, Kind, Measured, Reading, Setup, in_range};
use super::error::{FitError, MeasuredFault};
use super::lateral::{Centred, Correction, RADIUS_STEP_MM, corrected, penumbra_mm};
use super::levenberg::least_squares;
use super::residual::Residual;
use super::spectrum::{KNOTS, SERVED, Spectra, mean_energy};
use super::tank::{Beam, Tank, place, places};
use crate::dose::superposition::water::Response;
use crate::dose::{DoseError, Machine, PencilsOf, Superposition};

/// A depth dose is fitted from this multiple of the depth of its maximum on: before, electrons of the machine's head count.
const BEYOND_MAXIMUM: f64 = 1.5;
/// Fewest points of a depth dose in the fitted range.
const LEAST_POINTS: usize = 8;
/// Expected error of a point, as a part of the greatest dose.
const SIGMA: f64 = 0.003;
/// Expected size of the logarithms of the spectrum's factor, and of their second differences.
const EXPECTED: [f64; 2] = [1.5, 0.7];
/// Rounds over spectrum, penumbra and fluence.
const ROUNDS: usize = 3;
/// Largest difference of energies, MV.
const ENERGY_MV: f64 = 0.6;
/// Largest difference of calibrations, as a part.
const CALIBRATIONS: f64 = 0.02;
/// The field in which one unit of weight gives 1 Gy: its side and the depth at the isocentre, mm.
const REFERENCE_MM: f64 = 100.0;
/// Sides of a field from which on its output factor is judged, mm: in smaller ones detectors differ, too.
const JUDGED_MM: f64 = 40.0;

/// How far the machine may be from each curve, as a part of its greatest dose, and from output factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// On the axis.
    pub depth_dose: f64,
    /// On the axis, as a part of the dose at the same place.
    pub local: f64,
    /// In profiles, where the dose is at least 80 % of that on the axis.
    pub inside: f64,
    /// In profiles elsewhere.
    pub outside: f64,
    /// In steep places, this distance is allowed, too, mm.
    pub distance_mm: f64,
    /// Output factors of fields of 40 mm and more, as a part of each.
    pub output: f64,
    /// Depth from which depth doses are fitted and judged, mm; `None` is 1.5 times the depth of the maximum.
    pub from_mm: Option<f64>,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            depth_dose: 0.02,
            local: 0.03,
            inside: 0.03,
            outside: 0.04,
            distance_mm: 2.0,
            output: 0.03,
            from_mm: None,
        }
    }
}

/// The output of a field next to that of a field of 100 x 100 mm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutputResidual {
    /// What was measured.
    pub reading: Reading,
    /// The computed output factor: scatter of the water alone.
    pub computed: f64,
    /// Computed over measured, less 1: scatter of the machine's head is not modelled.
    pub difference: f64,
    /// Whether the difference is judged: in small fields it is not.
    pub is_judged: bool,
    /// Whether it is judged and beyond its bound.
    pub is_beyond: bool,
}

/// The output calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Monitor units that give the open field a fluence of weight 1.
    pub mu_per_weight: f64,
    /// Readings that it is a mean of.
    pub readings: usize,
    /// Largest difference of a reading from the mean, as a part.
    pub largest: f64,
}

/// A machine with how far it is from the curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The machine.
    pub machine: Machine,
    /// Every curve.
    pub residuals: Vec<Residual>,
    /// Every output factor.
    pub outputs: Vec<OutputResidual>,
    /// The output calibration; without readings, that of the start holds.
    pub calibration: Option<Calibration>,
    /// Mean energy of the photons at the surface: of the start, and fitted, MeV.
    pub mean_energy_mev: [f64; 2],
    /// Whether profiles determined the penumbra.
    pub has_penumbra: bool,
    /// Whether profiles determined the fluence of the open field.
    pub has_fluence: bool,
}

impl Fitted {
    /// Curves from which the machine is farther than the bounds allow.
    pub fn missed(&self) -> impl Iterator<Item = &Residual> {
        self.residuals.iter().filter(|residual| residual.beyond_mm.is_some())
    }

    /// Output factors from which the machine is farther than the bound allows.
    pub fn missed_outputs(&self) -> impl Iterator<Item = &OutputResidual> {
        self.outputs.iter().filter(|output| output.is_beyond)
    }
}

/// Fits spectrum, penumbra, fluence of the open field and output calibration of a machine with point kernels.
///
/// The machine is returned whatever its residuals are: one of which [`Fitted::missed`] names a curve, or
/// [`Fitted::missed_outputs`] an output factor, must not be used.
///
/// # Errors
/// The data are too few, contradict the machine or each other, or need another spectrum than the kernels serve.
pub fn fit(start: &Machine, measured: &Measured, bounds: Bounds) -> Result<Fitted, FitError> {
    let section = start.file().superposition.as_ref().ok_or(DoseError::NoKernels)?;
    check(start, measured)?;
    let spectra = Spectra::new(section);
    let tank = Tank::new(section, &spectra, start.file().sad_mm);
    let depth_doses = ranges(measured, bounds)?;
    deep_enough(measured, bounds)?;
    let profiles = centred(measured)?;

    let mut penumbra = start.file().penumbra_fwhm_at_iso_mm;
    let mut correction = Correction(vec![1.0, 1.0]);
    let mut has_fluence = false;
    let mut numbers = vec![0.0; KNOTS];
    for round in 0..ROUNDS {
        let fluence = |radius: f64| start.primary_fluence(radius) * correction.at(radius);
        let beam = Beam { penumbra_mm: penumbra, fluence: &fluence };
        numbers = spectrum(&tank, &spectra, &beam, &depth_doses, numbers);
        if profiles.is_empty() || round + 1 == ROUNDS {
            break;
        }
        let photons = spectra.photons(&numbers);
        let width = penumbra_mm(&tank, &beam, &profiles, &photons)
            .map_err(|fault| geometry(profiles[0].curve, fault))?;
        let beam = Beam { penumbra_mm: width, fluence: &fluence };
        let next = corrected(&tank, &beam, &profiles, &photons, &correction);
        penumbra = width;
        if let Some(next) = next {
            (correction, has_fluence) = (next, true);
        }
    }

    let photons = spectra.photons(&numbers);
    let [least, most] = SERVED;
    let position = spectra.position(&photons, 0.0);
    if !(least..=most).contains(&position) {
        let [first, last] = spectra.ends;
        let at = |position: f64| first + position * (last - first);
        return Err(FitError::Kernels { found: at(position), least: at(least), most: at(most) });
    }

    let fluence = |radius: f64| start.primary_fluence(radius) * correction.at(radius);
    let beam = Beam { penumbra_mm: penumbra, fluence: &fluence };
    let at = |setup: Setup, beam: &Beam<'_>, depth_mm: f64| {
        tank.doses_at(setup, beam, &[place(Kind::DepthDose, depth_mm)], &photons)[0]
    };
    let reference = Setup { field_mm: [REFERENCE_MM; 2], ssd_mm: start.file().sad_mm - REFERENCE_MM };
    let even = Beam { penumbra_mm: penumbra, fluence: &|_| 1.0 };
    let gray_per_mev_g = 1.0 / at(reference, &even, REFERENCE_MM);
    let gray = |reading: &Reading| gray_per_mev_g * at(reading.setup, &beam, reading.depth_mm);
    let calibration = calibrate(start, measured, gray)?;

    let residuals = measured.curves.iter().map(|curve| {
        let shift = shift_mm(curve).unwrap_or(0.0);
        let doses = tank.doses_at(curve.setup, &beam, &places(curve, shift), &photons);
        Residual::new(curve, &doses, (from_mm(curve, bounds), shift), bounds)
    });
    let residuals: Vec<Residual> = residuals.collect();
    let mean_energy_mev = [&section.photons, &photons].map(|photons| mean_energy(section, photons, 0.0));
    let outputs = outputs(measured, bounds, |reading| at(reading.setup, &beam, reading.depth_mm))?;
    let mut fitted = spectra.section(photons, &provenance(measured));
    fitted.gray_per_mev_g = format!("{gray_per_mev_g:.6}").parse().unwrap_or(gray_per_mev_g);
    let machine = machine(start, fitted, (penumbra, &correction), calibration, measured)?;
    Ok(Fitted {
        machine,
        residuals,
        outputs,
        calibration,
        mean_energy_mev,
        has_penumbra: !profiles.is_empty(),
        has_fluence,
    })
}

/// Whether data and machine may belong to each other.
fn check(start: &Machine, measured: &Measured) -> Result<(), FitError> {
    let (found, _) = *measured.energy_mv.as_ref().ok_or(FitError::NoEnergy)?;
    if (found - start.file().energy_mv).abs() > ENERGY_MV {
        return Err(FitError::Energy { found, start: start.file().energy_mv });
    }
    let sad_mm = start.file().sad_mm;
    for curve in &measured.curves {
        in_range(
            "the distance from the source to the surface",
            curve.setup.ssd_mm,
            [0.5 * sad_mm, 2.0 * sad_mm],
        )
        .map_err(|fault| geometry(curve, fault))?;
    }
    Ok(())
}

fn geometry(curve: &Curve, fault: MeasuredFault) -> FitError {
    FitError::Geometry { file: curve.file.clone(), line: curve.line, fault }
}

/// Depth from which a curve is fitted, mm.
fn from_mm(curve: &Curve, bounds: Bounds) -> f64 {
    match curve.kind {
        Kind::DepthDose => bounds.from_mm.unwrap_or(BEYOND_MAXIMUM * curve.greatest().at_mm),
        Kind::Profile { .. } => 0.0,
    }
}

/// The depth doses, each with the points that are fitted.
fn ranges(measured: &Measured, bounds: Bounds) -> Result<Vec<Curve>, FitError> {
    let mut curves = Vec::new();
    for curve in measured.curves.iter().filter(|curve| curve.kind == Kind::DepthDose) {
        let from_mm = from_mm(curve, bounds);
        let mut fitted = curve.clone();
        fitted.points.retain(|point| point.at_mm >= from_mm);
        let found = fitted.points.len();
        if found < LEAST_POINTS {
            return Err(FitError::Few { curve: curve.to_string(), found, from_mm, least: LEAST_POINTS });
        }
        curves.push(fitted);
    }
    if curves.is_empty() { Err(FitError::NoDepthDose) } else { Ok(curves) }
}

/// Whether all readings are as deep as the deepest of the places from which depth doses count.
fn deep_enough(measured: &Measured, bounds: Bounds) -> Result<(), FitError> {
    let depth_doses = measured.curves.iter().filter(|curve| curve.kind == Kind::DepthDose);
    let least = depth_doses.map(|curve| from_mm(curve, bounds)).fold(0.0, f64::max);
    let outputs = measured.outputs.iter().map(|reading| ("output factor", reading));
    let mut readings = outputs.chain(measured.calibrations.iter().map(|reading| ("calibration", reading)));
    match readings.find(|(_, reading)| reading.depth_mm < least) {
        Some((what, reading)) => Err(FitError::Shallow {
            file: reading.file.clone(),
            line: reading.line,
            what,
            found: reading.depth_mm,
            least,
        }),
        None => Ok(()),
    }
}

fn shift_mm(curve: &Curve) -> Result<f64, MeasuredFault> {
    match curve.kind {
        Kind::DepthDose => Ok(0.0),
        Kind::Profile { .. } => curve.edges().map(|[left, right]| 0.5 * (left + right)),
    }
}

fn centred(measured: &Measured) -> Result<Vec<Centred<'_>>, FitError> {
    let profiles = measured.curves.iter().filter(|curve| curve.kind != Kind::DepthDose);
    let of = |curve| {
        let shift_mm = shift_mm(curve).map_err(|fault| geometry(curve, fault))?;
        Ok(Centred { curve, shift_mm })
    };
    profiles.map(of).collect()
}

/// The numbers of the spectrum that fit the depth doses best. Each curve has a scale of its own.
fn spectrum(
    tank: &Tank<'_>,
    spectra: &Spectra<'_>,
    beam: &Beam<'_>,
    curves: &[Curve],
    start: Vec<f64>,
) -> Vec<f64> {
    let responses: Vec<Vec<Response>> =
        curves.iter().map(|curve| tank.responses(curve.setup, beam, &places(curve, 0.0))).collect();
    let residuals = |numbers: &[f64]| {
        let photons = spectra.photons(numbers);
        let mut all = Vec::new();
        for (curve, responses) in curves.iter().zip(&responses) {
            let doses = tank.doses(responses, &photons);
            let greatest = curve.greatest().value;
            let (mut both, mut square) = (0.0, 0.0);
            for (point, dose) in curve.points.iter().zip(&doses) {
                both += dose * point.value;
                square += dose * dose;
            }
            let scale = both / square;
            all.extend(
                curve
                    .points
                    .iter()
                    .zip(&doses)
                    .map(|(p, dose)| (dose * scale - p.value) / (greatest * SIGMA)),
            );
        }
        all.extend(numbers.iter().map(|number| number / EXPECTED[0]));
        all.extend(numbers.windows(3).map(|n| (n[0] - 2.0 * n[1] + n[2]) / EXPECTED[1]));
        all
    };
    least_squares(start, residuals)
}

/// Monitor units for a weight of 1, in the mean of all readings.
fn calibrate(
    start: &Machine,
    measured: &Measured,
    gray: impl Fn(&Reading) -> f64,
) -> Result<Option<Calibration>, FitError> {
    let Some(first) = measured.calibrations.first() else { return Ok(None) };
    if start.file().collimator.is_none() {
        return Err(FitError::NoCollimator);
    }
    let units: Vec<f64> = measured.calibrations.iter().map(|reading| gray(reading) / reading.value).collect();
    for (reading, units) in measured.calibrations.iter().zip(&units) {
        let found = 100.0 / units;
        if !(0.1..=10.0).contains(&found) {
            let (file, line) = (reading.file.clone(), reading.line);
            return Err(FitError::CalibrationUnit { file, line, found });
        }
    }
    let mu_per_weight = units.iter().sum::<f64>() / units.len() as f64;
    for (reading, at_second) in measured.calibrations.iter().zip(&units) {
        if (at_second / units[0] - 1.0).abs() > CALIBRATIONS {
            return Err(FitError::Calibrations {
                file: reading.file.clone(),
                first: first.line,
                at_first: units[0],
                second: reading.line,
                at_second: *at_second,
            });
        }
    }
    let largest = units.iter().map(|units| (units / mu_per_weight - 1.0).abs()).fold(0.0, f64::max);
    Ok(Some(Calibration { mu_per_weight, readings: units.len(), largest }))
}

/// Output factors by the machine.
fn outputs(
    measured: &Measured,
    bounds: Bounds,
    dose: impl Fn(&Reading) -> f64,
) -> Result<Vec<OutputResidual>, FitError> {
    let mut residuals = Vec::with_capacity(measured.outputs.len());
    for reading in &measured.outputs {
        let is_reference = |other: &&Reading| {
            other.setup.field_mm == [REFERENCE_MM; 2]
                && other.setup.ssd_mm == reading.setup.ssd_mm
                && other.depth_mm == reading.depth_mm
        };
        let reference = measured
            .outputs
            .iter()
            .find(is_reference)
            .ok_or_else(|| FitError::NoReference { file: reading.file.clone(), line: reading.line })?;
        let computed = dose(reading) / dose(reference);
        let difference = computed / (reading.value / reference.value) - 1.0;
        let is_judged = reading.setup.field_mm.iter().all(|side| *side >= JUDGED_MM);
        // NaN is beyond every bound.
        let is_beyond = is_judged && (difference.is_nan() || difference.abs() > bounds.output);
        residuals.push(OutputResidual {
            reading: reading.clone(),
            computed,
            difference,
            is_judged,
            is_beyond,
        });
    }
    Ok(residuals)
}

fn provenance(measured: &Measured) -> String {
    let mut files: Vec<&str> = measured.curves.iter().map(|curve| curve.file.as_str()).collect();
    files.sort_unstable();
    files.dedup();
    format!("Fitted by stillpoint to {} measured curves of {}.", measured.curves.len(), files.join(", "))
}

/// The start with what was fitted.
fn machine(
    start: &Machine,
    section: Superposition,
    (penumbra, correction): (f64, &Correction),
    calibration: Option<Calibration>,
    measured: &Measured,
) -> Result<Machine, FitError> {
    let mut file = start.file().clone();
    // Whoever reads a plan of this machine sees it: nothing else tells its monitor units from calibrated ones.
    let units = match calibration {
        Some(_) => "",
        None => " Its monitor units are of the start: no calibration was given.",
    };
    file.provenance = format!("{}{units} From: {}", provenance(measured), file.provenance);
    if let Some((energy_mv, _)) = measured.energy_mv {
        file.energy_mv = energy_mv;
    }
    if measured.curves.iter().any(|curve| curve.kind != Kind::DepthDose) {
        file.penumbra_fwhm_at_iso_mm = format!("{penumbra:.3}").parse().unwrap_or(penumbra);
        let mut radii: Vec<f64> = file.primary_fluence_r_mm_value.iter().map(|pair| pair[0]).collect();
        radii.extend((0..correction.0.len()).map(|node| node as f64 * RADIUS_STEP_MM));
        radii.sort_by(f64::total_cmp);
        radii.dedup();
        let at = |radius: f64| start.primary_fluence(radius) * correction.at(radius);
        let short = |value: f64| format!("{value:.5}").parse().unwrap_or(value);
        file.primary_fluence_r_mm_value =
            radii.into_iter().map(|radius| [radius, short(at(radius))]).collect();
    }
    if let (Some(calibration), Some(collimator)) = (calibration, file.collimator.as_mut()) {
        collimator.mu_per_weight = calibration.mu_per_weight;
    }
    file.superposition = Some(section);
    file.pencils_of = PencilsOf::Start;
    Ok(Machine::new(file)?)
}
