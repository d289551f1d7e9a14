//! The changes of parameters in the script of a console: each names a live parameter, and its value is checked as one of the
//! file.

use super::document::Document;
use super::faults::{Code, Findings};
use super::near::{shown, suggestion};
use super::wiring::Wired;
use crate::console::{ConsoleParams, KIND_NAME};
use crate::params::{CheckedParams, changed};

/// Checks them.
pub fn check(
    document: &Document<'_>,
    wired: &[Wired],
    checked: &[(Option<CheckedParams>, Vec<String>)],
    findings: &Findings,
) {
    for (number, operator) in document.operators.iter().enumerate() {
        let is_console = wired[number].stage.as_ref().is_some_and(|stage| stage.kind.name == KIND_NAME);
        let params = checked.get(number).and_then(|(params, _)| params.as_ref()).filter(|_| is_console);
        let Some(console) = params.and_then(|p| p.value.downcast_ref::<ConsoleParams>()) else { continue };
        let span = operator.params.map_or(operator.name.span, |params| params.span);
        for (path, value) in console.settings() {
            let Some((name, parameter)) = path.split_once('.') else { continue };
            let Some(&of) = document.numbers().get(name) else {
                let names = document.operators.iter().map(|o| o.name.value.as_str());
                let help = suggestion(name, names, "operators", findings);
                let message =
                    format!("the script changes {}, and there is no operator {}", shown(path), shown(name));
                findings.say(span.first(1), Code::UnknownOperator, message, help);
                continue;
            };
            let (Some(stage), Some((Some(params), _))) = (&wired[of].stage, checked.get(of)) else {
                continue;
            };
            if let Err(reason) = changed(stage, params, parameter, value) {
                let message = format!("the script cannot change {}: {reason}", shown(path));
                findings.say(
                    span.first(1),
                    Code::OutOfRange,
                    message,
                    "change or remove that line of `script`",
                );
            }
        }
    }
}
