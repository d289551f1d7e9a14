//! Values of commands of people, with units as in a pipeline file.

use stillpoint_operator::config::near::shown;
use stillpoint_pipeline::config::quantity;
use stillpoint_pipeline::graph::Graph;
use stillpoint_samples::Verb;

use crate::exit::Failure;

/// A value in the SI unit of what it measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amount {
    /// The value.
    pub value: f64,
    /// Its SI unit, where it was written with a unit.
    pub unit: Option<&'static str>,
}

impl Amount {
    /// A number.
    pub fn plain(value: f64) -> Self {
        Self { value, unit: None }
    }

    /// Reads a number, or a quantity that one of these SI units measures.
    ///
    /// # Errors
    /// It is neither.
    pub fn read(text: &str, units: &[&'static str]) -> Result<Self, Failure> {
        if let Ok(value) = quantity::plain(text) {
            return Ok(Self::plain(value));
        }
        let measured = units.iter().find_map(|unit| Some((quantity::si(text, unit).ok()?, *unit)));
        let refused = || match units {
            [] => Failure::wrong(format!("{} is not a number: it has no unit here", shown(text))),
            units => Failure::wrong(format!(
                "{} is not a number, nor a quantity in {} or a unit of the same kind",
                shown(text),
                units.join(", ")
            )),
        };
        measured.map(|(value, unit)| Self { value, unit: Some(unit) }).ok_or_else(refused)
    }
}

/// Refuses a target whose units are not those of the channels of the operators that take it.
///
/// # Errors
/// The channel that has another unit.
pub fn fit_channels(amounts: &[Amount], graph: &Graph, console: &str) -> Result<(), Failure> {
    let port = Verb::ALL.iter().position(|(_, verb)| *verb == Verb::Target).unwrap_or_default();
    let Some(console) = graph.operator(console) else { return Ok(()) };
    for (taker, _) in graph.consumers(console, port) {
        let node = &graph.operators[taker];
        let channels = node.params.resolved["channels"].as_array();
        let channels = channels.into_iter().flatten().filter_map(|channel| channel.as_str());
        for (number, (channel, amount)) in channels.zip(amounts).enumerate() {
            let expected = if matches!(channel, "x" | "y" | "z") { "m" } else { "rad" };
            if amount.unit.is_some_and(|unit| unit != expected) {
                return Err(Failure::wrong(format!(
                    "invalid value {} of the target of {}: {channel} is in {expected} (allowed: a number in {expected}, or a \
                     quantity of its kind)",
                    number + 1,
                    node.name
                )));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use stillpoint_operator::files::DiskFiles;
    use stillpoint_pipeline::config;

    use super::*;
    use crate::pipeline_file::{EMBEDDED, EMBEDDED_FILES};

    #[test]
    fn a_target_has_the_units_of_the_channels() {
        let files = DiskFiles::next_to(std::path::Path::new("pipeline.yaml")).carrying(EMBEDDED_FILES);
        let graph = config::check(EMBEDDED, "pipeline.yaml", &[], &crate::registry(&[]), &files).unwrap();
        let fits = |texts: &[&str]| {
            let amounts: Vec<_> = texts.iter().map(|t| Amount::read(t, &["m", "rad"]).unwrap()).collect();
            fit_channels(&amounts, &graph, "console")
        };
        assert!(fits(&["14 mm", "1 deg", "0.1"]).is_ok());
        let refused = fits(&["14 mm", "1 mm", "0.1"]).err().unwrap();
        assert!(
            refused.text.contains("value 2 of the target of target: pitch is in rad"),
            "{}",
            refused.text
        );
    }

    #[test]
    fn a_value_has_the_unit_of_what_it_measures_or_none() {
        let read = |text: &str| Amount::read(text, &["m", "rad"]).map(|a| (a.value, a.unit)).ok();
        assert_eq!(read("14mm"), Some((0.014, Some("m"))));
        assert_eq!(read("-14 mm"), Some((-0.014, Some("m"))));
        assert_eq!(read("180 deg"), Some((std::f64::consts::PI, Some("rad"))));
        assert_eq!(read("0.014"), Some((0.014, None)));
        assert_eq!(read("-1e-3"), Some((-0.001, None)));
        for wrong in ["14 kg", "14 s", "mm", "", "nan", "inf", "--14"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        assert!(Amount::read("5 s", &[]).is_err());
        assert_eq!(Amount::read("0.8", &[]).unwrap(), Amount::plain(0.8));
    }
}
