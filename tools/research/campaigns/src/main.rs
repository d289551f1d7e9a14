//! `stillpoint-research`: campaigns that tune and judge the product, and the training of its networks. No campaign
//! asserts a speed.
//!
//! - `step`: the dissertation's step, with many seeds
//! - `robust`, `cases`: the same step with disturbances and faults
//! - `hold`: a head that breathes, nods and coughs, held where it is
//! - `paired_median`: two laws compared over these cases
//! - `tune`, `search`, `trials`: comparison of the laws after the same search
//! - `identity`: captures of other objects than the head of drawn patients, and the time to beam off
//! - `optimum`: methods of choosing beams against the proved optimum
//! - `acceptance`: figures of plans, compared with those of a finer grid
//! - `train`: the training of the controller's network, and of the prior of beams
//! - `course`, `laws`: one simulated closed loop and its figures; the laws that replace the law of the pipeline
//! - `monitor`, `observed`: the rules of beam and valves in a simulated run; the outputs of an activation
//! - `noise`: an operator that adds noise to poses

// `outln!` and `errln!`.
#[macro_use]
extern crate stillpoint;

mod acceptance;
mod cases;
mod course;
mod hold;
mod identity;
mod laws;
mod monitor;
mod noise;
mod observed;
mod optimum;
mod paired_median;
mod robust;
mod search;
mod step;
mod train;
mod trials;
mod tune;

use std::process::ExitCode;

use clap::builder::RangedU64ValueParser;
use clap::{Parser, Subcommand};
use stillpoint::Ended;
use stillpoint_operator::Registry;

/// Tune and judge stillpoint, and train its networks.
#[derive(Parser)]
#[command(name = "stillpoint-research", version)]
struct Arguments {
    #[command(subcommand)]
    campaign: Campaign,
}

#[derive(Subcommand)]
enum Campaign {
    Identity(identity::IdentityCampaign),
    Step(step::StepBench),
    Robust(robust::Robust),
    Hold(hold::Hold),
    Tune(tune::Tune),
    Plans(acceptance::Plans),
    Optimum(optimum::Optimum),
    Train(train::Train),
}

impl Campaign {
    fn execute(self, registry: &Registry) -> Ended {
        match self {
            Self::Identity(c) => c.execute(registry),
            Self::Step(c) => c.execute(registry),
            Self::Robust(c) => c.execute(registry),
            Self::Hold(c) => c.execute(registry),
            Self::Tune(c) => c.execute(registry),
            Self::Plans(c) => c.execute(),
            Self::Optimum(c) => c.execute(),
            Self::Train(c) => c.execute(),
        }
    }
}

fn main() -> ExitCode {
    let registry = registry();
    stillpoint::program("stillpoint-research", |arguments: Arguments| arguments.campaign.execute(&registry))
}

/// Kinds of operators of this program: those of `stillpoint`, and its own.
fn registry() -> Registry {
    stillpoint::registry(&[noise::STAGES, &[identity::camera::STAGE]])
}

/// Parser of whole numbers from `least` on.
fn at_least<T: TryFrom<u64>>(least: u64) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(least..)
}

/// A number that is not above 0.
#[derive(Debug, thiserror::Error)]
#[error("it must be a number above 0")]
struct NotPositive;

/// Parses a finite number above 0.
fn positive(text: &str) -> Result<f64, NotPositive> {
    let number = text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
    number.ok_or(NotPositive)
}
