//! The model file: safetensors, with the widths in its metadata.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};

use crate::eye::{PAIR, STRUCTURE, TARGET};
use crate::groups::Group;
use crate::model::{Model, ModelError, Sizes};

/// The network that comes with the project; its card is `planner.md` beside it.
const SHIPPED: &[u8] = include_bytes!("../data/planner.safetensors");
/// Greatest file that is read.
const GREATEST_FILE: usize = 5 << 20;
/// The entry of the metadata: version, number of features, widths.
const ENTRY: &str = "stillpoint_planner";
const VERSION: u32 = 2;

#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Meaning {
    version: u32,
    features: [usize; 3],
    sizes: Sizes,
    /// Groups of features that the network was trained without.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    without: Vec<Group>,
}

/// Why a file is refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum ModelFileError {
    /// It is no file of this format.
    #[error("it is not a safetensors file: {0}")]
    Form(String),
    /// It is not of this network.
    #[error(
        "its metadata has no `{ENTRY}` that this build reads ({0}); train the model with `stillpoint-research train planner`"
    )]
    Meaning(String),
    /// A tensor is not there, or of another form.
    #[error("the tensor `{name}` {reason}")]
    Tensor {
        /// Name of the entry.
        name: String,
        /// Description of the fault.
        reason: String,
    },
    /// The numbers make no network.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Model {
    /// The network that comes with the project.
    ///
    /// # Errors
    /// None: a test reads it.
    pub fn shipped() -> Result<Self, ModelFileError> {
        Self::from_safetensors(SHIPPED)
    }

    /// Reads a model file.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, ModelFileError> {
        if bytes.len() > GREATEST_FILE {
            return Err(ModelFileError::Form("it is larger than 5 MiB".into()));
        }
        let form = |e: safetensors::SafeTensorError| ModelFileError::Form(e.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(form)?;
        let entry = header.metadata().as_ref().and_then(|entries| entries.get(ENTRY));
        let text = entry.ok_or_else(|| ModelFileError::Meaning("it is missing".into()))?;
        let meaning: Meaning =
            serde_json::from_str(text).map_err(|e| ModelFileError::Meaning(e.to_string()))?;
        if meaning.version != VERSION {
            let why = format!("version {}, and this build reads {VERSION}", meaning.version);
            return Err(ModelFileError::Meaning(why));
        }
        if meaning.features != [TARGET, STRUCTURE, PAIR] {
            let why = format!(
                "{:?} features, and this build has {:?}",
                meaning.features,
                [TARGET, STRUCTURE, PAIR]
            );
            return Err(ModelFileError::Meaning(why));
        }
        if !meaning.sizes.are_sound() {
            return Err(ModelError::Sizes(meaning.sizes).into());
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(form)?;
        let expected = meaning.sizes.tensors();
        if let Some(name) =
            tensors.names().into_iter().find(|name| !expected.iter().any(|(expected, _)| expected == name))
        {
            return Err(ModelFileError::Tensor {
                name: (*name).to_owned(),
                reason: "is none of the network's".into(),
            });
        }
        let read = |(name, shape): (&'static str, Vec<usize>)| {
            let wrong = |reason: String| ModelFileError::Tensor { name: name.to_owned(), reason };
            let view = tensors.tensor(name).map_err(|_| wrong("is missing".into()))?;
            if view.dtype() != Dtype::F32 {
                return Err(wrong(format!("is {:?}, and F32 is expected", view.dtype())));
            }
            if view.shape() != shape {
                return Err(wrong(format!("has the shape {:?}, and {shape:?} is expected", view.shape())));
            }
            Ok(view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
        };
        let numbers = expected.into_iter().map(read).collect::<Result<Vec<Vec<f32>>, _>>()?;
        let model = Self::new(meaning.sizes, numbers)?;
        if model.without() != meaning.without {
            let names = |groups: &[Group]| match groups {
                [] => "no features".to_owned(),
                some => some.iter().map(|group| group.name()).collect::<Vec<_>>().join(", "),
            };
            let why = format!(
                "it says that {} are left out, and its scales leave out {}",
                names(&meaning.without),
                names(&model.without())
            );
            return Err(ModelFileError::Meaning(why));
        }
        Ok(model)
    }

    /// SHA-256 of the model file, in hexadecimal digits.
    ///
    /// # Errors
    /// As [`to_safetensors`](Self::to_safetensors).
    pub fn hash(&self) -> Result<String, ModelFileError> {
        Ok(Sha256::digest(self.to_safetensors()?).iter().map(|b| format!("{b:02x}")).collect())
    }

    /// The bytes of the model file: the same for the same numbers.
    pub fn to_safetensors(&self) -> Result<Vec<u8>, ModelFileError> {
        let (features, without) = ([TARGET, STRUCTURE, PAIR], self.without());
        let meaning = Meaning { version: VERSION, features, sizes: self.sizes(), without };
        let text = serde_json::to_string(&meaning).map_err(|e| ModelFileError::Meaning(e.to_string()))?;
        let form = |e: safetensors::SafeTensorError| ModelFileError::Form(e.to_string());
        let bytes: Vec<Vec<u8>> = self
            .numbers()
            .iter()
            .map(|values| values.iter().flat_map(|v| v.to_le_bytes()).collect())
            .collect();
        let views = self.sizes().tensors().into_iter().zip(&bytes);
        let views = views
            .map(|((name, shape), bytes)| {
                Ok((name, TensorView::new(Dtype::F32, shape, bytes).map_err(form)?))
            })
            .collect::<Result<Vec<_>, ModelFileError>>()?;
        safetensors::serialize(views, Some(HashMap::from([(ENTRY.to_owned(), text)]))).map_err(form)
    }
}
