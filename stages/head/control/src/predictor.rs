//! The trained predictor (4.39) as a file: a network and the meaning of its numbers.
//!
//! The file is in the safetensors format, so that Python and other programs read it too: eight bytes with the length of a
//! JSON header, the header, the numbers. What the numbers mean stands in the header's `__metadata__`.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use crate::channels::{Channel, Channels};
use crate::lstm::{Layer, Lstm, NetworkError};
use crate::tensor_file::{TensorFile, TensorFileError};

/// Version of the metadata.
const VERSION: &str = "1";
const MOST_LAYERS: usize = 16;

/// A network that predicts how a pose changes within one sample time, or several.
///
/// A sample that goes in has the pose, counted from where control began, in parts of `scale`, then for each bladder the
/// duties of its inlet and outlet, in parts of `duty_scale`. What comes out is the change of the pose for each time
/// ahead, in parts of `scale * change`. Without bladders it predicts what a patient does, and the pose is counted from the
/// newest sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    network: Lstm,
    meaning: Meaning,
}

/// What a network's numbers mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Meaning {
    /// The channels of the pose.
    pub channels: Channels,
    /// Scale of each channel, m or rad.
    pub scale: Vec<f64>,
    /// Root mean square of the change of each channel in the training data, in parts of its scale; for each time ahead.
    pub change: Vec<f64>,
    /// How many samples ahead the changes are predicted.
    pub ahead: Vec<usize>,
    /// Scale of the duties.
    pub duty_scale: f64,
    pub bladders: usize,
    /// From sample to sample, ns.
    pub sample_time: u64,
    /// Samples that the network goes over from an empty memory.
    pub window: usize,
}

