//! `ingest.driver`: the depth images of a driver program of one's own.

use stillpoint_operator::outside::Arrivals;
use stillpoint_operator::{Activation, Listening, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{DepthImage, Diagnostics, Metric, Sample};

use super::ros2::Stamps;
use crate::driver_frame::{BEGINNING, DriverFrame, DriverRefusal, HEADER};

const DEPTH: usize = 0;
const DIAGNOSTICS: usize = 1;
const METRICS: usize = 3 + DriverRefusal::ALL.len();

/// Parameters of `ingest.driver`.
#[derive(Clone, Debug, Params)]
pub struct DriverParams {
    /// Path of the socket at which it listens for the driver: one that is not absolute, from the folder in which the run
    /// was started. Only the user of the run may connect.
    pub socket: String,
    /// Which time is that of the acquisition.
    #[param(default = "header")]
    pub stamps: Stamps,
    /// How far a time of acquisition may be ahead of the clock: images that are farther ahead are refused.
    #[param(unit = "ns", default = "5 ms", max = "1 s")]
    pub clock_ahead: u64,
    /// Largest number of pixels of an image: sets the size of shared memory.
    #[param(default = 307200, min = 1, max = 16777216)]
    pub max_pixels: u32,
}

/// Sends the images of a driver that connects to its socket, and counts what it refuses.
pub struct IngestDriver {
    arrivals: Arrivals,
    stamps: Stamps,
    clock_ahead: u64,
    max_pixels: usize,
    counts: Counts,
}

/// What the driver has sent.
#[derive(Default)]
struct Counts {
    images: u64,
    missing: u64,
    restarts: u64,
    refused: [u64; DriverRefusal::ALL.len()],
    /// Number of the last image.
    last: Option<u64>,
    /// The refusal that the log has.
    logged: Option<DriverRefusal>,
}

impl Counts {
    /// Counts an image, and those that its number shows to be missing. A driver that begins anew counts from zero again.
    fn take(&mut self, number: u64) {
        match self.last.replace(number) {
            Some(last) if number > last => self.missing = self.missing.saturating_add(number - last - 1),
            Some(_) => self.restarts += 1,
            None => {}
        }
        self.images += 1;
        if self.logged.take().is_some() {
            tracing::info!("images of the driver are taken again");
        }
    }

    fn refuse(&mut self, refusal: DriverRefusal) {
        self.refused[refusal as usize] += 1;
        if self.logged.replace(refusal) != Some(refusal) {
            tracing::warn!("an image of the driver is refused: {refusal}");
        }
    }

    fn metrics(&self) -> [Metric; METRICS] {
        let first =
            [("images", self.images), ("missing", self.missing), ("restarts", self.restarts)].into_iter();
        let refused = DriverRefusal::ALL.map(|refusal| (refusal.name(), self.refused[refusal as usize]));
        let mut all = first.chain(refused);
        std::array::from_fn(|_| {
            let (name, count) = all.next().unwrap_or_default();
            Metric::new(name, count as f64)
        })
    }
}

impl Operator for IngestDriver {
    type Params = DriverParams;
    const KIND: Kind = Kind {
        name: "ingest.driver",
        about: "Takes the depth images of a driver program of your own, in any language, over a socket.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            Output {
                name: "depth",
                sample: DepthImage::KIND,
                frame: FrameRule::Key,
                about: "The depth image, in the camera's frame: x right, y down, z forward.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "After each message of the driver: how many images came, are missing, or were refused, by reason.",
            },
        ],
        timer: Timer::Required,
    };

    fn listens(params: &DriverParams) -> Option<Listening> {
        let longest = HEADER + 2 * params.max_pixels as usize;
        Some(Listening { socket: params.socket.clone(), beginning: BEGINNING, longest })
    }

    fn new(params: DriverParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let Some(arrivals) = setup.outside.arrivals.clone() else {
            return Err(SetupError(format!(
                "`{}` takes the images of a driver, which a live run alone does: run it without `--clock simulated`, or \
                 replay a session of a live run",
                setup.operator
            )));
        };
        Ok(Self {
            arrivals,
            stamps: params.stamps,
            clock_ahead: params.clock_ahead,
            max_pixels: params.max_pixels as usize,
            counts: Counts::default(),
        })
    }

    fn capacities(params: &DriverParams) -> Vec<usize> {
        vec![params.max_pixels as usize, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        // One at a time: each has its own time of acquisition.
        let Some(bytes) = self.arrivals.take() else { return Ok(()) };
        let sent = self.take(&bytes, activation.time, outputs);
        self.arrivals.give_back(bytes);
        sent?;
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.counts.metrics())
    }
}

impl IngestDriver {
    fn take(&mut self, bytes: &[u8], now: u64, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let read = DriverFrame::parse(bytes, self.max_pixels);
        let (frame, acquired) = match read.and_then(|frame| Ok((frame, self.acquired(&frame, now)?))) {
            Ok(read) => read,
            Err(refusal) => {
                self.counts.refuse(refusal);
                return Ok(());
            }
        };
        self.counts.take(frame.number);
        outputs.acquired_at(acquired);
        let counts = frame.counts();
        let pixels = counts.len();
        let mut image = outputs.open::<DepthImage>(DEPTH, pixels)?;
        *image.body() = frame.intrinsics;
        for (slot, count) in image.elements().iter_mut().zip(counts) {
            *slot = count;
        }
        image.finish(pixels)
    }

    /// When a frame was acquired that arrived by `now`, ns.
    fn acquired(&self, frame: &DriverFrame<'_>, now: u64) -> Result<u64, DriverRefusal> {
        match (self.stamps, frame.acquired) {
            (Stamps::Arrival, _) => Ok(now),
            (Stamps::Header, 0) => Err(DriverRefusal::NoStamp),
            (Stamps::Header, at) if at > now.saturating_add(self.clock_ahead) => Err(DriverRefusal::Ahead),
            // A clock that is a little ahead acquires nothing in the future.
            (Stamps::Header, at) => Ok(at.min(now)),
        }
    }
}
