//! Samples of a head and its valves, windows of them, and what is to be predicted.

use crate::TrainError;
use stillpoint_mechanics::random::Random;

/// A sample: the pose at its beginning, and the duties during it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Counted from where the run began, in parts of each channel's scale.
    pub pose: Vec<f64>,
    /// Inlet and outlet of each bladder, 0 to 1.
    pub duty: Vec<f64>,
}

/// How windows are cut from runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Samples of a window.
    pub window: usize,
    /// How many samples behind the last of a window the poses to be predicted are.
    pub ahead: Vec<usize>,
    /// From the first sample of a window to that of the next.
    pub every: usize,
    /// Duties are taken in parts of this.
    pub duty_scale: f64,
    /// Whether the poses of a window are counted from its last one, and not from the beginning of the run.
    pub from_newest: bool,
    /// The part of the runs that is not trained on, but chooses the epoch.
    pub validation: f64,
    /// The part of the runs, the last ones, that neither trains nor chooses.
    pub test: f64,
}

impl Default for Cut {
    fn default() -> Self {
        Self {
            window: 6,
            ahead: vec![1],
            every: 1,
            duty_scale: 0.1,
            from_newest: false,
            validation: 0.2,
            test: 0.0,
        }
    }
}

/// Fewest windows to train or to validate on.
const FEWEST: usize = 50;

/// Windows of samples, with the changes of the pose from the last sample of each to later ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Numbers of a sample.
    inputs: usize,
    channels: usize,
    cut: Cut,
    /// Samples one behind the other, as the network takes them.
    samples: Vec<f32>,
    /// What is to be predicted from the window that ends with each sample, as the network says it.
    changes: Vec<f32>,
    /// Root mean square of each change, in parts of its channel's scale: what an output of 1 is.
    scale: Vec<f64>,
    /// First samples of the windows to train on, to validate on and to test on, each with its run and its place there.
    parts: [Vec<Start>; 3],
}

/// Where a window begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Start {
    sample: usize,
    run: usize,
    /// Of its last sample in the run.
    last: usize,
}

/// Windows as a network takes them, row by row.
pub struct Batch {
    pub count: usize,
    /// For each window its samples, oldest first.
    pub inputs: Vec<f32>,
    /// What is to be predicted from each.
    pub changes: Vec<f32>,
    /// The run of each window, and its last sample there.
    pub ends: Vec<(usize, usize)>,
}

impl Batch {
    /// The root mean square of the error of a prediction of each change, in parts of the change's scale. `predict` gets the number of a window and its samples, and says the changes.
    #[must_use]
    pub fn errors(&self, outputs: usize, mut predict: impl FnMut(usize, &[f32], &mut [f64])) -> Vec<f64> {
        let (width, mut predicted) = (self.inputs.len() / self.count.max(1), vec![0.0; outputs]);
        let mut squares = vec![0.0; outputs];
        for window in 0..self.count {
            predict(window, &self.inputs[window * width..(window + 1) * width], &mut predicted);
            let changes = &self.changes[window * outputs..(window + 1) * outputs];
            for ((sum, predicted), change) in squares.iter_mut().zip(&predicted).zip(changes) {
                let error = predicted - f64::from(*change);
                *sum += error * error;
            }
        }
        squares.iter().map(|sum| libm::sqrt(sum / self.count as f64)).collect()
    }

    /// Some of the windows, by their run and their last sample there.
    #[must_use]
    pub fn only(&self, is_retained: impl Fn(usize, usize) -> bool) -> Self {
        let (width, outputs) =
            (self.inputs.len() / self.count.max(1), self.changes.len() / self.count.max(1));
        let mut retained = Self { count: 0, inputs: Vec::new(), changes: Vec::new(), ends: Vec::new() };
        for (window, end) in self.ends.iter().enumerate().filter(|(_, (run, last))| is_retained(*run, *last))
        {
            retained.count += 1;
            retained.inputs.extend_from_slice(&self.inputs[window * width..(window + 1) * width]);
            retained.changes.extend_from_slice(&self.changes[window * outputs..(window + 1) * outputs]);
            retained.ends.push(*end);
        }
        retained
    }
}

