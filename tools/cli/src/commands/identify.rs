//! `stillpoint identify`

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;
use stillpoint_identify::{
    Estimate, Found, InnovationModel, Pole, Provenance, Record, Resampled, Signal, Stability, fit, resample,
};
use stillpoint_pipeline::config::quantity;
use stillpoint_recorder::Session;

use crate::exit::{Ended, Exit, Failure, print_json};
use crate::recorded::with_topics;
use crate::series::{self, Clock, Series};

/// Fit a model to the recorded input and output of a system.
///
/// The model is x(k+1) = A x + B u + K e, y = C x + e, fitted by the prediction-error method. First, both signals are
/// resampled to one sample time: the output is interpolated, the input holds its last value, and the longest stretch of
/// the output without a gap is used.
#[derive(Args)]
pub struct Identify {
    /// The session (a folder of parts, or one file), or a table: a file `*.csv` with named columns.
    recording: PathBuf,
    /// The input: `operator.port:field`, such as `valves.command:duty.0`; for a table, a column.
    #[arg(long, value_name = "SIGNAL")]
    input: String,
    /// The output: `operator.port:field`, such as `filter.state:position.2`; for a table, a column.
    #[arg(long, value_name = "SIGNAL")]
    output: String,
    /// Number of states.
    #[arg(long, value_name = "N")]
    order: usize,
    /// Sample time, such as `33 ms`. Default: the median interval of the output. A table requires it.
    #[arg(long, value_name = "TIME")]
    sample_time: Option<String>,
    /// The offset that is subtracted from the signals.
    #[arg(long, value_enum, default_value_t)]
    offset: Offset,
    /// Write the model to this file, as JSON for a controller.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Offset {
    /// Their means.
    #[default]
    Mean,
    /// Their first values, for a system that is at rest when the recording begins.
    First,
    /// Zero.
    None,
}

impl Offset {
    fn of(self, values: &[f64]) -> f64 {
        match self {
            Self::Mean => values.iter().sum::<f64>() / values.len().max(1) as f64,
            Self::First => values.first().copied().unwrap_or(0.0),
            Self::None => 0.0,
        }
    }
}

impl Identify {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let step = self.sample_time.as_deref().map(time).transpose()?;
        let [input, output] = self.read(step)?;
        let failed =
            |e: &dyn std::fmt::Display| Failure::failed(format!("{}: {e}", self.recording.display()));
        let mut record = resample(&input.samples, &output.samples, step).map_err(|e| failed(&e))?;
        let signal = |series: &Series, values: &mut [f64]| {
            let offset = self.offset.of(values);
            values.iter_mut().for_each(|v| *v -= offset);
            let scale = (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt();
            Signal { name: series.name.clone(), unit: series.unit.clone(), offset, scale }
        };
        let signals = [signal(&input, &mut record.input), signal(&output, &mut record.output)];
        let found = fit(&Record { input: &record.input, output: &record.output }, self.order)
            .map_err(|e| failed(&e))?;
        let provenance = Provenance {
            sha256: series::sha256(&self.recording)?,
            samples: found.samples,
            fit_percent: found.fit_percent,
            program: format!("stillpoint {}", env!("CARGO_PKG_VERSION")),
        };
        let sample_time = record.grid.step as f64 * 1e-9;
        let unstable = unstable(&found);
        let model = match unstable {
            Some(_) => None,
            None => Some(
                InnovationModel::new(
                    &found.model,
                    sample_time,
                    found.noise_variance,
                    signals.clone(),
                    provenance,
                )
                .map_err(|e| failed(&e))?,
            ),
        };
        let (warnings, without_number) = (warnings(&found), [input.without_number, output.without_number]);
        if self.json {
            print_json(&json!({
                "model": model, "found": found, "record": record, "without_number": without_number,
                "warnings": warnings,
            }))?;
        } else {
            print(&signals, sample_time, &found, &record, without_number);
            warnings.iter().for_each(|w| outln!("warning: {w}"));
        }
        if let Some(reason) = unstable {
            let unwritten =
                self.model.as_ref().map_or(String::new(), |p| format!("; {} is not written", p.display()));
            return Err(failed(&format!("{reason}{unwritten}")));
        }
        if let (Some(path), Some(model)) = (&self.model, &model) {
            let text = model.to_json().map_err(Failure::failed)?;
            std::fs::write(path, text).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
        }
        Ok(Exit::Done)
    }

