//! Samples of a head and its valves, windows of them, and what is to be predicted.

use crate::TrainError;
use stillpoint_random::Random;

/// A sample: the pose at its beginning, and the duties during it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Counted from where the run began, in parts of each channel's scale.
    pub pose: Vec<f64>,
    /// Inlet and outlet of each bladder, 0 to 1.
    pub duty: Vec<f64>,
}

/// Fewest windows to train or to validate on.
const FEWEST: usize = 50;

/// Windows of samples, with the change of the pose from the last sample of each to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Numbers of a sample.
    inputs: usize,
    /// Channels.
    outputs: usize,
    /// Samples of a window.
    window: usize,
    /// Samples one behind the other, as the network takes them.
    samples: Vec<f32>,
    /// What is to be predicted from the window that ends with each sample, as the network says it.
    changes: Vec<f32>,
    /// Root mean square of the change of each channel, in parts of its scale: what an output of 1 is.
    scale: Vec<f64>,
    /// First samples of the windows to train on.
    train: Vec<usize>,
    /// First samples of the windows to validate on: of other runs.
    validate: Vec<usize>,
}

/// Windows as a network takes them, row by row.
pub struct Batch {
    /// Windows.
    pub count: usize,
    /// For each window its samples, oldest first.
    pub inputs: Vec<f32>,
    /// What is to be predicted from each.
    pub changes: Vec<f32>,
}

impl Dataset {
    /// Windows of `window` samples of these runs. The last part of the runs, `validation`, is not trained on. Duties are
    /// taken in parts of `duty_scale`.
    ///
    /// # Errors
    /// Too little data, or a channel that never moves.
    pub fn new(
        runs: &[Vec<Sample>],
        window: usize,
        duty_scale: f64,
        validation: f64,
    ) -> Result<Self, TrainError> {
        if !(validation > 0.0 && validation < 1.0) {
            let must = "above 0 and below 1";
            return Err(TrainError::Option { what: "the part to validate on", value: validation, must });
        }
        let first = runs.iter().find_map(|r| r.first());
        let (outputs, valves) = first.map_or((0, 0), |s| (s.pose.len(), s.duty.len()));
        let (mut samples, mut changes) = (Vec::new(), Vec::new());
        let (mut train, mut validate) = (Vec::new(), Vec::new());
        let held_back = ((runs.len() as f64 * validation).round() as usize).max(1);
        let mut squares = vec![0.0; outputs];
        let mut counted = 0usize;
        for (number, run) in runs.iter().enumerate() {
            let trains = number + held_back < runs.len();
            let begin = samples.len() / (outputs + valves).max(1);
            for pair in run.windows(2) {
                samples.extend(pair[0].pose.iter().map(|v| *v as f32));
                samples.extend(pair[0].duty.iter().map(|v| (v / duty_scale) as f32));
                for (i, (next, this)) in pair[1].pose.iter().zip(&pair[0].pose).enumerate() {
                    changes.push((next - this) as f32);
                    squares[i] += if trains { (next - this) * (next - this) } else { 0.0 };
                }
                counted += usize::from(trains);
            }
            let windows = begin..(begin + run.len()).saturating_sub(window);
            if trains { &mut train } else { &mut validate }.extend(windows);
        }
        for (what, found) in [("train on", train.len()), ("validate on", validate.len())] {
            if found < FEWEST {
                return Err(TrainError::TooLittle { what, found, needed: FEWEST });
            }
        }
        let scale: Vec<f64> = squares.iter().map(|s| libm::sqrt(s / counted as f64)).collect();
        if scale.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
            return Err(TrainError::Still("pose"));
        }
        for row in changes.chunks_exact_mut(outputs) {
            row.iter_mut()
                .zip(&scale)
                .for_each(|(change, scale)| *change = (f64::from(*change) / scale) as f32);
        }
        Ok(Self { inputs: outputs + valves, outputs, window, samples, changes, scale, train, validate })
    }

    /// Numbers of a sample.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Channels.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Samples of a window.
    #[must_use]
    pub fn window(&self) -> usize {
        self.window
    }

    /// Root mean square of the change of each channel, in parts of its scale.
    #[must_use]
    pub fn scale(&self) -> &[f64] {
        &self.scale
    }

    /// Windows to train on, and to validate on.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        (self.train.len(), self.validate.len())
    }

    /// The windows to train on in a random order, in batches; what does not fill one is left out.
    pub(crate) fn batches(&self, size: usize, random: &mut Random) -> impl Iterator<Item = Batch> {
        let mut order = self.train.clone();
        random.shuffle(&mut order);
        let whole = order.len() / size * size;
        order.truncate(whole);
        (0..whole / size).map(move |i| self.batch(&order[i * size..(i + 1) * size]))
    }

    /// The windows to train on.
    #[must_use]
    pub fn training(&self) -> Batch {
        self.batch(&self.train)
    }

    /// The windows to validate on.
    #[must_use]
    pub fn validation(&self) -> Batch {
        self.batch(&self.validate)
    }

    fn batch(&self, starts: &[usize]) -> Batch {
        let mut inputs = Vec::with_capacity(starts.len() * self.window * self.inputs);
        let mut changes = Vec::with_capacity(starts.len() * self.outputs);
        for start in starts {
            inputs.extend_from_slice(&self.samples[start * self.inputs..(start + self.window) * self.inputs]);
            let last = start + self.window - 1;
            changes.extend_from_slice(&self.changes[last * self.outputs..(last + 1) * self.outputs]);
        }
        Batch { count: starts.len(), inputs, changes }
    }
}
