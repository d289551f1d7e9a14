//! Linear-quadratic control with an integrator and an observer (4.12)-(4.17) corrected, SCIENCE D5-D7.
//!
//! ```text
//! u(k) = u_r - L [x^(k) - x_r; s(k)],   x^(k+1) = A x^ + B u + K (y - C x^),   s(k+1) = s(k) + r - y(k+1)
//! ```
//!
//! L minimises the cost of the plant with its integrator, `[[A, 0], [-C A, I]]` and `[B; -C B]`. The dissertation has
//! no integrator and no set-point: its law regulates to zero. With x_r, the state in which the plant would rest at the
//! set-point, the law answers to a new set-point at once, and not only through its integrator; x_r = 0 is D7. The input
//! u_r moves the plant with a moving set-point (SCIENCE Y2).

use nalgebra::{DMatrix, DVector, DVectorView};

use crate::riccati::{Regulator, RiccatiError, dlqr, spectral_radius};

/// A plant as a controller knows it: x(k+1) = A x + B u, y = C x, and the gain of its observer.
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    /// A, n by n.
    pub a: DMatrix<f64>,
    /// B, n by m.
    pub b: DMatrix<f64>,
    /// C, p by n.
    pub c: DMatrix<f64>,
    /// K, n by p.
    pub k: DMatrix<f64>,
}

/// What the law weighs against each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Of the states, n by n.
    pub state: DMatrix<f64>,
    /// Of the integrators, p by p.
    pub integral: DMatrix<f64>,
    /// Of the inputs, m by m.
    pub effort: DMatrix<f64>,
}

/// Why there is no law.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LqiError {
    /// The observer does not follow.
    #[error("the observer A - K C is unstable (spectral radius {radius:.6})")]
    Observer {
        /// Largest modulus of its eigenvalues.
        radius: f64,
    },
    /// Matrices that do not fit, or no stable loop.
    #[error(transparent)]
    Riccati(#[from] RiccatiError),
}

/// The gain of the plant with its integrators.
fn gain(plant: &Plant, weights: &Weights) -> Result<DMatrix<f64>, RiccatiError> {
    let (n, p) = (plant.a.nrows(), plant.c.nrows());
    let (a, b) = augmented(plant);
    let mut q = DMatrix::zeros(n + p, n + p);
    q.view_mut((0, 0), (n, n)).copy_from(&weights.state);
    q.view_mut((n, n), (p, p)).copy_from(&weights.integral);
    Ok(dlqr(&Regulator { a: &a, b: &b, q: &q, r: &weights.effort, n: None })?.k)
}

/// The law, its observer and its integrators.
#[derive(Clone, Debug)]
pub struct Lqi {
    plant: Plant,
    gain: DMatrix<f64>,
    x: DVector<f64>,
    s: DVector<f64>,
    aim: DVector<f64>,
    /// What moves the set-point, by itself.
    feed: DVector<f64>,
    rested: bool,
    limits: [f64; 2],
    /// [x; s], the error and then the innovation, the next x.
    scratch: [DVector<f64>; 3],
}

impl Lqi {
    /// Finds the law.
    ///
    /// # Errors
    /// [`LqiError`].
    pub fn design(plant: Plant, weights: &Weights) -> Result<Self, LqiError> {
        let (n, m, p) = (plant.a.nrows(), plant.b.ncols(), plant.c.nrows());
        let fits =
            [("A", &plant.a, n, n), ("B", &plant.b, n, m), ("C", &plant.c, p, n), ("K", &plant.k, n, p)];
        let weighed = [
            ("the weight of the states", &weights.state, n, n),
            ("the weight of the integrators", &weights.integral, p, p),
            ("the weight of the inputs", &weights.effort, m, m),
        ];
        for (what, matrix, expected_rows, expected_columns) in fits.into_iter().chain(weighed) {
            let (rows, columns) = matrix.shape();
            if (rows, columns) != (expected_rows, expected_columns) {
                return Err(
                    RiccatiError::Shape { what, rows, columns, expected_rows, expected_columns }.into()
                );
            }
            if matrix.iter().any(|v| !v.is_finite()) {
                return Err(RiccatiError::NotFinite(what).into());
            }
        }
        let radius = spectral_radius(&(&plant.a - &plant.k * &plant.c));
        if radius >= 1.0 {
            return Err(LqiError::Observer { radius });
        }
        let gain = gain(&plant, weights)?;
        let zeros = DVector::zeros;
        let scratch = [zeros(n + p), zeros(p), zeros(n)];
        Ok(Self {
            plant,
            gain,
            x: zeros(n),
            s: zeros(p),
            aim: zeros(n),
            feed: zeros(m),
            rested: true,
            limits: [-1.0, 1.0],
            scratch,
        })
    }

