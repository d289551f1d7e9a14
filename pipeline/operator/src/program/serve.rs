//! The program's side: it answers what the process of a run asks about its kinds, and does the steps of one operator.

use std::any::Any;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};

use serde_json::{Value, json};
use stillpoint_samples::{Cause, Pieces, SampleKind};

use super::buffers::Buffers;
use super::wire::{Bytes, Message, receive, send};
use super::{DESCRIBE, SERVE, description, params};
use crate::activation::{Activation, ActivationInput, Consumed, RandomKey};
use crate::files::{Files, FilesError};
use crate::frames::{Frame, Frames, Rigid};
use crate::operator::ErasedOperator;
use crate::outputs::Outputs;
use crate::outside::Outside;
use crate::setup::Setup;
use crate::stage::Stage;

/// The exit code of wrong arguments.
const WRONG: u8 = 2;

/// The body of a program of operators.
#[allow(clippy::print_stdout)]
pub fn main(stages: &'static [Stage]) -> ExitCode {
    let argument = std::env::args().nth(1).unwrap_or_default();
    if argument == SERVE {
        return match serve(stages) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    if argument == DESCRIBE {
        println!("{:#}", description::to_json(stages));
        return ExitCode::SUCCESS;
    }
    let kinds: Vec<&str> = stages.iter().map(|stage| stage.kind.name).collect();
    eprintln!("This program has the kinds of operators {}.", kinds.join(", "));
    eprintln!(
        "A pipeline starts it: `use: {{ program: PATH, kind: {} }}`.",
        kinds.first().unwrap_or(&"KIND")
    );
    eprintln!("{DESCRIBE} prints the kinds with their ports and parameters.");
    ExitCode::from(WRONG)
}

/// Answers on the socket that is the standard input until the other side is gone.
fn serve(stages: &'static [Stage]) -> io::Result<()> {
    let mut socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let (sender, received) = channel();
    let mut reader = socket.try_clone()?;
    // The process of the run may end while a step never does: then this process ends, too.
    std::thread::spawn(move || {
        while let Ok(Some(message)) = receive(&mut reader) {
            if sender.send(message).is_err() {
                return;
            }
        }
        std::process::exit(0);
    });
    send(&mut socket, &description::to_json(stages), &[])?;
    let link = Mutex::new(Link { socket, received });
    let mut running = None;
    loop {
        let Some(message) = lock(&link).received.recv().ok() else { return Ok(()) };
        let (head, strings) = answer(stages, &message, &link, &mut running);
        let strings: Vec<&[u8]> = strings.iter().map(Bytes::get).collect();
        send(&mut lock(&link).socket, &head, &strings)?;
    }
}

/// The socket, and what arrived on it.
struct Link {
    socket: UnixStream,
    received: Receiver<Message>,
}

fn lock(link: &Mutex<Link>) -> std::sync::MutexGuard<'_, Link> {
    link.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// An operator that was made.
struct Running {
    step: Box<dyn ErasedOperator>,
    kinds: Vec<(&'static SampleKind, usize)>,
    laps: usize,
    stage: &'static Stage,
}

type Answer = (Value, Vec<Bytes>);

fn answer(
    stages: &'static [Stage],
    message: &Message,
    link: &Mutex<Link>,
    running: &mut Option<Running>,
) -> Answer {
    let head = &message.head;
    let stage = stages.iter().find(|stage| head["kind"] == stage.kind.name);
    let answered = catch_unwind(AssertUnwindSafe(|| match (head["op"].as_str(), stage, running) {
        (Some("params"), Some(stage), _) => (described_params(stage, head, &Asked(link)), Vec::new()),
        (Some("make"), Some(stage), running) => (make(stage, head, &Asked(link), running), Vec::new()),
        (Some("adopt"), _, Some(running)) => (adopt(running, head, &Asked(link)), Vec::new()),
        (Some("step"), _, Some(running)) => step(running, message),
        _ => (json!({ "error": "the program does not know this message" }), Vec::new()),
    }));
    answered.unwrap_or_else(|panic| (json!({ "panic": panic_text(&*panic) }), Vec::new()))
}

/// What a kind says of its parameters: their values, or the faults.
fn described_params(stage: &Stage, head: &Value, files: &dyn Files) -> Value {
    let entries = params::entries_from_json(&head["params"]);
    let read = params::read(stage, &entries, params::read_span(&head["place"]), files);
    let faults: Vec<Value> = read.faults.iter().map(params::fault).collect();
    let Some(checked) = read.checked else { return json!({ "faults": faults, "files": read.named }) };
    // Asked of the period, the rest has been answered before, and there are no files.
    let fits = match head["every"].as_u64() {
        Some(every) => (stage.validate_period)(&checked, every),
        None => (stage.validate)(&checked).and_then(|()| (stage.check_files)(&checked, files)),
    };
    let conflict = fits.err().map(|c| json!({ "params": c.params, "reason": c.reason, "help": c.help }));
    json!({
        "resolved": checked.resolved.to_string(),
        "files": read.named,
        "capacities": (stage.capacities)(&checked),
        "finishes": (stage.finishes)(&checked),
        "conflict": conflict,
    })
}

/// Makes the operator of this process.
fn make(stage: &'static Stage, head: &Value, files: &Asked<'_>, running: &mut Option<Running>) -> Value {
    let entries = params::entries_from_json(&head["params"]);
    let read = params::read(stage, &entries, params::read_span(&head["place"]), files);
    let Some(checked) = read.checked else {
        let first = read.faults.first().map_or("they cannot be read", |fault| fault.message.as_str());
        return json!({ "refused": format!("its parameters are refused: {first}") });
    };
    let frames_of = |key: &str| -> Vec<Option<String>> {
        head[key].as_array().into_iter().flatten().map(|name| name.as_str().map(str::to_owned)).collect()
    };
    let connected: Vec<bool> =
        head["connected"].as_array().into_iter().flatten().map(|c| c.as_bool().unwrap_or(false)).collect();
    let setup = Setup {
        operator: head["operator"].as_str().unwrap_or_default(),
        every: head["every"].as_u64(),
        connected: &connected,
        input_frames: &frames_of("input_frames"),
        output_frames: &frames_of("output_frames"),
        frames: &frames_from_json(&head["frames"]),
        files,
        outside: Outside::default(),
    };
    match (stage.build)(&checked, &setup) {
        Ok(step) => {
            let capacities = (stage.capacities)(&checked);
            let kinds = stage.kind.outputs.iter().enumerate();
            let kinds =
                kinds.map(|(port, o)| (o.sample, capacities.get(port).copied().unwrap_or(1))).collect();
            *running = Some(Running { step, kinds, laps: stage.laps.len(), stage });
            json!({ "made": true })
        }
        Err(refused) => json!({ "refused": refused.0 }),
    }
}

fn adopt(running: &mut Running, head: &Value, files: &Asked<'_>) -> Value {
    let entries = params::entries_from_json(&head["params"]);
    let read = params::read(running.stage, &entries, params::read_span(&head["place"]), files);
    let taken = read.checked.map(|checked| running.step.adopt(&checked));
    match taken {
        Some(Ok(())) => json!({ "adopted": true }),
        Some(Err(refused)) => json!({ "refused": refused.0 }),
        None => json!({ "refused": read.faults.first().map_or("", |fault| fault.message.as_str()) }),
    }
}

fn step(running: &mut Running, message: &Message) -> Answer {
    let head = &message.head;
    let number = |key: &str| head[key].as_u64().unwrap_or(0);
    let mut strings = message.strings.iter();
    let mut inputs = Vec::new();
    for input in head["inputs"].as_array().into_iter().flatten() {
        let mut sample = None;
        if let Some(held) = input["held"].as_bool()
            && let (Some(meta), Some(payload)) = (strings.next(), strings.next())
        {
            sample = Some(Consumed { pieces: Pieces { meta: meta.get(), payload: payload.get() }, held });
        }
        inputs.push(ActivationInput {
            sample,
            missed: input["missed"].as_u64().unwrap_or(0),
            restarted: input["restarted"].as_bool().unwrap_or(false),
        });
    }
    let activation = Activation {
        index: number("index"),
        time: number("time"),
        nominal: number("nominal"),
        tick: number("tick"),
        origin: number("origin"),
        cause: [Cause::Input, Cause::Timer, Cause::Sync]
            .into_iter()
            .find(|cause| *cause as u64 == number("cause"))
            .unwrap_or(Cause::Timer),
        port: number("port") as usize,
        inputs: &inputs,
        key: RandomKey {
            seed: number("seed"),
            operator: number("operator"),
            incarnation: number("incarnation") as u32,
        },
    };
    let mut buffers = Buffers::new(&running.kinds);
    let mut outputs = Outputs::new(&running.kinds, running.laps, &mut buffers);
    let result = running.step.step(&activation, &mut outputs);
    let report = outputs.report();
    if let Err(error) = result {
        return (json!({ "error": error.0 }), Vec::new());
    }
    if let Some(lap) = report.unknown_lap {
        return (
            json!({ "error": format!("there is no lap {lap}: LAPS names {}", running.laps) }),
            Vec::new(),
        );
    }
    let sent: Vec<usize> = buffers.stored.iter().map(|sample| sample.port).collect();
    let strings = buffers.stored.into_iter().flat_map(|sample| [sample.meta, sample.payload]).collect();
    (json!({ "sent": sent, "origin": report.origin, "finished": report.finished }), strings)
}

/// The files that parameters name, asked of the process of the run.
struct Asked<'l>(&'l Mutex<Link>);

impl Asked<'_> {
    fn ask(&self, what: &str, name: &str) -> Result<Message, FilesError> {
        let mut link = lock(self.0);
        send(&mut link.socket, &json!({ "ask": what, "name": name }), &[])?;
        let gone = || io::Error::from(io::ErrorKind::BrokenPipe);
        let message = link.received.recv().map_err(|_| gone())?;
        match message.head["error"].as_str() {
            Some(reason) => Err(FilesError::System(io::Error::other(reason.to_owned()))),
            None => Ok(message),
        }
    }
}

