//! Phi of (4.36): what the adaptive law learns its weights over.

use crate::lstm::Memory;
use crate::predictor::Predictor;
use crate::valves::split;

#[derive(Clone, Debug)]
pub enum Features {
    /// 1 and the hyperbolic tangent of each channel.
    Tanh,
    /// The last hidden state of a network that was trained to predict the pose, and 1.
    Learned(Box<Learned>),
}

impl Features {
    /// Number of features for this many channels.
    #[must_use]
    pub fn count(&self, channels: usize) -> usize {
        match self {
            Self::Tanh => 1 + channels,
            Self::Learned(learned) => learned.predictor.network().features() + 1,
        }
    }

    pub fn restart(&mut self) {
        if let Self::Learned(learned) = self {
            learned.restart();
        }
    }

    /// Sees where the plant is, `dt` seconds after it last did, and writes the features.
    pub fn look(&mut self, m: &[f64], dt: f64, phi: &mut [f64]) {
        match self {
            Self::Tanh => {
                phi[0] = 1.0;
                for (phi, m) in phi[1..].iter_mut().zip(m) {
                    *phi = libm::tanh(*m);
                }
            }
            Self::Learned(learned) => learned.look(m, dt, phi),
        }
    }

    /// Sees what the bladders are told to do from now on.
    pub fn acted(&mut self, net: &[f64]) {
        if let Self::Learned(learned) = self {
            learned.acted(net);
        }
    }
}

/// The features of a network.
///
/// The network gets samples as in training: at its own sample time, each with the pose at its beginning and the mean
/// duties during it. It processes the last few samples from an empty memory, so one bad sample has no lasting effect.
#[derive(Clone, Debug)]
pub struct Learned {
    predictor: Predictor,
    memory: Memory,
    /// The controller's scale over the network's, for each channel.
    ratio: Vec<f64>,
    /// The samples that are complete, oldest first.
    window: Vec<f64>,
    complete: usize,
    /// The sample that is under way: the pose, and the sums of the duties.
    open: Vec<f64>,
    looks: u32,
    elapsed: f64,
    duty: Vec<f64>,
    /// What the network said of the change of each channel.
    predicted: Vec<f64>,
}

impl Learned {
    /// The features of a network for a controller of these scales (m or rad).
    #[must_use]
    pub fn new(predictor: Predictor, scale: &[f64]) -> Self {
        let inputs = predictor.network().inputs();
        let ratio = scale.iter().zip(predictor.scale()).map(|(own, its)| own / its).collect();
        Self {
            memory: predictor.network().memory(),
            ratio,
            window: vec![0.0; inputs * predictor.window()],
            complete: 0,
            open: vec![0.0; inputs],
            looks: 0,
            elapsed: 0.0,
            duty: vec![0.0; 2 * predictor.bladders()],
            predicted: vec![0.0; predictor.network().outputs()],
            predictor,
        }
    }

    fn restart(&mut self) {
        self.complete = 0;
        self.looks = 0;
        self.elapsed = 0.0;
    }

    fn look(&mut self, m: &[f64], dt: f64, phi: &mut [f64]) {
        self.elapsed += dt;
        // A timer's period is a whole number of ns; sums of it are not quite.
        let is_time = self.elapsed + 1e-6 >= self.predictor.sample_time();
        if self.looks > 0 && is_time {
            self.close();
        }
        if self.looks == 0 {
            self.elapsed = 0.0;
            for (place, (m, ratio)) in self.open.iter_mut().zip(m.iter().zip(&self.ratio)) {
                *place = m * ratio;
            }
            self.open[m.len()..].fill(0.0);
        }
        let count = self.predictor.network().features();
        if self.complete == self.predictor.window() {
            phi[..count].copy_from_slice(self.memory.hidden());
        } else {
            phi[..count].fill(0.0);
        }
        phi[count] = 1.0;
    }

    /// Takes the sample that is under way into the window, and lets the network go over it.
    fn close(&mut self) {
        let (inputs, channels) = (self.open.len(), self.ratio.len());
        let scale = 1.0 / (f64::from(self.looks) * self.predictor.duty_scale());
        self.open[channels..].iter_mut().for_each(|sum| *sum *= scale);
        self.looks = 0;
        let last = self.window.len() - inputs;
        self.window.copy_within(inputs.., 0);
        self.window[last..].copy_from_slice(&self.open);
        self.complete = (self.complete + 1).min(self.predictor.window());
        if self.complete == self.predictor.window() {
            self.memory.clear();
            for sample in self.window.chunks_exact(inputs) {
                self.predictor.network().step(sample, &mut self.memory);
            }
            self.predictor.network().output(&self.memory, &mut self.predicted);
        }
    }

    fn acted(&mut self, net: &[f64]) {
        let _ = split(net, &mut self.duty);
        for (sum, duty) in self.open[self.ratio.len()..].iter_mut().zip(&self.duty) {
            *sum += duty;
        }
        self.looks += 1;
    }

    /// How much the network said that each channel would change in one of its sample times, in its own scale; `None`
    /// until its window is full.
    #[must_use]
    pub fn predicted_change(&self, channel: usize) -> Option<f64> {
        let full = self.complete == self.predictor.window();
        full.then(|| {
            self.predicted.get(channel).zip(self.predictor.change().get(channel)).map(|(y, s)| y * s)
        })
        .flatten()
    }
}
