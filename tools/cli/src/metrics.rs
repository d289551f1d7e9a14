//! The figures of a run as Prometheus text, over HTTP.

use std::fmt::Write as _;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use stillpoint_pipeline::limits::start_thread;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_report::hold::Held;

use crate::exit::Failure;
use crate::http::{Request, respond};

/// The figures that clients read.
#[derive(Clone, Default)]
pub struct Metrics {
    text: Arc<Mutex<String>>,
}

impl Metrics {
    /// Serves figures at an address from now on, as long as this process lives. Gives the address with its port.
    pub fn serve(address: SocketAddr) -> Result<(Self, SocketAddr), Failure> {
        let wrong = |e: std::io::Error| {
            Failure::wrong(format!("--metrics {address}: {e}; choose another address or port"))
        };
        let listener = TcpListener::bind(address).map_err(wrong)?;
        let bound = listener.local_addr().map_err(wrong)?;
        let metrics = Self::default();
        let text = metrics.text.clone();
        // A thread of its own: a client that stalls never delays the supervisor.
        start_thread(move || {
            for client in listener.incoming().flatten() {
                let body = text.lock().map(|text| text.clone()).unwrap_or_default();
                let _ = answer(client, &body);
            }
        })
        .map_err(|e| Failure::failed(format!("the thread that serves metrics cannot be started: {e}")))?;
        Ok((metrics, bound))
    }

    /// Takes the present figures.
    pub fn update(&self, pipeline: &str, seconds: f64, operators: &[OperatorFigures], held: Option<&Held>) {
        let new = text(pipeline, seconds, operators, held);
        if let Ok(mut text) = self.text.lock() {
            *text = new;
        }
    }
}

fn answer(mut client: TcpStream, body: &str) -> std::io::Result<()> {
    let request = Request::read(&mut client)?;
    let (status, kind, body) = match (request.method.as_str(), request.path.as_str()) {
        ("GET", "/metrics" | "/") => ("200 OK", "text/plain; version=0.0.4; charset=utf-8", body),
        ("GET", _) => ("404 Not Found", "text/plain", "only /metrics is there\n"),
        _ => ("405 Method Not Allowed", "text/plain", "only GET is taken\n"),
    };
    respond(&mut client, status, kind, body.as_bytes())
}

/// A value of a label: quotes, backslashes and line ends are escaped.
fn label(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// The figures in the text format of Prometheus.
fn text(pipeline: &str, seconds: f64, operators: &[OperatorFigures], held: Option<&Held>) -> String {
    let mut out = String::new();
    let pipeline = label(pipeline);
    let _ = writeln!(out, "# HELP stillpoint_run_seconds Session time since the run began.");
    let _ = writeln!(out, "# TYPE stillpoint_run_seconds gauge");
    let _ = writeln!(out, "stillpoint_run_seconds{{pipeline=\"{pipeline}\"}} {seconds}");
    type Of = fn(&OperatorFigures) -> f64;
    let families: [(&str, &str, &str, Of); 12] = [
        ("activations_total", "counter", "Activations.", |o| o.activations as f64),
        ("samples_sent_total", "counter", "Samples sent.", |o| o.sent as f64),
        ("samples_lost_total", "counter", "Samples on the inputs that newer ones pushed out.", |o| {
            o.lost as f64
        }),
        ("ticks_missed_total", "counter", "Ticks of the timer that passed.", |o| o.missed as f64),
        ("errors_total", "counter", "Activations that returned an error.", |o| o.errors as f64),
        ("panics_total", "counter", "Activations that panicked.", |o| o.panics as f64),
        ("restarts_total", "counter", "Restarts.", |o| f64::from(o.incarnations.saturating_sub(1))),
        ("rate_hertz", "gauge", "Activations a second.", |o| o.rate_hz),
        ("step_seconds_p50", "gauge", "Median of the time of a step.", |o| o.step_ms[0] * 1e-3),
        ("step_seconds_p99", "gauge", "99 % quantile of the time of a step.", |o| o.step_ms[1] * 1e-3),
        ("age_seconds_p50", "gauge", "Median of the age of what is sent, since its acquisition.", |o| {
            o.age_ms[0] * 1e-3
        }),
        ("age_seconds_p99", "gauge", "99 % quantile of that age.", |o| o.age_ms[1] * 1e-3),
    ];
    for (name, kind, help, of) in families {
        let _ = writeln!(out, "# HELP stillpoint_{name} {help}\n# TYPE stillpoint_{name} {kind}");
        for o in operators.iter().filter(|o| of(o).is_finite()) {
            let operator = label(&o.operator);
            let _ = writeln!(
                out,
                "stillpoint_{name}{{pipeline=\"{pipeline}\",operator=\"{operator}\"}} {}",
                of(o)
            );
        }
    }
    let gates = held.map_or(&[][..], |h| &h.gates);
    let valves = held.map_or(&[][..], |h| &h.valves);
    let _ = writeln!(
        out,
        "# HELP stillpoint_beam_on Whether the beam may be on.\n# TYPE stillpoint_beam_on gauge"
    );
    for gate in gates {
        let topic = label(&gate.topic);
        let _ = writeln!(
            out,
            "stillpoint_beam_on{{pipeline=\"{pipeline}\",topic=\"{topic}\"}} {}",
            u8::from(gate.on)
        );
    }
    let _ = writeln!(
        out,
        "# HELP stillpoint_valve_faults_total Faults of actuation.\n# TYPE stillpoint_valve_faults_total counter"
    );
    for v in valves {
        let topic = label(&v.topic);
        let _ = writeln!(
            out,
            "stillpoint_valve_faults_total{{pipeline=\"{pipeline}\",topic=\"{topic}\"}} {}",
            v.faults
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    fn figures(name: &str) -> OperatorFigures {
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
            Metrics::serve(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap_or_else(|e| panic!("{}", e.text));
        metrics.update("head-3dof", 2.5, &[figures("face"), figures("law")], None);
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
