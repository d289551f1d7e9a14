//! Hops of dora in windows that take turns with `stillpoint bench hop`. See README.md.

mod compare;
mod nodes;

use std::error::Error;

pub type Outcome = Result<(), Box<dyn Error>>;

/// What a window runs: bytes of a payload, and the time between two of them, us. As `bench hop` has them.
pub const PAYLOADS: [(usize, u64); 2] = [(64, 1000), (1_200_000, 5000)];

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["source"] => nodes::source(),
        ["sink"] => nodes::sink(),
        ["compare", stillpoint, dora, windows] => compare::run(stillpoint, dora, windows.parse()?),
        _ => Err("usage: dora-hop compare STILLPOINT DORA WINDOWS".into()),
    }
}
