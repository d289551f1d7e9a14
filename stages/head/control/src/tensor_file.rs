//! Tensors and metadata of a safetensors file, as numbers of eight bytes, with errors that name the entry.

use safetensors::tensor::{Dtype, Metadata, SafeTensors};

/// Greatest file that is read: a network of a thousand times as many numbers as the dissertation's.
const GREATEST_FILE: usize = 16 << 20;

/// Why a file is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TensorFileError {
    /// It is no file of this format.
    #[error("it is not a safetensors file: {0}")]
    Form(String),
    /// A tensor is not there, or of another form.
    #[error("the tensor `{name}` {reason}")]
    Tensor {
        /// Name of the entry.
        name: String,
        /// Description of the fault.
        reason: String,
    },
    /// An entry of the metadata is missing or cannot be read.
    #[error("the metadata's `{name}` {reason}; train the model with `stillpoint-research train controller`")]
    Metadata {
        /// Name of the entry.
        name: &'static str,
        /// Description of the fault.
        reason: String,
    },
}

/// A file that is being read.
pub struct TensorFile<'a> {
    header: Metadata,
    tensors: SafeTensors<'a>,
}

impl<'a> TensorFile<'a> {
    /// Reads the header and checks that the tensors fill the rest of the file.
    ///
    /// # Errors
    /// It is no file of this format, or larger than any that is meant.
    pub fn open(bytes: &'a [u8]) -> Result<Self, TensorFileError> {
        if bytes.len() > GREATEST_FILE {
            return Err(TensorFileError::Form("it is larger than 16 MiB".into()));
        }
        let form = |e: safetensors::SafeTensorError| TensorFileError::Form(e.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(form)?;
        Ok(Self { header, tensors: SafeTensors::deserialize(bytes).map_err(form)? })
    }

    /// Whether there is a tensor of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.header.info(name).is_some()
    }

    /// The numbers of a tensor, and its shape.
    ///
    /// # Errors
    /// It is not there, or its numbers are no floating-point numbers of four or eight bytes.
    pub fn tensor(&self, name: &str) -> Result<(Vec<f64>, Vec<usize>), TensorFileError> {
        let wrong =
            |reason: &str| TensorFileError::Tensor { name: name.to_owned(), reason: reason.to_owned() };
        let view = self.tensors.tensor(name).map_err(|_| wrong("is missing"))?;
        let bytes = view.data();
        let values = match view.dtype() {
            Dtype::F32 => {
                bytes.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()
            }
            Dtype::F64 => bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            _ => return Err(wrong("is neither F32 nor F64")),
        };
        Ok((values, view.shape().to_vec()))
    }

    /// An entry of the metadata.
    ///
    /// # Errors
    /// It is not there.
    pub fn text(&self, name: &'static str) -> Result<&str, TensorFileError> {
        let entry = self.header.metadata().as_ref().and_then(|entries| entries.get(name));
        entry
            .map(String::as_str)
            .ok_or_else(|| TensorFileError::Metadata { name, reason: "is missing".into() })
    }

    /// An entry of the metadata that is one number.
    ///
    /// # Errors
    /// It is not there, or no number.
    pub fn number<T: std::str::FromStr>(&self, name: &'static str) -> Result<T, TensorFileError> {
        let text = self.text(name)?;
        text.parse()
            .map_err(|_| TensorFileError::Metadata { name, reason: format!("is not a number: {text}") })
    }

    /// An entry of the metadata that is numbers with commas between them.
    ///
    /// # Errors
    /// It is not there, or no such list.
    pub fn numbers(&self, name: &'static str) -> Result<Vec<f64>, TensorFileError> {
        let text = self.text(name)?;
        let wrong =
            |_| TensorFileError::Metadata { name, reason: format!("is not a list of numbers: {text}") };
        text.split(',').map(|v| v.parse().map_err(wrong)).collect()
    }
}