    /// Finds the gain for other weights, of the same shapes. Observer and integrators go on as they are.
    ///
    /// # Errors
    /// There is no stable loop; the gain stays.
    pub fn weigh(&mut self, weights: &Weights) -> Result<(), LqiError> {
        self.gain = gain(&self.plant, weights)?;
        Ok(())
    }

    /// L, m by n + p.
    #[must_use]
    pub fn gain(&self) -> &DMatrix<f64> {
        &self.gain
    }

    /// x^, the observer's state.
    #[must_use]
    pub fn state(&self) -> &[f64] {
        self.x.as_slice()
    }

    /// s, the integrators.
    #[must_use]
    pub fn integral(&self) -> &[f64] {
        self.s.as_slice()
    }

    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Clears the integrators, and takes this state as the state of the plant. The next step integrates nothing.
    pub fn restart(&mut self, x: &[f64]) {
        self.x.copy_from_slice(x);
        self.s.fill(0.0);
        self.rested = true;
    }

    /// Sets the limits of the inputs; without it they are -1 and 1.
    pub fn limit(&mut self, limits: [f64; 2]) {
        self.limits = limits;
    }

    /// Says in which state the plant would rest at the set-point.
    pub fn aim(&mut self, x_r: &[f64]) {
        self.aim.copy_from_slice(x_r);
    }

    /// Sets the input that moves the plant with a moving set-point. It is added to the input of the gain.
    pub fn feed(&mut self, u_r: &[f64]) {
        self.feed.copy_from_slice(u_r);
    }

    /// Writes the part of the input that the integrators make.
    pub fn integrated(&self, u: &mut [f64]) {
        for (i, u) in u.iter_mut().enumerate() {
            *u = -product(&self.gain, i, self.x.len(), &self.s);
        }
    }

    /// Uses the output `y` at this time and the set-point `r`, and writes the input into `u`, within its limits. It
    /// does not allocate.
    ///
    /// The integrators take of `r - y` no more than brings the first input to its limit.
    pub fn step(&mut self, y: &[f64], r: &[f64], u: &mut [f64]) {
        let [both, error, next] = &mut self.scratch;
        let n = self.x.len();
        self.x.sub_to(&self.aim, &mut both.rows_mut(0, n));
        both.rows_mut(n, self.s.len()).copy_from(&self.s);
        let integrates = !std::mem::take(&mut self.rested);
        for (error, (r, y)) in error.iter_mut().zip(r.iter().zip(y)) {
            *error = if integrates { r - y } else { 0.0 };
        }
        let mut part = 1.0_f64;
        for (i, u) in u.iter_mut().enumerate() {
            *u = self.feed[i] - product(&self.gain, i, 0, both);
            let more = -product(&self.gain, i, n, error);
            part = part.min(room(*u, more, self.limits));
        }
        for (i, u) in u.iter_mut().enumerate() {
            *u -= part * product(&self.gain, i, n, error);
            *u = u.clamp(self.limits[0], self.limits[1]);
        }
        self.s.axpy(part, error, 1.0);
        // The integrators are done with it: from here on it is the innovation.
        error.copy_from(&DVectorView::from_slice(y, y.len()));
        error.gemv(-1.0, &self.plant.c, &self.x, 1.0);
        next.gemv(1.0, &self.plant.a, &self.x, 0.0);
        next.gemv(1.0, &self.plant.b, &DVectorView::from_slice(u, u.len()), 1.0);
        next.gemv(1.0, &self.plant.k, error, 1.0);
        self.x.copy_from(next);
    }
}

/// Row `i` of the gain, from column `from` on, times a vector.
fn product(gain: &DMatrix<f64>, i: usize, from: usize, v: &DVector<f64>) -> f64 {
    v.iter().enumerate().map(|(j, v)| gain[(i, from + j)] * v).sum()
}

/// The part of `more`, 0 to 1, that `u` can take before it is at a limit.
fn room(u: f64, more: f64, [low, high]: [f64; 2]) -> f64 {
    let left = if more > 0.0 { high - u } else { low - u };
    // At or beyond the limit that `more` leads to, there is none.
    if more == 0.0 { 1.0 } else { (left / more).clamp(0.0, 1.0) }
}

/// The plant with its integrators.
fn augmented(plant: &Plant) -> (DMatrix<f64>, DMatrix<f64>) {
    let Plant { a, b, c, .. } = plant;
    let (n, m, p) = (a.nrows(), b.ncols(), c.nrows());
    let mut both = DMatrix::zeros(n + p, n + p);
    both.view_mut((0, 0), (n, n)).copy_from(a);
    both.view_mut((n, 0), (p, n)).copy_from(&(-(c * a)));
    both.view_mut((n, n), (p, p)).fill_with_identity();
    let mut input = DMatrix::zeros(n + p, m);
    input.view_mut((0, 0), (n, m)).copy_from(b);
    input.view_mut((n, 0), (p, m)).copy_from(&(-(c * b)));
    (both, input)
}
