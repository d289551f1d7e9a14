//! Answers of calls as canonical bytes.
//!
//! A plan: `SPPLAN01`, objective, violation and excess of its certificate, steps, rounds, then weights, doses, slopes and
//! curvatures. Prices: `SPPRIC01` and the numbers. A dose is its file.

use stillpoint_plan::fluence::{Certificate, Plan};

use crate::wire::{Reader, WireError, Writer};

const PLAN: &[u8; 8] = b"SPPLAN01";
const PRICES: &[u8; 8] = b"SPPRIC01";

/// The bytes of a plan.
pub fn of_plan(plan: &Plan) -> Vec<u8> {
    // Every field is named, so that a new one is thought of here.
    let Plan { weights, dose, certificate, pull, curvature, steps, rounds } = plan;
    let Certificate { objective, kkt, excess } = certificate;
    let mut out = Writer(PLAN.to_vec());
    [objective, kkt, excess].into_iter().for_each(|number| out.real(*number));
    out.number(*steps as u64);
    out.number(*rounds as u64);
    [weights, dose, pull, curvature].into_iter().for_each(|list| out.reals(list));
    out.0
}

/// The plan of these bytes, for this many bixels and voxels.
///
/// # Errors
/// The bytes are no plan, or that of another problem.
pub fn plan(bytes: &[u8], bixels: Option<usize>, voxels: usize) -> Result<Plan, WireError> {
    let mut from = Reader::new(bytes);
    if from.raw(8, "a plan")? != PLAN {
        return Err(WireError::Unknown("the version of a plan"));
    }
    let certificate = Certificate {
        objective: from.real("the objective")?,
        kkt: from.real("the violation")?,
        excess: from.real("the excess")?,
    };
    let (steps, rounds) = (from.number("the steps")? as usize, from.number("the rounds")? as usize);
    let plan = Plan {
        certificate,
        steps,
        rounds,
        weights: from.reals("the weights")?,
        dose: from.reals("the doses")?,
        pull: from.reals("the slopes")?,
        curvature: from.reals("the curvatures")?,
    };
    from.end()?;
    let of_voxels = [&plan.dose, &plan.pull, &plan.curvature];
    let fits = bixels.is_none_or(|bixels| plan.weights.len() == bixels)
        && of_voxels.iter().all(|list| list.len() == voxels);
    let finite = plan.weights.iter().chain(of_voxels.into_iter().flatten()).all(|number| number.is_finite());
    match fits && finite && certificate.objective.is_finite() {
        true => Ok(plan),
        false => Err(WireError::Unknown("a plan of other beams or of numbers that are not finite")),
    }
}

/// The bytes of prices.
pub fn of_prices(prices: &[f64]) -> Vec<u8> {
    let mut out = Writer(PRICES.to_vec());
    out.reals(prices);
    out.0
}

/// The prices of these bytes, for this many candidates.
///
/// # Errors
/// The bytes are no prices, or not as many.
pub fn prices(bytes: &[u8], candidates: usize) -> Result<Vec<f64>, WireError> {
    let mut from = Reader::new(bytes);
    if from.raw(8, "prices")? != PRICES {
        return Err(WireError::Unknown("the version of prices"));
    }
    let prices = from.reals("the prices")?;
    from.end()?;
    match prices.len() == candidates && prices.iter().all(|price| *price >= 0.0 && price.is_finite()) {
        true => Ok(prices),
        false => Err(WireError::Unknown("a list of prices of another length or of wrong numbers")),
    }
}