    fn read(&self, step: Option<u64>) -> Result<[Series; 2], Failure> {
        if self.recording.extension().is_some_and(|e| e == "csv") {
            let step = step.ok_or_else(|| Failure::wrong("a table has no times: add --sample-time"))?;
            let text = std::fs::read_to_string(&self.recording)
                .map_err(|e| Failure::failed(format!("{}: {e}", self.recording.display())))?;
            return series::of_table(&text, [&self.input, &self.output], step);
        }
        let session = with_topics(Session::open_any(&self.recording), &self.recording)?;
        Ok([
            series::of_session(&session, &self.input, Clock::Stamp)?,
            series::of_session(&session, &self.output, Clock::Origin)?,
        ])
    }
}

fn time(text: &str) -> Result<u64, Failure> {
    quantity::nanoseconds(text)
        .map_err(|e| Failure::wrong(format!("--sample-time {text}: {}; {}", e.message, e.help)))
}

/// A number with its 95 % bounds.
fn within(e: &Estimate) -> String {
    format!("{:.6e} +- {:.1e}", e.value, 1.96 * e.sd)
}

fn place(pole: &Pole) -> String {
    match pole.im.value {
        0.0 => format!("the pole {:.6}", pole.re.value),
        im => format!("the pole {:.6} {im:+.6} i", pole.re.value),
    }
}

/// Why the model is of no use for a controller, and what to do.
fn unstable(found: &Found) -> Option<String> {
    let is_unstable = |p: &&Pole| p.stability() == Stability::Unstable;
    let pole =
        found.poles.iter().filter(is_unstable).max_by(|a, b| a.modulus.value.total_cmp(&b.modulus.value))?;
    Some(format!(
        "the model is unstable: {} has the modulus {:.6} +- {:.1e} (95 %); try another --order, or record longer with an \
         input that excites more",
        place(pole),
        pole.modulus.value,
        1.96 * pole.modulus.sd
    ))
}

/// Reasons to doubt a model.
fn warnings(found: &Found) -> Vec<String> {
    let integrating = found.poles.iter().filter(|p| p.stability() == Stability::Integrating).map(|pole| {
        format!(
            "{} cannot be distinguished from one on the unit circle (modulus {:.6} +- {:.1e}, 95 %): right for a plant that \
             integrates its input, whose DC gain says nothing; else record longer, or try another --order",
            place(pole),
            pole.modulus.value,
            1.96 * pole.modulus.sd
        )
    });
    let unexplained = (found.simulation_fit_percent < 0.0).then(|| {
        "from the input alone the model is worse than the output's mean: it predicts from the output's past, and the input \
         explains nothing; excite the input more, or look whether it is the right one"
            .to_owned()
    });
    integrating.chain(unexplained).collect()
}

fn print(
    [input, output]: &[Signal; 2],
    sample_time: f64,
    found: &Found,
    record: &Resampled,
    without_number: [usize; 2],
) {
    let model = &found.model;
    let row = |values: &[f64]| values.iter().map(|v| format!("{v:>14.6e}")).collect::<Vec<_>>().join(" ");
    outln!(
        "{} -> {}: {} samples of {:.3} ms, {:.1} s",
        input.name,
        output.name,
        found.samples,
        sample_time * 1e3,
        found.samples as f64 * sample_time
    );
    outln!(
        "resampled: output interpolated over at most {:.3} ms, input held; {} gaps, {:.1} s left out; without a number {} of the \
         input, {} of the output",
        record.farthest as f64 * 1e-6,
        record.gaps,
        record.left_out_s,
        without_number[0],
        without_number[1]
    );
    for (what, signal) in [("input", input), ("output", output)] {
        outln!("{what} counted from {} {}, rms {:.6e}", signal.offset, signal.unit, signal.scale);
    }
    outln!();
    for i in 0..model.order() {
        let a: Vec<f64> = model.a().row(i).iter().copied().collect();
        outln!(
            "{} {}   B {:>14.6e}   K {:>14.6e}",
            if i == 0 { "A" } else { " " },
            row(&a),
            model.input[i],
            model.gain[i]
        );
    }
    outln!();
    outln!(
        "fit {:.2} % one step ahead, {:.2} % from the input alone",
        found.fit_percent,
        found.simulation_fit_percent
    );
    outln!("loss {:.6e}, standard deviation of e {:.6e}", found.loss, found.noise_variance.sqrt());
    match &found.dc_gain {
        Some(gain) => outln!("DC gain {}   (95 %)", within(gain)),
        None => outln!("no DC gain: the model is unstable, and its output does not settle"),
    }
    for pole in &found.poles {
        outln!("pole {}, {} i, modulus {}", within(&pole.re), within(&pole.im), within(&pole.modulus));
    }
    for test in &found.residuals {
        outln!(
            "{} of the residuals: {} ({:.1}, 99 % are below {:.1}; {} of {} lags beyond their own 99 %)",
            test.name,
            if test.passes() { "passes" } else { "FAILS" },
            test.statistic,
            test.limit,
            test.beyond,
            test.lags
        );
    }
}
