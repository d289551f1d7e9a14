//! Adam (Kingma and Ba, 2015), whose whole state is kept, so that a training resumes to the bit.

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};

use crate::TrainError;

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// Moments of each number, and the steps until now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adam {
    /// Means of the gradients, tensor by tensor.
    pub first: Vec<Vec<f32>>,
    /// Means of their squares.
    pub second: Vec<Vec<f32>>,
    pub steps: u64,
}

impl Adam {
    /// Before the first step over these.
    pub fn new(vars: &[Var]) -> Self {
        let zeros: Vec<Vec<f32>> = vars.iter().map(|v| vec![0.0; v.elem_count()]).collect();
        Self { first: zeros.clone(), second: zeros, steps: 0 }
    }

    /// A step down the gradients.
    pub fn step(&mut self, vars: &[Var], gradients: &GradStore, rate: f64) -> Result<(), TrainError> {
        self.steps += 1;
        let steps = self.steps as f64;
        let (one, two) = (1.0 - libm::pow(BETA_1, steps), 1.0 - libm::pow(BETA_2, steps));
        for (place, var) in vars.iter().enumerate() {
            let Some(gradient) = gradients.get(var) else { continue };
            let gradient = gradient.flatten_all()?.to_vec1::<f32>()?;
            let mut numbers = var.flatten_all()?.to_vec1::<f32>()?;
            let moments = self.first[place].iter_mut().zip(&mut self.second[place]);
            for ((number, g), (m, v)) in numbers.iter_mut().zip(gradient).zip(moments) {
                let g = f64::from(g);
                let mean = BETA_1 * f64::from(*m) + (1.0 - BETA_1) * g;
                let square = BETA_2 * f64::from(*v) + (1.0 - BETA_2) * g * g;
                (*m, *v) = (mean as f32, square as f32);
                *number -= (rate * (mean / one) / (libm::sqrt(square / two) + EPSILON)) as f32;
            }
            var.set(&Tensor::from_vec(numbers, var.dims(), var.device())?)?;
        }
        Ok(())
    }
}
