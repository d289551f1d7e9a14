//! The file from which a training resumes: numbers, moments of the optimiser, passes.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::adam::Adam;
use super::training::{Options, Pass};
use crate::TrainError;

const ENTRY: &str = "stillpoint_planner_training";

/// A training between two passes.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// What is trained on.
    pub about: String,
    /// The options that it runs with.
    pub options: Options,
    pub passes: Vec<Pass>,
    pub numbers: Vec<Vec<f32>>,
    pub adam: Adam,
}

#[derive(Serialize, Deserialize)]
struct Header {
    about: String,
    options: Options,
    passes: Vec<Pass>,
    steps: u64,
    tensors: usize,
}

impl Checkpoint {
    /// Writes it under another name, and then renames it.
    pub fn write(&self, path: &Path) -> Result<(), TrainError> {
        let fault = |why: String| TrainError::File { path: path.to_owned(), why };
        let header = Header {
            about: self.about.clone(),
            options: self.options.clone(),
            passes: self.passes.clone(),
            steps: self.adam.steps,
            tensors: self.numbers.len(),
        };
        let text = serde_json::to_string(&header).map_err(|e| fault(e.to_string()))?;
        let kinds = [("numbers", &self.numbers), ("first", &self.adam.first), ("second", &self.adam.second)];
        let mut all: Vec<(String, usize, Vec<u8>)> = Vec::new();
        for (kind, tensors) in kinds {
            for (place, values) in tensors.iter().enumerate() {
                let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                all.push((format!("{kind}.{place:02}"), values.len(), bytes));
            }
        }
        let views = all
            .iter()
            .map(|(name, len, bytes)| {
                Ok((
                    name.clone(),
                    TensorView::new(Dtype::F32, vec![*len], bytes).map_err(|e| fault(e.to_string()))?,
                ))
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        let bytes = safetensors::serialize(views, Some(HashMap::from([(ENTRY.to_owned(), text)])))
            .map_err(|e| fault(e.to_string()))?;
        let part = path.with_extension("part");
        std::fs::write(&part, bytes)
            .and_then(|()| std::fs::rename(&part, path))
            .map_err(|e| fault(e.to_string()))
    }

    pub fn read(path: &Path) -> Result<Self, TrainError> {
        let fault = |why: String| TrainError::File { path: path.to_owned(), why };
        let bytes = std::fs::read(path).map_err(|e| fault(e.to_string()))?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| fault(e.to_string()))?;
        let text = header.metadata().as_ref().and_then(|entries| entries.get(ENTRY));
        let text = text
            .ok_or_else(|| fault("it is not a checkpoint of `stillpoint-research train planner`".into()))?;
        let header: Header = serde_json::from_str(text).map_err(|e| fault(e.to_string()))?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| fault(e.to_string()))?;
        let read = |kind: &str| -> Result<Vec<Vec<f32>>, TrainError> {
            let one = |place: usize| {
                let view = tensors.tensor(&format!("{kind}.{place:02}")).map_err(|e| fault(e.to_string()))?;
                Ok(view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
            };
            (0..header.tensors.min(1000)).map(one).collect()
        };
        let adam = Adam { first: read("first")?, second: read("second")?, steps: header.steps };
        let numbers = read("numbers")?;
        let Header { about, options, passes, .. } = header;
        Ok(Self { about, options, passes, numbers, adam })
    }
}
