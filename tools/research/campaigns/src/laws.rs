//! The laws with which a measurement replaces the law of the pipeline.

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::course::{NETWORK, RunSpec};
use stillpoint::EMBEDDED;

/// A control law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Proportional-integral control.
    Pi,
    /// Linear-quadratic control with an integrator.
    Lqg,
    /// Model-reference adaptive control.
    Mrac,
    /// Model-reference adaptive control over the features of the project's trained network.
    MracLstm,
}

impl Law {
    /// All laws.
    pub const ALL: [Self; 4] = [Self::Pi, Self::Lqg, Self::Mrac, Self::MracLstm];

    /// Kind of the operator that applies the law.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Pi => "control.pi",
            Self::Lqg => "control.lqg",
            Self::Mrac | Self::MracLstm => "control.mrac",
        }
    }
}

/// Name of the operator with a law in the default pipeline, and its law.
pub fn in_pipeline() -> (&'static str, Law) {
    let found = EMBEDDED.lines().find_map(|line| {
        let law = Law::ALL.into_iter().find(|law| line.contains(&format!("use: {}", law.kind())))?;
        Some((line.split(':').next()?.trim(), law))
    });
    found.unwrap_or(("law", Law::Pi))
}

/// Plan of the default pipeline with a law, a rise time of its reference model, and a seed for camera and person. A law
/// other than the pipeline's has its own default gains.
pub fn plan(law: Option<Law>, rise: &str, seed: u64) -> RunSpec {
    let (name, now) = in_pipeline();
    let changes = law.filter(|law| *law != now).and_then(|law| {
        let line = EMBEDDED.lines().find(|line| line.contains(&format!("use: {},", now.kind())))?;
        let (without_gains, _) = line.split_once(", params:")?;
        Some((line.to_owned(), format!("{} }}", without_gains.replace(now.kind(), law.kind()))))
    });
    let whole = RunSpec::from_camera_to_valve();
    let mut sets = vec![format!("{name}.rise={rise}"), format!("seed={seed}"), format!("rig.seed={seed}")];
    if law == Some(Law::MracLstm) {
        sets.extend([format!("{name}.features=lstm"), format!("{name}.model={}", NETWORK.0)]);
    }
    RunSpec { changes: changes.into_iter().collect(), sets: [whole.sets, sets].concat(), ..whole }
}

/// How a measurement makes its runs.
#[derive(Args, Clone, Debug, Default)]
pub struct Runs {
    /// Use a quarter of the pixels.
    #[arg(long)]
    pub small: bool,
    /// Override a parameter of the pipeline: `--set operator.param=value`.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE")]
    pub sets: Vec<String>,
    /// Number of runs at the same time.
    #[arg(long, value_parser = super::at_least::<usize>(1))]
    pub threads: Option<usize>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

impl Runs {
    /// Sets the parameters of a run: last those of the command line.
    pub fn set(&self, plan: &mut RunSpec) {
        if self.small {
            plan.sets.extend(small());
        }
        plan.sets.extend(self.sets.iter().cloned());
    }
}

/// Parameters that give the camera a quarter of its pixels.
pub fn small() -> [String; 3] {
    ["width=320 px", "height=240 px", "focal_length=283 px"].map(|set| format!("rig.camera.{set}"))
}

#[cfg(test)]
mod tests {
    use super::super::course::Course;
    use super::*;

    #[test]
    fn each_law_takes_the_pipelines_place() {
        let registry = crate::registry();
        let (name, now) = in_pipeline();
        assert!(EMBEDDED.contains(&format!("  {name}: {{ use: {},", now.kind())));
        for law in Law::ALL {
            let plan = RunSpec { seconds: 0.1, ..plan(Some(law), "20 s", 1) };
            assert_eq!(plan.changes.iter().any(|(_, to)| to.contains(law.kind())), law != now, "{law:?}");
            assert_eq!(Course::of(&plan, &registry).unwrap().failed, [] as [&str; 0], "{law:?}");
        }
    }
}
