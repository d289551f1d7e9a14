//! Files of the safetensors format, read.

use serde_json::{Map, Value};

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
        /// Which.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// An entry of the metadata is missing or cannot be read.
    #[error("the metadata's `{name}` {reason}; train the model with `stillpoint train controller`")]
    Metadata {
        /// Which.
        name: &'static str,
        /// What is wrong.
        reason: String,
    },
}

/// A file that is being read.
pub struct TensorFile<'a> {
    header: Map<String, Value>,
    numbers: &'a [u8],
}

impl<'a> TensorFile<'a> {
    /// Reads the header.
    ///
    /// # Errors
    /// It is no file of this format, or larger than any that is meant.
    pub fn open(bytes: &'a [u8]) -> Result<Self, TensorFileError> {
        let form = |reason: &str| TensorFileError::Form(reason.to_owned());
        if bytes.len() > GREATEST_FILE {
            return Err(form("it is larger than 16 MiB"));
        }
        let (length, rest) =
            bytes.split_first_chunk::<8>().ok_or_else(|| form("it ends before its header"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (header, numbers) = rest.split_at_checked(length).ok_or_else(|| form("its header is cut off"))?;
        let header = serde_json::from_slice(header).map_err(|e| form(&e.to_string()))?;
        let Value::Object(header) = header else { return Err(form("its header is not a JSON object")) };
        Ok(Self { header, numbers })
    }

    /// Whether there is a tensor of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.header.contains_key(name)
    }

    /// The numbers of a tensor, and its shape.
    ///
    /// # Errors
    /// It is not there, of another type, or lies outside the file.
    pub fn tensor(&self, name: &str) -> Result<(Vec<f64>, Vec<usize>), TensorFileError> {
        let wrong =
            |reason: &str| TensorFileError::Tensor { name: name.to_owned(), reason: reason.to_owned() };
        let entry = self.header.get(name).ok_or_else(|| wrong("is missing"))?;
        let whole = |v: &Value| v.as_u64().and_then(|v| usize::try_from(v).ok());
        let list =
            |key: &str| -> Option<Vec<usize>> { entry.get(key)?.as_array()?.iter().map(whole).collect() };
        let shape = list("shape").ok_or_else(|| wrong("has no shape"))?;
        let offsets = list("data_offsets").ok_or_else(|| wrong("has no offsets"))?;
        let [begin, end] = offsets[..] else { return Err(wrong("has no two offsets")) };
        let bytes = self.numbers.get(begin..end).ok_or_else(|| wrong("lies outside the file"))?;
        let values: Vec<f64> = match entry.get("dtype").and_then(Value::as_str) {
            Some("F32") => {
                bytes.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()
            }
            Some("F64") => bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            _ => return Err(wrong("is neither F32 nor F64")),
        };
        let due = shape.iter().try_fold(1_usize, |product, n| product.checked_mul(*n));
        if due != Some(values.len()) {
            return Err(wrong("does not have as many numbers as its shape says"));
        }
        Ok((values, shape))
    }

    /// An entry of the metadata.
    ///
    /// # Errors
    /// It is not there.
    pub fn text(&self, name: &'static str) -> Result<&str, TensorFileError> {
        let entry = self.header.get("__metadata__").and_then(|m| m.get(name)).and_then(Value::as_str);
        entry.ok_or_else(|| TensorFileError::Metadata { name, reason: "is missing".into() })
    }

    /// An entry of the metadata that is one number.
    ///
    /// # Errors
    /// It is not there, or no number.
    pub fn number<T: std::str::FromStr>(&self, name: &'static str) -> Result<T, TensorFileError> {
        let text = self.text(name)?;
        text.parse().map_err(|_| TensorFileError::Metadata { name, reason: format!("is no number: {text}") })
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
