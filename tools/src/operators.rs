//! `stillpoint operators`

use clap::Args;
use stillpoint_pipeline::operator::Registry;
use stillpoint_pipeline::spec::near::nearest;
use stillpoint_pipeline::spec::reference::{reference, reference_of};

use crate::exit::{Ended, Exit, Failure};

/// Show the kinds of operators, or one of them.
#[derive(Args)]
pub struct Operators {
    /// The kind, such as `segment.face`.
    kind: Option<String>,
    /// Print the whole reference page.
    #[arg(long)]
    all: bool,
}

impl Operators {
    /// Does it.
    pub fn execute(&self, registry: &Registry) -> Ended {
        match &self.kind {
            Some(name) => match registry.get(name) {
                Some(stage) => print!("{}", reference_of(stage)),
                None => {
                    let near = nearest(name, registry.iter().map(|s| s.kind.name));
                    let help = near.map_or_else(String::new, |n| format!("; did you mean {n}?"));
                    return Err(Failure::wrong(format!("there is no kind of operator `{name}`{help}")));
                }
            },
            None if self.all => print!("{}", reference(registry)),
            None => {
                for stage in registry.iter() {
                    println!("{:<18} {}", stage.kind.name, stage.kind.about);
                }
            }
        }
        Ok(Exit::Done)
    }
}