impl Dataset {
    /// Windows of these runs.
    ///
    /// # Errors
    /// Too little data, a cut that cannot be, or a channel that never moves.
    pub fn new(runs: &[Vec<Sample>], cut: Cut) -> Result<Self, TrainError> {
        let Cut { validation, test, .. } = cut;
        for (what, value, must, holds) in [
            (
                "the part to validate on",
                validation,
                "above 0 and below 1",
                validation > 0.0 && validation < 1.0,
            ),
            (
                "the part to test on",
                test,
                "such that runs are left to train on",
                test >= 0.0 && test + validation < 1.0,
            ),
            ("the window", cut.window as f64, "at least 1", cut.window > 0),
            ("the step between windows", cut.every as f64, "at least 1", cut.every > 0),
        ] {
            if !holds {
                return Err(TrainError::Option { what, value, must });
            }
        }
        let farthest = cut.ahead.iter().copied().max().unwrap_or(0);
        if cut.ahead.contains(&0) || farthest == 0 {
            return Err(TrainError::Option { what: "the samples ahead", value: 0.0, must: "at least 1" });
        }
        let first = runs.iter().find_map(|r| r.first());
        let (channels, valves) = first.map_or((0, 0), |s| (s.pose.len(), s.duty.len()));
        let outputs = channels * cut.ahead.len();
        let (mut samples, mut changes) = (Vec::new(), Vec::new());
        let mut parts = [Vec::new(), Vec::new(), Vec::new()];
        let part = |part: f64| (runs.len() as f64 * part).round() as usize;
        let tested = if test > 0.0 { part(test).max(1) } else { 0 };
        let held_back = part(validation).max(1) + tested;
        let mut squares = vec![0.0; outputs];
        let mut counted = 0usize;
        for (number, run) in runs.iter().enumerate() {
            let trains = number + held_back < runs.len();
            let begin = samples.len() / (channels + valves).max(1);
            for (place, sample) in run.iter().enumerate().take(run.len().saturating_sub(farthest)) {
                samples.extend(sample.pose.iter().map(|v| *v as f32));
                samples.extend(sample.duty.iter().map(|v| (v / cut.duty_scale) as f32));
                let later =
                    cut.ahead.iter().flat_map(|ahead| run[place + ahead].pose.iter().zip(&sample.pose));
                for (square, (next, this)) in squares.iter_mut().zip(later) {
                    changes.push((next - this) as f32);
                    *square += if trains { (next - this) * (next - this) } else { 0.0 };
                }
                counted += usize::from(trains);
            }
            let count = (run.len() + 1).saturating_sub(cut.window + farthest);
            let windows = (0..count).step_by(cut.every);
            let part = if trains { 0 } else { 1 + usize::from(number + tested >= runs.len()) };
            let start = |at| Start { sample: begin + at, run: number, last: at + cut.window - 1 };
            parts[part].extend(windows.map(start));
        }
        for (what, found) in [("train on", parts[0].len()), ("validate on", parts[1].len())] {
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
        Ok(Self { inputs: channels + valves, channels, cut, samples, changes, scale, parts })
    }

    /// Numbers of a sample.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Changes that are predicted: those of all channels to the first time ahead, then to the next.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.scale.len()
    }

    /// Samples of a window.
    #[must_use]
    pub fn window(&self) -> usize {
        self.cut.window
    }

    /// Root mean square of each change, in parts of its channel's scale.
    #[must_use]
    pub fn scale(&self) -> &[f64] {
        &self.scale
    }

    /// Windows to train on, and to validate on.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        (self.parts[0].len(), self.parts[1].len())
    }

    /// The windows to train on in a random order, in batches; what does not fill one is left out.
    pub(crate) fn batches(&self, size: usize, random: &mut Random) -> impl Iterator<Item = Batch> {
        let mut order = self.parts[0].clone();
        random.shuffle(&mut order);
        let whole = order.len() / size * size;
        order.truncate(whole);
        (0..whole / size).map(move |i| self.batch(&order[i * size..(i + 1) * size]))
    }

    /// The windows to train on.
    #[must_use]
    pub fn training(&self) -> Batch {
        self.batch(&self.parts[0])
    }

    /// The windows to validate on.
    #[must_use]
    pub fn validation(&self) -> Batch {
        self.batch(&self.parts[1])
    }

    /// The windows of the runs that neither trained nor chose.
    #[must_use]
    pub fn test(&self) -> Batch {
        self.batch(&self.parts[2])
    }

    fn batch(&self, starts: &[Start]) -> Batch {
        let (outputs, window) = (self.outputs(), self.cut.window);
        let mut inputs = Vec::with_capacity(starts.len() * window * self.inputs);
        let mut changes = Vec::with_capacity(starts.len() * outputs);
        for Start { sample, .. } in starts {
            let samples = &self.samples[sample * self.inputs..(sample + window) * self.inputs];
            if self.cut.from_newest {
                let newest = &samples[(window - 1) * self.inputs..][..self.channels];
                for sample in samples.chunks_exact(self.inputs) {
                    inputs.extend(sample.iter().zip(newest).map(|(value, newest)| value - newest));
                    inputs.extend_from_slice(&sample[self.channels..]);
                }
            } else {
                inputs.extend_from_slice(samples);
            }
            let last = sample + window - 1;
            changes.extend_from_slice(&self.changes[last * outputs..(last + 1) * outputs]);
        }
        Batch { count: starts.len(), inputs, changes, ends: starts.iter().map(|s| (s.run, s.last)).collect() }
    }
}
