//! From the source of a class to a kind of operator.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use stillpoint_operator::{DescribeError, Files, Stage};

use super::declared::Declared;

/// What stands between the file and the class.
const BETWEEN: &str = ".py:";
/// The module that loads sources and describes their classes.
const MODULE: &str = "stillpoint_rt._describe";

/// Sources by name.
pub type Sources = BTreeMap<String, Vec<u8>>;

type Described = BTreeMap<String, (Sources, Stage)>;

/// The kinds that were described, by name, with the sources that they read. The memory of a description is not given
/// back, so the same sources are described once.
static DESCRIBED: Mutex<Described> = Mutex::new(BTreeMap::new());

/// Describes the class that a name such as `ops/speed.py:Speed` stands for. The source is executed.
pub fn describe(name: &str, files: &dyn Files) -> Option<Result<Stage, DescribeError>> {
    let path = path_of(name)?;
    Some(described(name, path, files))
}

/// Refuses the class of a pipeline that a session keeps, because its source is code of someone else; unless this process
/// has run the same source already, as after a run that it records.
pub fn refuse_recorded(name: &str, files: &dyn Files) -> Option<Result<Stage, DescribeError>> {
    let path = path_of(name)?;
    if let Ok(sources) = sources_next_to(path, files)
        && let Some(stage) = known(&lock(), name, &sources)
    {
        return Some(Ok(stage));
    }
    Some(Err(DescribeError {
        reason: format!("`{name}` is code that the session keeps, and it is not run unasked"),
        help: "read it, and if you trust it, give --trust before the command, or `Session(path, trust=True)`"
            .to_owned(),
    }))
}

fn lock() -> MutexGuard<'static, Described> {
    DESCRIBED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The kind that these sources were described as.
fn known(all: &Described, name: &str, sources: &Sources) -> Option<Stage> {
    let (read, stage) = all.get(name)?;
    read.iter().all(|(file, bytes)| sources.get(file) == Some(bytes)).then_some(*stage)
}

fn path_of(name: &str) -> Option<&str> {
    let at = name.find(BETWEEN)?;
    Some(&name[..at + BETWEEN.len() - 1])
}

fn described(name: &str, path: &str, files: &dyn Files) -> Result<Stage, DescribeError> {
    let sources = sources_next_to(path, files)?;
    let mut all = lock();
    if let Some(stage) = known(&all, name, &sources) {
        return Ok(stage);
    }
    let found = Python::attach(|py| -> PyResult<String> {
        let module = py.import(MODULE)?;
        module.call_method1("describe", (name, in_python(py, &sources)?))?.extract()
    });
    let found = found.map_err(|e| fault(format!("`{name}` cannot be described: {e}")))?;
    let (declared, read) = Declared::of(name, &found).map_err(|reason| DescribeError {
        reason,
        help: "correct the class; `docs/guide/python.md` shows one".to_owned(),
    })?;
    let read = sources.into_iter().filter(|(file, _)| read.contains(file)).collect();
    let stage = declared.stage()?;
    all.insert(name.to_owned(), (read, stage));
    Ok(stage)
}

/// The sources in the folder of a file.
fn sources_next_to(path: &str, files: &dyn Files) -> Result<Sources, DescribeError> {
    let pattern = match path.rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/*.py"),
        None => "*.py".to_owned(),
    };
    let mut sources = Sources::new();
    for file in files.list(&pattern).unwrap_or_default() {
        if let Ok(bytes) = files.read(&file) {
            sources.insert(file, bytes);
        }
    }
    if sources.contains_key(path) {
        return Ok(sources);
    }
    let reason =
        files.read(path).err().map_or_else(|| "it is not among its files".to_owned(), |e| e.to_string());
    Err(DescribeError {
        reason: format!("{path} cannot be read: {reason}"),
        help: "write the path of the source from the folder of the pipeline file".to_owned(),
    })
}

/// Sources as a dict from names to bytes.
pub fn in_python<'py>(py: Python<'py>, sources: &Sources) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (file, bytes) in sources {
        dict.set_item(file, PyBytes::new(py, bytes))?;
    }
    Ok(dict)
}

/// A fault of the description that is not one of the class.
pub fn fault(reason: String) -> DescribeError {
    DescribeError { reason, help: "the package stillpoint-rt may be damaged: install it anew".to_owned() }
}
