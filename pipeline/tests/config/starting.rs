//! What the start of an operator refuses, the check of a run refuses with its line.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Activation, Operator, Outputs, Params, Registry, Setup};
use stillpoint_operator::{Kind, Role, SetupError, Stage, StepError, Timer};
use stillpoint_pipeline::config::{Code, Faults, Machine, check, check_for};

#[derive(Clone, Params)]
pub struct ReaderParams {
    /// Files of models.
    #[param(files = "*.model")]
    pub models: String,
    /// Layers that are expected.
    #[param(default = 3, min = 1, max = 9)]
    pub layers: u64,
}

/// Takes models of as many bytes as layers are expected, and not more than five layers.
struct Reader;

impl Operator for Reader {
    type Params = ReaderParams;
    const KIND: Kind = Kind {
        name: "test.reader",
        about: "Reads models.",
        role: Role::Source,
        inputs: &[],
        outputs: &[],
        timer: Timer::Required,
    };

    fn new(params: ReaderParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        assert!(params.layers != 9, "nine layers");
        if params.layers > 5 {
            return Err(SetupError(format!("{} layers are more than 5", params.layers)));
        }
        for name in setup.files.list(&params.models).map_err(|e| SetupError(e.to_string()))? {
            let length = setup.file(&name)?.len() as u64;
            if length != params.layers {
                return Err(SetupError(format!("{name}: it has {length} layers, not {}", params.layers)));
            }
        }
        Ok(Self)
    }

    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}

fn registry() -> Registry {
    Registry::new(&[&[Stage::of::<Reader>()]])
}

fn text(models: &str, layers: u64) -> String {
    format!(
        "stillpoint: 1\nname: start\noperators:\n  good: {{ use: test.reader, every: 1 s, params: {{ models: ok.model }} }}\n  \
         bad:\n    use: test.reader\n    every: 1 s\n    params:\n      layers: {layers}\n      models: {models}\n"
    )
}

fn files() -> MemoryFiles {
    let files =
        [("ok.model", "abc"), ("short.model", "a"), ("folder/1.model", "abc"), ("folder/2.model", "")];
    MemoryFiles { files: files.map(|(name, bytes)| (name.to_owned(), bytes.into())).into() }
}

fn refused(models: &str, layers: u64) -> Faults {
    let text = text(models, layers);
    // A session of it can be opened, and a replay says what it lacks.
    assert!(check(&text, "x.yaml", &[], &registry(), &files()).is_ok());
    check_for(&Machine::here(), &text, "x.yaml", &[], &registry(), &files()).err().unwrap()
}

#[test]
fn a_file_that_the_start_refuses_is_a_fault_where_its_name_is() {
    for (models, reason) in [
        ("short.model", "short.model: it has 1 layers, not 3"),
        ("folder/*.model", "folder/2.model: it has 0 layers, not 3"),
    ] {
        let faults = refused(models, 3);
        assert_eq!(faults.list().iter().map(|f| f.code).collect::<Vec<_>>(), [Code::FileMissing], "{faults}");
        let expected = format!("x.yaml:10:15: `bad` (test.reader) cannot start: {reason}");
        assert!(faults.to_string().starts_with(&expected), "{faults}");
    }
}

#[test]
fn parameters_that_the_start_refuses_are_a_fault_of_their_operator() {
    for (layers, reason) in
        [(7, "7 layers are more than 5"), (9, "it panicked while it was made: nine layers")]
    {
        let faults = refused("ok.model", layers);
        assert_eq!(faults.list().iter().map(|f| f.code).collect::<Vec<_>>(), [Code::OutOfRange], "{faults}");
        let expected = format!("x.yaml:5:3: `bad` (test.reader) cannot start: {reason}");
        assert!(faults.to_string().starts_with(&expected), "{faults}");
    }
}

#[test]
fn what_starts_is_no_fault() {
    let text = text("ok.model", 3);
    assert!(check_for(&Machine::here(), &text, "x.yaml", &[], &registry(), &files()).is_ok());
}
