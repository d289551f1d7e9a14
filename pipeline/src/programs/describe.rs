//! From a program to a kind of operator.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use stillpoint_operator::config::faults::Code;
use stillpoint_operator::config::near::{listed, nearest, shown};
use stillpoint_operator::config::source::Span;
use stillpoint_operator::config::tree::Entry;
use stillpoint_operator::files::Files;
use stillpoint_operator::params::{CheckedParams, ParamReader, verify};
use stillpoint_operator::program::description::{Described, from_json};
use stillpoint_operator::program::params::{add_fault, entries_to_json, span};
use stillpoint_operator::{DescribeError, Kind, ParamConflict, SetupError, Stage};

use super::operator::ProgramOperator;
use super::process::Program;

/// What stands between the path of a program and the name of a kind.
const BETWEEN: char = ':';

/// Time in which a program has to say what it thinks of parameters; it may look at large files.
const ANSWER: Duration = Duration::from_secs(60);

/// Whether programs that sessions keep are started.
static TRUSTS: AtomicBool = AtomicBool::new(false);

/// The programs that were asked for their kinds, by path, with the hash of their bytes. The memory of a description is not given
/// back, so that the same program is asked once.
static DESCRIBED: Mutex<BTreeMap<String, Known>> = Mutex::new(BTreeMap::new());

struct Known {
    hash: [u8; 32],
    kinds: BTreeMap<String, Stage>,
}

/// The name of a kind of a program in a pipeline.
pub fn name_of(program: &str, kind: &str) -> String {
    format!("{program}{BETWEEN}{kind}")
}

/// A kind of a program.
pub struct Declared {
    /// The program.
    pub program: Arc<Program>,
    /// Its name in the program.
    pub kind: &'static str,
    /// Name, ports and parameters.
    pub described: Described,
}

/// Parameters that a kind of a program has taken.
pub struct Given {
    /// The kind.
    pub declared: &'static Declared,
    /// The parameters as the config gives them.
    pub entries: Vec<Entry>,
    /// Where one that is missing is reported.
    pub place: Span,
    capacities: Vec<usize>,
    finishes: bool,
    conflict: Option<Conflict>,
}

#[derive(Clone)]
struct Conflict {
    params: Vec<String>,
    reason: String,
    help: String,
}

/// Starts programs that sessions keep from now on: whoever says so has looked at where a session comes from.
pub fn trust_recorded() {
    TRUSTS.store(true, Ordering::Relaxed);
}

/// Describes the kind of a program that a name such as `./my_op:my.smoother` stands for. The program is started.
pub fn describe(name: &str, files: &dyn Files) -> Option<Result<Stage, DescribeError>> {
    let (path, kind) = parts(name)?;
    Some(described(path, kind, files))
}

/// Refuses the program of a pipeline that a session keeps, because it is code of someone else; unless this process has
/// started the same program already, or sessions are trusted.
pub fn refuse_recorded(name: &str, files: &dyn Files) -> Option<Result<Stage, DescribeError>> {
    let (path, kind) = parts(name)?;
    if TRUSTS.load(Ordering::Relaxed) {
        return Some(described(path, kind, files));
    }
    if let Ok(bytes) = files.read(path)
        && let Some(known) = lock().get(path).filter(|known| known.hash == hash(&bytes))
        && let Some(stage) = known.kinds.get(kind)
    {
        return Some(Ok(*stage));
    }
    Some(Err(DescribeError {
        reason: format!("{} is a program that the session keeps, and it is not started unasked", shown(path)),
        help: "if you trust where the session comes from, give --trust before the subcommand: `stillpoint --trust replay ...`"
            .to_owned(),
    }))
}

fn parts(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once(BETWEEN).filter(|(path, _)| !path.ends_with(".py"))
}

fn lock() -> MutexGuard<'static, BTreeMap<String, Known>> {
    DESCRIBED.lock().unwrap_or_else(PoisonError::into_inner)
}

