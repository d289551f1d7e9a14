//! The figures of a run as Prometheus text.

use stillpoint_http::{FigureKind, Figures};
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_report::hold::Held;

/// Name, kind, description and value of a family of figures of operators.
type Family = (&'static str, FigureKind, &'static str, fn(&OperatorFigures) -> f64);

/// The families of operators.
const FAMILIES: [Family; 12] = {
    use FigureKind::{Counter, Gauge};
    [
        ("activations_total", Counter, "Activations.", |o| o.activations as f64),
        ("samples_sent_total", Counter, "Samples sent.", |o| o.sent as f64),
        ("samples_lost_total", Counter, "Samples on the inputs that newer ones pushed out.", |o| {
            o.lost as f64
        }),
        ("ticks_missed_total", Counter, "Ticks of the timer that passed.", |o| o.missed as f64),
        ("errors_total", Counter, "Activations that returned an error.", |o| o.errors as f64),
        ("panics_total", Counter, "Activations that panicked.", |o| o.panics as f64),
        ("restarts_total", Counter, "Restarts.", |o| f64::from(o.incarnations.saturating_sub(1))),
        ("rate_hertz", Gauge, "Activations a second.", |o| o.rate_hz),
        ("step_seconds_p50", Gauge, "Median of the time of a step.", |o| o.step_ms[0] * 1e-3),
        ("step_seconds_p99", Gauge, "99 % quantile of the time of a step.", |o| o.step_ms[1] * 1e-3),
        ("age_seconds_p50", Gauge, "Median of the age of what is sent, since its acquisition.", |o| {
            o.age_ms[0] * 1e-3
        }),
        ("age_seconds_p99", Gauge, "99 % quantile of that age.", |o| o.age_ms[1] * 1e-3),
    ]
};

/// The figures of a run.
pub fn figures(pipeline: &str, seconds: f64, operators: &[OperatorFigures], held: Option<&Held>) -> Figures {
    let mut figures = Figures::default();
    figures
        .family("run_seconds", FigureKind::Gauge, "Session time since the run began.")
        .value(&[("pipeline", pipeline)], seconds);
    for (name, kind, about, of) in FAMILIES {
        figures.family(name, kind, about);
        for o in operators {
            figures.value(&[("pipeline", pipeline), ("operator", &o.operator)], of(o));
        }
    }
    figures.family("beam_on", FigureKind::Gauge, "Whether the beam may be on.");
    for gate in held.map_or(&[][..], |h| &h.gates) {
        figures.value(&[("pipeline", pipeline), ("topic", &gate.topic)], f64::from(u8::from(gate.on)));
    }
    figures.family("valve_faults_total", FigureKind::Counter, "Faults of actuation.");
    for v in held.map_or(&[][..], |h| &h.valves) {
        figures.value(&[("pipeline", pipeline), ("topic", &v.topic)], v.faults as f64);
    }
    figures
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{SocketAddr, TcpStream};

    use stillpoint_http::Metrics;

    use super::*;

    fn of(name: &str) -> OperatorFigures {
        OperatorFigures {
            operator: name.into(),
            activations: 100,
            rate_hz: 10.0,
            errors: 1,
            panics: 0,
            incarnations: 3,
            sent: 98,
            sent_by_output: vec![98],
            lost: 3,
            ticks: 0,
            missed: 0,
            step_ms: [12.0, 20.0],
            age_ms: [f64::NAN; 2],
        }
    }

    /// One request, and the answer.
    fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap_or_else(|e| panic!("{e}"));
        stream.write_all(request.as_bytes()).unwrap_or_else(|e| panic!("{e}"));
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap_or_else(|e| panic!("{e}"));
        answer
    }

    #[test]
    fn a_client_reads_families_with_their_type_and_a_value_for_each_operator() {
        let (metrics, address) =
            Metrics::serve(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap_or_else(|e| panic!("{e}"));
        metrics.update(super::figures("head-3dof", 2.5, &[of("face"), of("law")], None));
        let answer = ask(address, "GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n");
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{answer}"));
        assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains("version=0.0.4"), "{head}");
        for line in [
            "# TYPE stillpoint_samples_sent_total counter",
            "stillpoint_samples_sent_total{pipeline=\"head-3dof\",operator=\"face\"} 98",
            "stillpoint_restarts_total{pipeline=\"head-3dof\",operator=\"law\"} 2",
            "stillpoint_step_seconds_p50{pipeline=\"head-3dof\",operator=\"law\"} 0.012",
        ] {
            assert!(body.lines().any(|l| l == line), "{line} is not in\n{body}");
        }
        // What is not known has no value.
        assert!(!body.contains("NaN") && !body.contains("age_seconds_p50{"), "{body}");
        // Each family is declared before its values, once.
        let declared: Vec<&str> = body.lines().filter_map(|l| l.strip_prefix("# TYPE ")).collect();
        let names: std::collections::BTreeSet<&str> =
            declared.iter().filter_map(|l| l.split(' ').next()).collect();
        assert_eq!(names.len(), declared.len());
        for line in body.lines().filter(|l| !l.starts_with('#')) {
            assert!(names.contains(line.split('{').next().unwrap_or("")), "{line}");
        }
        assert!(ask(address, "GET /other HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert!(ask(address, "POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405"));
    }
}
