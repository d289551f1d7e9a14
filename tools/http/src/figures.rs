//! Figures in the text format of Prometheus, version 0.0.4.

use std::fmt::Write as _;

/// The first part of all names.
const PREFIX: &str = "stillpoint_";

/// The kind of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureKind {
    /// It only rises, until its program starts anew.
    Counter,
    /// It rises and falls.
    Gauge,
}

/// Figures as text.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    text: String,
    name: String,
}

impl Figures {
    /// Begins a family of figures, `stillpoint_NAME`, with its description. Values follow.
    pub fn family(&mut self, name: &str, kind: FigureKind, about: &str) -> &mut Self {
        self.name = format!("{PREFIX}{name}");
        let kind = match kind {
            FigureKind::Counter => "counter",
            FigureKind::Gauge => "gauge",
        };
        // Writing to a text cannot fail.
        let _ = writeln!(self.text, "# HELP {0} {about}\n# TYPE {0} {kind}", self.name);
        self
    }

    /// A value of the family that was begun last, with its labels. A value that is not finite is left out: it is not
    /// known.
    pub fn value(&mut self, labels: &[(&str, &str)], value: f64) -> &mut Self {
        if value.is_finite() {
            let labels: Vec<String> =
                labels.iter().map(|(name, text)| format!("{name}=\"{}\"", escaped(text))).collect();
            let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
            let _ = writeln!(self.text, "{}{labels} {value}", self.name);
        }
        self
    }

    /// The text.
    pub fn into_text(self) -> String {
        self.text
    }
}

/// A value of a label: quotes, backslashes and line ends are escaped.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_under_their_family_and_unknown_ones_are_left_out() {
        let mut figures = Figures::default();
        figures.family("calls_total", FigureKind::Counter, "Calls.").value(&[], 3.0);
        figures
            .family("age_seconds", FigureKind::Gauge, "Age.")
            .value(&[("peer", "a\"\\\n")], 0.25)
            .value(&[("peer", "b")], f64::NAN);
        let expected = "# HELP stillpoint_calls_total Calls.\n# TYPE stillpoint_calls_total counter\n\
                        stillpoint_calls_total 3\n\
                        # HELP stillpoint_age_seconds Age.\n# TYPE stillpoint_age_seconds gauge\n\
                        stillpoint_age_seconds{peer=\"a\\\"\\\\\\n\"} 0.25\n";
        assert_eq!(figures.into_text(), expected);
    }
}