fn hash(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

fn described(path: &str, kind: &str, files: &dyn Files) -> Result<Stage, DescribeError> {
    let refused = |reason: String, help: &str| DescribeError { reason, help: help.to_owned() };
    let bytes = files.read(path).map_err(|e| {
        let help =
            "write its path from the folder of the pipeline file, and build it: `cargo build --release`";
        refused(format!("the program {} cannot be read: {e}", shown(path)), help)
    })?;
    let hash = hash(&bytes);
    let mut all = lock();
    if all.get(path).is_none_or(|known| known.hash != hash) {
        let kinds = kinds(path, &bytes).map_err(|reason| {
            let help = "name a program that `stillpoint new operator` made; its argument --describe prints its kinds";
            refused(format!("{} describes no operators: {reason}", shown(path)), help)
        })?;
        all.insert(path.to_owned(), Known { hash, kinds });
    }
    let kinds = all.get(path).map(|known| &known.kinds);
    kinds.and_then(|kinds| kinds.get(kind)).copied().ok_or_else(|| {
        let names = || kinds.into_iter().flatten().map(|(name, _)| name.as_str());
        let help = nearest(kind, names()).map(|near| format!("did you mean `{near}`?"));
        DescribeError {
            reason: format!("the program {} has no kind {}", shown(path), shown(kind)),
            help: help.unwrap_or_else(|| listed(names(), "kinds")),
        }
    })
}

/// The kinds of a program, by their names in it.
fn kinds(path: &str, bytes: &[u8]) -> Result<BTreeMap<String, Stage>, Box<dyn std::error::Error>> {
    let program = Arc::new(Program::of(path, bytes)?);
    let (_, description) = program.start()?;
    let mut kinds = BTreeMap::new();
    for described in from_json(&description)? {
        let kind = described.kind.name;
        let name: &'static str = name_of(path, kind).leak();
        let described = Described { kind: Kind { name, ..described.kind }, ..described };
        let declared: &'static Declared =
            Box::leak(Box::new(Declared { program: program.clone(), kind, described }));
        let stage = stage(declared);
        verify(&stage)?;
        kinds.insert(kind.to_owned(), stage);
    }
    Ok(kinds)
}

fn stage(declared: &'static Declared) -> Stage {
    Stage {
        kind: declared.described.kind,
        laps: &[],
        wire: None,
        fields: declared.described.fields,
        described: Some(declared),
        read,
        validate: |checked| {
            given(checked).and_then(|given| given.conflict.clone()).map_or(Ok(()), |c| Err(conflict(&c)))
        },
        validate_period: |checked, every| {
            let Some(given) = given(checked) else { return Ok(()) };
            let found = match asked(given.declared, &given.entries, given.place, Some(every), &NoFiles) {
                Ok(answer) => read_conflict(&answer),
                Err(reason) => Some(Conflict {
                    params: Vec::new(),
                    reason: format!("it cannot judge its period: {reason}"),
                    help: "see what the program printed".to_owned(),
                }),
            };
            found.map_or(Ok(()), |found| Err(conflict(&found)))
        },
        validate_input: |_, _, _| Ok(()),
        check_files: |_, _| Ok(()),
        cut_files: |_, _| Ok(BTreeMap::new()),
        remarks: |_, _| Vec::new(),
        capacities: |checked| given(checked).map(|given| given.capacities.clone()).unwrap_or_default(),
        subscriptions: |_| Vec::new(),
        listens: |_| None,
        finishes: |checked| given(checked).is_some_and(|given| given.finishes),
        build: |checked, setup| {
            let given = given(checked).ok_or_else(|| {
                SetupError("the parameters are those of another kind: check the pipeline again".to_owned())
            })?;
            Ok(Box::new(ProgramOperator::new(given, setup)?))
        },
    }
}

fn given(checked: &CheckedParams) -> Option<&Given> {
    checked.value.downcast_ref::<Given>()
}

/// Lets the program read the parameters: it knows their types.
fn read(stage: &Stage, reader: &mut ParamReader<'_>) -> Option<CheckedParams> {
    let declared = stage.described?.downcast_ref::<Declared>()?;
    let (entries, place) = (reader.given().to_vec(), reader.place());
    let answer = asked(declared, &entries, place, None, reader.files())
        .map_err(|reason| {
            let message =
                format!("{} cannot read its parameters: {reason}", shown(declared.described.kind.name));
            reader.findings().say(place, Code::UnknownKind, message, "see what the program printed");
        })
        .ok()?;
    reader.reads(&declared.program.path);
    for name in answer["files"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        reader.reads(name);
    }
    answer["faults"].as_array().into_iter().flatten().for_each(|fault| add_fault(fault, reader.findings()));
    let resolved: Value = serde_json::from_str(answer["resolved"].as_str()?).ok()?;
    let counts = answer["capacities"].as_array().into_iter().flatten();
    let given = Given {
        declared,
        entries,
        place,
        capacities: counts.filter_map(|n| n.as_u64().and_then(|n| usize::try_from(n).ok())).collect(),
        finishes: answer["finishes"].as_bool().unwrap_or(false),
        conflict: read_conflict(&answer),
    };
    reader.keep(resolved.clone());
    Some(CheckedParams { value: Arc::new(given), resolved, given: reader.given().into() })
}

/// What a kind says of its parameters.
fn asked(
    declared: &'static Declared,
    entries: &[Entry],
    place: Span,
    every: Option<u64>,
    files: &dyn Files,
) -> std::io::Result<Value> {
    let (mut process, _) = declared.program.start()?;
    process.answers_within(ANSWER)?;
    let question = json!({
        "op": "params", "kind": declared.kind, "params": entries_to_json(entries), "place": span(place), "every": every,
    });
    let answer = process.ask(&question, &[], files)?.head;
    match answer["panic"].as_str().or(answer["error"].as_str()) {
        Some(reason) => Err(std::io::Error::other(reason.to_owned())),
        None => Ok(answer),
    }
}

fn read_conflict(answer: &Value) -> Option<Conflict> {
    let conflict = answer["conflict"].as_object()?;
    let text = |key: &str| conflict.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let params = conflict.get("params").and_then(Value::as_array).into_iter().flatten();
    let params = params.filter_map(Value::as_str).map(str::to_owned).collect();
    Some(Conflict { params, reason: text("reason"), help: text("help") })
}

/// A conflict in the form of all kinds, whose words live as long as the process.
fn conflict(conflict: &Conflict) -> ParamConflict {
    let words = conflict.params.iter().map(|name| &*name.clone().leak());
    ParamConflict {
        params: words.collect::<Vec<&'static str>>().leak(),
        reason: conflict.reason.clone(),
        help: conflict.help.clone().leak(),
    }
}

/// No files.
struct NoFiles;

impl Files for NoFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, stillpoint_operator::FilesError> {
        self.list(name).map(|_| Vec::new())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, stillpoint_operator::FilesError> {
        Ok(vec![name.to_owned()])
    }
}