impl Files for Asked<'_> {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        let message = self.ask("read", name)?;
        Ok(message.strings.first().map(|bytes| bytes.get().to_vec()).unwrap_or_default())
    }

    fn shared_mode(&self, name: &str) -> Option<u32> {
        self.ask("mode", name).ok()?.head["mode"].as_u64().and_then(|mode| u32::try_from(mode).ok())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        let message = self.ask("list", name)?;
        let names = message.head["list"].as_array().into_iter().flatten();
        Ok(names.filter_map(Value::as_str).map(str::to_owned).collect())
    }
}

/// The frames of a pipeline. Numbers are sent as their bits, so that both sides have the same.
pub fn frames_to_json(frames: &Frames) -> Value {
    let bits = |numbers: &[f64]| numbers.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
    let frame = |(name, frame): (&String, &Frame)| {
        let Rigid { translation, rotation } = &frame.parent_from_frame;
        json!([name, frame.parent, bits(translation), bits(rotation.as_flattened())])
    };
    frames.placed.iter().map(frame).collect()
}

fn frames_from_json(value: &Value) -> Frames {
    let number = |value: &Value| f64::from_bits(value.as_u64().unwrap_or(0));
    let frame = |value: &Value| {
        let rigid = Rigid {
            translation: std::array::from_fn(|i| number(&value[2][i])),
            rotation: std::array::from_fn(|row| std::array::from_fn(|i| number(&value[3][3 * row + i]))),
        };
        let parent = value[1].as_str().unwrap_or_default().to_owned();
        (
            value[0].as_str().unwrap_or_default().to_owned(),
            Frame { parent, parent_from_frame: rigid, measured: None, residual: None },
        )
    };
    Frames { placed: value.as_array().into_iter().flatten().map(frame).collect() }
}

