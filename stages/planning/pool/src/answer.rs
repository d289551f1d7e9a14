//! Answers of calls as canonical bytes. A dose is its file.

use serde::{Deserialize, Serialize};
use stillpoint_plan::fluence::{Certificate, Plan};

use crate::message::LONGEST_CONTENT;
use crate::wire::{Format, WireError};

const PLAN: Format = Format { what: "a plan", mark: b"SPPLAN02", most: LONGEST_CONTENT as usize };
const PRICES: Format = Format { what: "prices", mark: b"SPPRIC02", most: LONGEST_CONTENT as usize };

/// A plan on the wire. serde demands that every field is named, so that a new one is thought of here.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Plan")]
struct PlanFields {
    #[serde(with = "CertificateFields")]
    certificate: Certificate,
    steps: usize,
    rounds: usize,
    weights: Vec<f64>,
    dose: Vec<f64>,
    pull: Vec<f64>,
    curvature: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Certificate")]
struct CertificateFields {
    objective: f64,
    kkt: f64,
    excess: f64,
}

#[derive(Serialize)]
struct Written<'a>(#[serde(with = "PlanFields")] &'a Plan);

#[derive(Serialize, Deserialize)]
struct Received(#[serde(with = "PlanFields")] Plan);

/// The bytes of a plan.
pub fn of_plan(plan: &Plan) -> Vec<u8> {
    PLAN.write(&Written(plan))
}

/// The plan of these bytes, for this many bixels and voxels.
///
/// # Errors
/// The bytes are no plan, or that of another problem.
pub fn plan(bytes: &[u8], bixels: Option<usize>, voxels: usize) -> Result<Plan, WireError> {
    let Received(plan) = PLAN.read(bytes)?;
    let of_voxels = [&plan.dose, &plan.pull, &plan.curvature];
    let fits = bixels.is_none_or(|bixels| plan.weights.len() == bixels)
        && of_voxels.iter().all(|list| list.len() == voxels);
    let finite = plan.weights.iter().chain(of_voxels.into_iter().flatten()).all(|number| number.is_finite());
    match fits && finite && plan.certificate.objective.is_finite() {
        true => Ok(plan),
        false => Err(WireError::Value("a plan of other beams or of numbers that are not finite")),
    }
}

/// The bytes of prices.
pub fn of_prices(prices: &[f64]) -> Vec<u8> {
    PRICES.write(prices)
}

/// The prices of these bytes, for this many candidates.
///
/// # Errors
/// The bytes are no prices, or not as many.
pub fn prices(bytes: &[u8], candidates: usize) -> Result<Vec<f64>, WireError> {
    let prices: Vec<f64> = PRICES.read(bytes)?;
    match prices.len() == candidates && prices.iter().all(|price| *price >= 0.0 && price.is_finite()) {
        true => Ok(prices),
        false => Err(WireError::Value("a list of prices of another length or of wrong numbers")),
    }
}