/// Why a file is refused.
#[derive(Debug, thiserror::Error)]
pub enum PredictorError {
    /// The file, or what it says.
    #[error(transparent)]
    File(#[from] TensorFileError),
    /// The numbers do not make a network.
    #[error(transparent)]
    Network(#[from] NetworkError),
}

impl Predictor {
    /// A network with the meaning of its numbers.
    ///
    /// # Errors
    /// They do not fit each other, or a scale is not above zero.
    pub fn new(network: Lstm, meaning: Meaning) -> Result<Self, PredictorError> {
        let metadata =
            |name, reason: String| PredictorError::File(TensorFileError::Metadata { name, reason });
        let n = meaning.channels.count();
        if meaning.ahead.is_empty() || meaning.ahead.iter().any(|a| !(1..=1000).contains(a)) {
            return Err(metadata("ahead", "must have numbers from 1 to 1000".into()));
        }
        let outputs = n * meaning.ahead.len();
        for (name, scale, n) in [("scale", &meaning.scale, n), ("change", &meaning.change, outputs)] {
            if scale.len() != n || scale.iter().any(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(metadata(name, format!("must have {n} numbers above 0")));
            }
        }
        if !(meaning.duty_scale.is_finite() && meaning.duty_scale > 0.0) {
            return Err(metadata("duty_scale", "must be a number above 0".into()));
        }
        if !(1..=3_600_000_000_000).contains(&meaning.sample_time) {
            return Err(metadata("sample_time_ns", "must be from 1 ns to 1 h".into()));
        }
        if !(1..=1000).contains(&meaning.window) {
            return Err(metadata("window", "must be from 1 to 1000".into()));
        }
        if meaning.bladders > 8 {
            return Err(metadata("bladders", "must be at most 8".into()));
        }
        for (name, found, expected) in [
            ("the network's inputs", network.inputs(), n + 2 * meaning.bladders),
            ("the network's outputs", network.outputs(), outputs),
        ] {
            if found != expected {
                return Err(NetworkError::Size { what: name.into(), found, expected }.into());
            }
        }
        Ok(Self { network, meaning })
    }

    #[must_use]
    pub fn network(&self) -> &Lstm {
        &self.network
    }

    /// The channels of the pose.
    #[must_use]
    pub fn channels(&self) -> &Channels {
        &self.meaning.channels
    }

    /// Scale of each channel, m or rad.
    #[must_use]
    pub fn scale(&self) -> &[f64] {
        &self.meaning.scale
    }

    /// What an output of 1 is, in parts of each channel's scale.
    #[must_use]
    pub fn change(&self) -> &[f64] {
        &self.meaning.change
    }

    /// Scale of the duties.
    #[must_use]
    pub fn duty_scale(&self) -> f64 {
        self.meaning.duty_scale
    }

    #[must_use]
    pub fn bladders(&self) -> usize {
        self.meaning.bladders
    }

    /// From sample to sample, s.
    #[must_use]
    pub fn sample_time(&self) -> f64 {
        self.meaning.sample_time as f64 * 1e-9
    }

    /// Samples that the network goes over from an empty memory.
    #[must_use]
    pub fn window(&self) -> usize {
        self.meaning.window
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`PredictorError`].
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, PredictorError> {
        let file = TensorFile::open(bytes)?;
        let mut layers = Vec::new();
        while layers.len() < MOST_LAYERS && file.has(&format!("lstm.{}.bias", layers.len())) {
            let name = |part: &str| format!("lstm.{}.{part}", layers.len());
            let (w_ih, shape) = file.tensor(&name("weight_ih"))?;
            let inputs = shape.get(1).copied().unwrap_or(0);
            layers.push(Layer::new(
                inputs,
                w_ih,
                file.tensor(&name("weight_hh"))?.0,
                file.tensor(&name("bias"))?.0,
            )?);
        }
        let network = Lstm::new(layers, file.tensor("output.weight")?.0, file.tensor("output.bias")?.0)?;
        Self::new(network, Meaning::of(&file)?)
    }

    /// The file, with numbers of four bytes, and `more` beside the metadata. It is written here, and not by the
    /// `safetensors` crate, because that one writes the metadata in the order of a hash map: the same network would make
    /// other bytes in each run.
    #[must_use]
    pub fn to_safetensors(&self, more: &BTreeMap<String, String>) -> Vec<u8> {
        let mut header = Map::new();
        let listed = |v: &[f64]| v.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
        let names: Vec<&str> = self.meaning.channels.iter().map(Channel::name).collect();
        let mut metadata: BTreeMap<&str, String> =
            more.iter().map(|(k, v)| (k.as_str(), v.clone())).collect();
        metadata.extend([
            ("stillpoint_predictor", VERSION.to_owned()),
            ("channels", names.join(",")),
            ("scale", listed(&self.meaning.scale)),
            ("change", listed(&self.meaning.change)),
            ("duty_scale", self.meaning.duty_scale.to_string()),
            ("bladders", self.meaning.bladders.to_string()),
            ("sample_time_ns", self.meaning.sample_time.to_string()),
            ("window", self.meaning.window.to_string()),
        ]);
        if self.meaning.ahead != [1] {
            let ahead: Vec<String> = self.meaning.ahead.iter().map(ToString::to_string).collect();
            metadata.insert("ahead", ahead.join(","));
        }
        header.insert("__metadata__".into(), json!(metadata));
        let mut numbers = Vec::new();
        for (name, shape, values) in self.network.tensors() {
            let begin = numbers.len();
            numbers.extend(values.iter().flat_map(|v| (*v as f32).to_le_bytes()));
            let entry = json!({ "dtype": "F32", "shape": shape, "data_offsets": [begin, numbers.len()] });
            header.insert(name, entry);
        }
        let mut header = Value::Object(header).to_string().into_bytes();
        // The format wants the numbers to begin at a multiple of eight.
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header);
        bytes.extend(numbers);
        bytes
    }
}

impl Meaning {
    fn of(file: &TensorFile<'_>) -> Result<Self, TensorFileError> {
        let version = file.text("stillpoint_predictor")?;
        if version != VERSION {
            let reason = format!("is {version}; this build reads version {VERSION}");
            return Err(TensorFileError::Metadata { name: "stillpoint_predictor", reason });
        }
        let wrong = |name, reason: String| TensorFileError::Metadata { name, reason };
        let names = file.text("channels")?.split(',');
        let channels: Option<Vec<Channel>> = names.map(Channel::named).collect();
        let channels =
            channels.ok_or_else(|| wrong("channels", "names a channel that does not exist".into()))?;
        // Files of the first programs have no times ahead: they predict the next sample.
        let ahead: Result<_, _> = file.text("ahead").unwrap_or("1").split(',').map(str::parse).collect();
        let ahead = ahead.map_err(|_| wrong("ahead", "is not a list of whole numbers".into()))?;
        Ok(Self {
            channels: Channels::new(&channels)
                .map_err(|e| wrong("channels", format!("cannot be used: {e}")))?,
            scale: file.numbers("scale")?,
            change: file.numbers("change")?,
            ahead,
            duty_scale: file.number("duty_scale")?,
            bladders: file.number("bladders")?,
            sample_time: file.number("sample_time_ns")?,
            window: file.number("window")?,
        })
    }
}
