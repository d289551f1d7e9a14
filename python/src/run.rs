//! A run that goes on: its topics, each sample as a copy.

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use serde_json::json;
use stillpoint::{Attached, Tap, Which};
use stillpoint_samples::SampleKind;

use crate::error::{raise, raise_failure};
use crate::registry::registry;
use crate::samples::described;

/// A run that was joined. It belongs to the thread that joined it.
#[pyclass(unsendable, name = "NativeRun", module = "stillpoint_rt._native")]
pub struct NativeRun {
    which: Which,
    attached: Attached,
    taps: Vec<(Tap, &'static SampleKind)>,
}

/// Header and body of a sample, and its elements.
type SampleBytes<'py> = (Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<u8>>);

#[pymethods]
impl NativeRun {
    /// Joins the run of this process number or pipeline; without one, the only run.
    #[new]
    #[pyo3(signature = (run))]
    fn attach(run: Option<String>) -> PyResult<Self> {
        let which = Which { run };
        let attached = which.attach(&registry(false)).map_err(raise_failure)?;
        Ok(Self { which, attached, taps: Vec::new() })
    }

    /// Process number, pipeline, session and topics, as JSON.
    fn about(&self) -> String {
        let graph = &self.attached.graph;
        let mut topics = Vec::new();
        for operator in &graph.operators {
            for (port, output) in operator.stage.kind.outputs.iter().zip(&operator.outputs) {
                topics.push(json!({
                    "name": output.topic, "operator": operator.name, "frame": output.frame, "kind": described(port.sample),
                }));
            }
        }
        json!({
            "pid": self.attached.pid, "pipeline": graph.name, "session": self.attached.session, "topics": topics,
        })
        .to_string()
    }

    /// Whether the run goes on.
    fn is_going_on(&self) -> bool {
        self.which.is_going_on(&self.attached.root)
    }

    /// Begins to receive a topic. Gives its number for `receive`, and the type of its samples as JSON.
    fn listen(&mut self, topic: &str) -> PyResult<(usize, String)> {
        let (tap, kind) = Tap::of_topic(&self.attached, topic).map_err(raise_failure)?;
        self.taps.push((tap, kind));
        Ok((self.taps.len() - 1, described(kind).to_string()))
    }

    /// The next sample of a topic, if there is one, as a copy: a sample that is held would be missing to its producer.
    fn receive<'py>(&self, py: Python<'py>, number: usize) -> PyResult<Option<SampleBytes<'py>>> {
        let (tap, kind) = self.taps.get(number).ok_or_else(|| raise("this topic is not received"))?;
        let Some(sample) = tap.next().map_err(raise_failure)? else { return Ok(None) };
        let pieces = sample.pieces().check(kind).map_err(raise)?;
        let arrays = (pieces.meta.to_vec().into_pyarray(py), pieces.payload.to_vec().into_pyarray(py));
        Ok(Some(arrays))
    }
}