/// The words of a panic.
pub fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without words".to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::faults::Findings;
    use crate::config::tree::Value as Written;
    use crate::config::yaml;
    use crate::error::{SetupError, StepError};
    use crate::files::MemoryFiles;
    use crate::kind::{Kind, Role, Timer};
    use crate::operator::Operator;
    use crate::{ParamConflict, Params};

    #[derive(Clone, Params)]
    struct ReaderParams {
        /// A file.
        #[param(file)]
        data: String,
    }

    /// A kind that looks at a file, and takes only long periods.
    struct Reader;

    impl Operator for Reader {
        type Params = ReaderParams;
        const KIND: Kind = Kind {
            name: "my.reader",
            about: "Reads.",
            role: Role::Operator,
            inputs: &[],
            outputs: &[],
            timer: Timer::Required,
        };

        fn new(_: ReaderParams, _: &Setup<'_>) -> Result<Self, SetupError> {
            Ok(Self)
        }

        fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
            Ok(())
        }

        fn check_files(params: &ReaderParams, files: &dyn Files) -> Result<(), ParamConflict> {
            let is_full = files.read(&params.data).is_ok_and(|bytes| !bytes.is_empty());
            let conflict =
                ParamConflict { params: &["data"], reason: "it is empty".to_owned(), help: "fill it" };
            if is_full { Ok(()) } else { Err(conflict) }
        }

        fn validate_period(_: &ReaderParams, every: u64) -> Result<(), ParamConflict> {
            let conflict = ParamConflict { params: &[], reason: "too short".to_owned(), help: "wait" };
            if every >= 10 { Ok(()) } else { Err(conflict) }
        }
    }

    /// What the kind says where its file has these bytes.
    fn said(bytes: &[u8], every: Option<u64>) -> Value {
        let Written::Map(entries) = yaml::parse("data: a.bin", 0, 0, &Findings::default()).unwrap().value
        else {
            panic!("no mapping");
        };
        let files = MemoryFiles { files: [("a.bin".to_owned(), bytes.to_vec())].into() };
        let head =
            json!({ "params": params::entries_to_json(&entries), "place": [0, 0, 0, 1, 1], "every": every });
        described_params(&Stage::of::<Reader>(), &head, &files)["conflict"]["reason"].clone()
    }

    #[test]
    fn files_are_judged_with_the_parameters_and_the_period_by_itself() {
        assert_eq!(said(b"x", None), Value::Null);
        assert_eq!(said(b"", None), "it is empty");
        // The files were judged before: where the period is asked for, there are none.
        assert_eq!(said(b"", Some(10)), Value::Null);
        assert_eq!(said(b"", Some(9)), "too short");
    }
}
