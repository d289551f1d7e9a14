//! A model as a file: what `stillpoint identify` writes and a controller reads, checked on the way in.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::MAX_ORDER;
use crate::companion::Companion;
use crate::confidence::INTEGRATOR;
use crate::descent::is_stable;

/// Version of the file's format.
const VERSION: u32 = 1;

/// x(k+1) = A x + B u + K e, y = C x + D u + e (4.10), with u and y counted from their offsets, in their own units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InnovationModel {
    stillpoint_model: u32,
    sample_time_s: f64,
    a: Vec<Vec<f64>>,
    b: Vec<f64>,
    c: Vec<f64>,
    d: f64,
    k: Vec<f64>,
    noise_variance: f64,
    input: Signal,
    output: Signal,
    provenance: Provenance,
}

/// A signal of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// Where it comes from: `topic:field`, or a column.
    pub name: String,
    /// Its unit; empty where the recording has none.
    pub unit: String,
    /// What the model's numbers are counted from.
    pub offset: f64,
    /// Root mean square of the signal about its offset in the record, for controllers that scale.
    pub scale: f64,
}

/// What a model was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// SHA-256 of the recording: of its parts, one behind the other.
    pub sha256: String,
    /// Samples of the fit.
    pub samples: usize,
    /// How much of the output one-step predictions explain, percent.
    pub fit_percent: f64,
    /// The program and its version.
    pub program: String,
}

/// Why a model file is refused.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// It is no JSON of this form.
    #[error("it is not a model file: {0}")]
    Form(#[from] serde_json::Error),
    /// It has another version.
    #[error("it has version {found}; this build reads version {VERSION}")]
    Version {
        /// The file's version.
        found: u32,
    },
    /// Its matrices do not fit each other.
    #[error("{what} has {found} numbers where the order {order} needs {needed}")]
    Shape {
        /// Name of the quantity.
        what: &'static str,
        found: usize,
        order: usize,
        needed: usize,
    },
    /// A number that cannot be.
    #[error("{what} is {value}: it must be {must}")]
    Number {
        /// Name of the quantity.
        what: &'static str,
        value: f64,
        must: &'static str,
    },
    /// A pole of A is outside the unit circle.
    #[error(
        "it is unstable: a pole has the modulus {0:.4}, and a model for a controller has none above {INTEGRATOR}; identify \
         with another order, or from a record with more or better excitation"
    )]
    UnstablePole(f64),
    /// Its observer is unstable.
    #[error("its observer A - K C is unstable: it would never follow the output")]
    Unstable,
}

/// The file before it is checked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked {
    stillpoint_model: u32,
    sample_time_s: f64,
    a: Vec<Vec<f64>>,
    b: Vec<f64>,
    c: Vec<f64>,
    d: f64,
    k: Vec<f64>,
    noise_variance: f64,
    input: Signal,
    output: Signal,
    provenance: Provenance,
}

