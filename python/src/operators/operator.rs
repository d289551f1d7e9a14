//! One incarnation of an operator in Python, behind the trait of all operators.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use stillpoint_operator::activation::ActivationInput;
use stillpoint_operator::params::CheckedParams;
use stillpoint_operator::{Activation, AdoptError, ErasedOperator, Outputs, Setup, SetupError, StepError};
use stillpoint_pipeline::live::end_worker;
use stillpoint_samples::{Cause, Pieces};

use super::declared::{Declared, Values};
use super::describe::{Sources, in_python};
use super::lend::{Loan, lend};

/// The module of the part that is written in Python.
const MODULE: &str = "stillpoint_rt._runner";

/// Whether the samples of inputs are lent to a step, not copied for it.
static LENDS: AtomicBool = AtomicBool::new(false);

/// Lends samples of inputs to steps from now on. Only a worker of a run does: there, a step that keeps an array ends
/// the process, and the run goes on by its restart policy. In any other process arrays are copies.
pub fn lend_inputs() {
    LENDS.store(true, Ordering::Relaxed);
}

/// An operator whose steps are those of a Python object.
pub struct PythonOperator {
    /// `stillpoint_rt._runner.Runner` over the object.
    runner: Py<PyAny>,
    declared: &'static Declared,
    /// Name in the pipeline.
    operator: String,
    lends: bool,
}

/// Bytes of header and body, and of the elements.
type SampleArrays<'py> = (Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<u8>>);
/// A sample that a step sends: number of the output, header and body, elements.
type Sent<'py> = (usize, PyReadonlyArray1<'py, u8>, PyReadonlyArray1<'py, u8>);

impl PythonOperator {
    /// Loads the sources of the class and makes an object of it.
    pub fn new(values: &Values, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let declared = values.declared;
        let mut sources = Sources::new();
        for source in &declared.sources {
            sources.insert(source.clone(), setup.file(source)?);
        }
        let params = serde_json::Value::Object(values.values.clone()).to_string();
        let frames = |frames: &[Option<String>]| frames.to_vec();
        let made = Python::attach(|py| -> PyResult<Result<Py<PyAny>, String>> {
            let module = py.import(MODULE)?;
            let made = module.call_method1(
                "make",
                (
                    declared.name,
                    in_python(py, &sources)?,
                    params,
                    setup.operator,
                    setup.every,
                    setup.connected.to_vec(),
                    frames(setup.input_frames),
                    frames(setup.output_frames),
                ),
            )?;
            Ok(match made.extract::<String>() {
                Ok(fault) => Err(fault),
                Err(_) => Ok(made.unbind()),
            })
        });
        let runner = made.map_err(|e| SetupError(format!("{}: {e}", declared.name)))?.map_err(SetupError)?;
        let (operator, lends) = (setup.operator.to_owned(), LENDS.load(Ordering::Relaxed));
        Ok(Self { runner, declared, operator, lends })
    }

    /// Does a step; the error is the description of an exception.
    fn stepped(
        &self,
        py: Python<'_>,
        activation: &Activation<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Result<Result<(), StepError>, String> {
        lend(
            py,
            |loan| {
                self.call(py, loan, activation, outputs).map_err(|raised| {
                    let described = self.runner.call_method1(py, "explain", (raised.into_value(py),));
                    let text = described.and_then(|text| text.extract::<String>(py));
                    text.unwrap_or_else(|e| format!("{}: {e}", self.declared.name))
                })
            },
            || {
                let place = self.runner.getattr(py, "place").and_then(|place| place.extract::<String>(py));
                let place = place.unwrap_or_else(|_| self.declared.name.to_owned());
                end_worker(
                    &self.operator,
                    &format!(
                        "{place}: an array of an input is still held after activation {}, and its memory is given back: store \
                     a copy (`array.copy()`)",
                        activation.index
                    ),
                )
            },
        )
    }

    fn call<'b>(
        &self,
        py: Python<'_>,
        loan: &Loan<'b>,
        activation: &Activation<'b>,
        outputs: &mut Outputs<'_>,
    ) -> PyResult<Result<(), StepError>> {
        let mut inputs = Vec::with_capacity(activation.inputs.len());
        for input in activation.inputs {
            inputs.push((
                self.arrays(py, loan, input)?,
                input.sample.is_some_and(|s| s.held),
                input.missed,
                input.restarted,
            ));
        }
        let port = (activation.cause == Cause::Input)
            .then(|| self.declared.inputs().get(activation.port).map(|input| input.name))
            .flatten();
        let key = activation.key;
        let moment =
            (activation.index, activation.time, activation.nominal, activation.tick, activation.origin);
        let answer = self
            .runner
            .bind(py)
            .call_method1("step", (moment, port, inputs, (key.seed, key.operator, key.incarnation)))?;
        let (sent, is_finished): (Vec<Sent<'_>>, bool) = answer.extract()?;
        for (port, meta, payload) in &sent {
            let pieces = Pieces { meta: meta.as_slice()?, payload: payload.as_slice()? };
            if let Err(refused) = outputs.send_pieces(*port, pieces) {
                return Ok(Err(refused));
            }
        }
        if is_finished {
            outputs.finish();
        }
        Ok(Ok(()))
    }

    fn arrays<'b, 'py>(
        &self,
        py: Python<'py>,
        loan: &Loan<'b>,
        input: &ActivationInput<'b>,
    ) -> PyResult<Option<SampleArrays<'py>>> {
        let Some(sample) = input.sample else { return Ok(None) };
        let Pieces { meta, payload } = sample.pieces;
        if !self.lends {
            // As read-only as lent ones, so that a simulated run refuses what a live one does.
            let copied = [meta, payload].map(|bytes| {
                let array = bytes.to_vec().into_pyarray(py);
                array.readwrite().make_nonwriteable();
                array
            });
            return Ok(Some(copied.into()));
        }
        Ok(Some((loan.array(py, meta)?, loan.array(py, payload)?)))
    }
}

impl ErasedOperator for PythonOperator {
    fn adopt(&mut self, _: &CheckedParams) -> Result<(), AdoptError> {
        Err(AdoptError(format!("{} takes no changes while it runs", self.declared.name)))
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        // An exception leaves an object in an unknown state, as a panic does: the operator begins anew.
        Python::attach(|py| self.stepped(py, activation, outputs))
            .unwrap_or_else(|text| resume_unwind(Box::new(text)))
    }
}