impl InnovationModel {
    /// A fitted model as it is written.
    ///
    /// # Errors
    /// Numbers that no controller could use.
    pub fn new(
        model: &Companion,
        sample_time_s: f64,
        noise_variance: f64,
        [input, output]: [Signal; 2],
        provenance: Provenance,
    ) -> Result<Self, ModelError> {
        let a = model.a();
        let row = |i: usize| a.row(i).iter().copied().collect();
        Self::check(Unchecked {
            stillpoint_model: VERSION,
            sample_time_s,
            a: (0..model.order()).map(row).collect(),
            b: model.input.iter().copied().collect(),
            c: (0..model.order()).map(|i| f64::from(u8::from(i == 0))).collect(),
            d: 0.0,
            k: model.gain.iter().copied().collect(),
            noise_variance,
            input,
            output,
            provenance,
        })
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// It is none, of another version, or its numbers do not make a model.
    pub fn from_json(bytes: &[u8]) -> Result<Self, ModelError> {
        /// Read first, so that a file of another version is called so, whatever else is in it.
        #[derive(Deserialize)]
        struct Version {
            stillpoint_model: u32,
        }
        let Version { stillpoint_model: found } = serde_json::from_slice(bytes)?;
        if found != VERSION {
            return Err(ModelError::Version { found });
        }
        Self::check(serde_json::from_slice(bytes)?)
    }

    /// The file.
    ///
    /// # Errors
    /// Never for a model that was checked.
    pub fn to_json(&self) -> Result<String, ModelError> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    fn check(m: Unchecked) -> Result<Self, ModelError> {
        let order = m.a.len();
        if !(1..=MAX_ORDER).contains(&order) {
            let (value, must) = (order as f64, "from 1 to 12");
            return Err(ModelError::Number { what: "the order of A", value, must });
        }
        let rows = m.a.iter().map(|row| ("a row of A", row.len()));
        let lengths = rows.chain([("B", m.b.len()), ("C", m.c.len()), ("K", m.k.len())]);
        for (what, found) in lengths {
            if found != order {
                return Err(ModelError::Shape { what, found, order, needed: order });
            }
        }
        let numbers = m.a.iter().flatten().map(|v| ("a number of A", v));
        let numbers = numbers
            .chain(m.b.iter().map(|v| ("a number of B", v)))
            .chain(m.c.iter().map(|v| ("a number of C", v)))
            .chain(m.k.iter().map(|v| ("a number of K", v)))
            .chain([
                ("D", &m.d),
                ("the input's offset", &m.input.offset),
                ("the output's offset", &m.output.offset),
            ]);
        for (what, value) in numbers {
            if !value.is_finite() {
                return Err(ModelError::Number { what, value: *value, must: "a finite number" });
            }
        }
        for (what, value) in [
            ("sample_time_s", m.sample_time_s),
            ("noise_variance", m.noise_variance),
            ("the input's scale", m.input.scale),
            ("the output's scale", m.output.scale),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(ModelError::Number { what, value, must: "a number above 0" });
            }
        }
        let model = Self {
            stillpoint_model: m.stillpoint_model,
            sample_time_s: m.sample_time_s,
            a: m.a,
            b: m.b,
            c: m.c,
            d: m.d,
            k: m.k,
            noise_variance: m.noise_variance,
            input: m.input,
            output: m.output,
            provenance: m.provenance,
        };
        let moduli = model.a().complex_eigenvalues().map(|z| z.norm());
        let greatest = moduli.iter().copied().max_by(f64::total_cmp).unwrap_or(0.0);
        if greatest.is_nan() || greatest > INTEGRATOR {
            return Err(ModelError::UnstablePole(greatest));
        }
        let observer = model.a() - model.k() * model.c().transpose();
        if is_stable(&observer) { Ok(model) } else { Err(ModelError::Unstable) }
    }

    /// The number of states.
    #[must_use]
    pub fn order(&self) -> usize {
        self.b.len()
    }

    /// Seconds from one sample to the next.
    #[must_use]
    pub fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    #[must_use]
    pub fn a(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.order(), self.order(), |i, j| self.a[i][j])
    }

    /// B, in the output's unit per the input's.
    #[must_use]
    pub fn b(&self) -> DVector<f64> {
        DVector::from_column_slice(&self.b)
    }

    #[must_use]
    pub fn c(&self) -> DVector<f64> {
        DVector::from_column_slice(&self.c)
    }

    #[must_use]
    pub fn d(&self) -> f64 {
        self.d
    }

    /// K, the gain of the observer.
    #[must_use]
    pub fn k(&self) -> DVector<f64> {
        DVector::from_column_slice(&self.k)
    }

    /// Variance of the innovation e, in the output's unit squared.
    #[must_use]
    pub fn noise_variance(&self) -> f64 {
        self.noise_variance
    }

    #[must_use]
    pub fn input(&self) -> &Signal {
        &self.input
    }

    #[must_use]
    pub fn output(&self) -> &Signal {
        &self.output
    }

    /// The record of the fit.
    #[must_use]
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }
}
