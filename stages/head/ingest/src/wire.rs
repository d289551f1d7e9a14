//! Messages of ROS 2 as the bridge hands them over: which are taken, and why the others are refused. Nothing of a message
//! is trusted: whoever reaches the router may send any bytes.

use stillpoint_cdr::Reader;
use stillpoint_operator::ros2::{Content, Delivery};
use stillpoint_ros2::Attachment;
use stillpoint_samples::Metric;

use crate::depth_message::DepthMessageError;
use crate::operators::{Cameras, CamerasError, MessageError};
use crate::point_cloud2::PointCloud2Error;

/// Senders whose numbers are followed; one more takes the place of the one that was silent longest.
const MOST_SENDERS: usize = 16;

/// Why a message was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireRefusal {
    /// It has more bytes than the operator takes.
    TooLong,
    /// It is of another type.
    OtherType,
    /// Number, time and sender beside it are missing or broken.
    Attachment,
    /// It is no message of its type.
    Damaged,
    /// It is whole, and has no depth or no points.
    NoDepth,
    /// It is in another frame than `frame_id`.
    OtherFrame,
    /// Its stamp is zero.
    NoStamp,
    /// Its stamp is ahead of the clock.
    Ahead,
    /// It is an image, and there is no camera yet.
    NoCameraInfo,
    /// It is a `CameraInfo` that describes no camera.
    CameraInfo,
    /// It has another size than its camera.
    Size,
    /// It has more points than a sample.
    TooManyPoints,
    /// It is in another frame than its camera.
    OtherCamera,
    /// Its points are in another unit.
    Scale,
}

impl WireRefusal {
    /// All of them, in their order.
    pub const ALL: [Self; 14] = [
        Self::TooLong,
        Self::OtherType,
        Self::Attachment,
        Self::Damaged,
        Self::NoDepth,
        Self::OtherFrame,
        Self::NoStamp,
        Self::Ahead,
        Self::NoCameraInfo,
        Self::CameraInfo,
        Self::Size,
        Self::TooManyPoints,
        Self::OtherCamera,
        Self::Scale,
    ];

    /// Name of its count.
    pub fn name(self) -> &'static str {
        match self {
            Self::TooLong => "refused_too_long",
            Self::OtherType => "refused_other_type",
            Self::Attachment => "refused_attachment",
            Self::Damaged => "refused_damaged",
            Self::NoDepth => "refused_no_depth",
            Self::OtherFrame => "refused_other_frame",
            Self::NoStamp => "refused_no_stamp",
            Self::Ahead => "refused_ahead",
            Self::NoCameraInfo => "refused_no_camera_info",
            Self::CameraInfo => "refused_camera_info",
            Self::Size => "refused_size",
            Self::TooManyPoints => "refused_too_many_points",
            Self::OtherCamera => "refused_other_camera",
            Self::Scale => "refused_scale",
        }
    }

    /// What is wrong with the message, for people.
    pub fn reason(self) -> &'static str {
        match self {
            Self::TooLong => "it has more bytes than `max_bytes`",
            Self::OtherType => "it is of another type",
            Self::Attachment => "its number, time and sender are missing or damaged",
            Self::Damaged => "it is not a message of its type",
            Self::NoDepth => "it has no depth or no points",
            Self::OtherFrame => "it is in another frame than `frame_id`",
            Self::NoStamp => "its stamp is zero or before: set `stamps: arrival`",
            Self::Ahead => "its stamp is farther ahead of the clock than `clock_ahead`",
            Self::NoCameraInfo => "it came before any CameraInfo",
            Self::CameraInfo => "its CameraInfo describes no camera",
            Self::Size => "it has another size than its camera",
            Self::TooManyPoints => "it has more points than `max_points`",
            Self::OtherCamera => "it is in another frame than its CameraInfo",
            Self::Scale => "its points are in another unit",
        }
    }

    /// Why a message becomes no cloud; `None` where the fault is not that of the message.
    pub fn of(error: &MessageError) -> Option<Self> {
        use {DepthMessageError as Depth, PointCloud2Error as Cloud};
        Some(match error {
            MessageError::Cloud(Cloud::Cdr { .. } | Cloud::RowStep { .. } | Cloud::Data { .. })
            | MessageError::Depth(Depth::Cdr { .. } | Depth::Data { .. } | Depth::Png(_) | Depth::Rvl(_)) => {
                Self::Damaged
            }
            MessageError::Depth(Depth::Size { .. }) => Self::Size,
            MessageError::Cloud(_) | MessageError::Depth(_) => Self::NoDepth,
            MessageError::SelectedMessage(_) => Self::OtherCamera,
            MessageError::Scale(_) => Self::Scale,
            MessageError::TooLarge { .. } => Self::TooManyPoints,
            MessageError::Step(_) => return None,
        })
    }
}

/// Which time a message was acquired at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// That of its stamp, which may be ahead of this machine's clock by so much, ns.
    Stamp {
        /// How far.
        ahead: u64,
    },
    /// That of its arrival.
    Arrival,
}

/// Which messages of a topic are taken, whatever they hold: one rule for the wire and for a recording in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Admission<'a> {
    /// Frame of the messages; `None` takes all.
    pub frame: Option<&'a str>,
    /// Which time counts.
    pub clock: Clock,
}

impl Admission<'_> {
    /// Stamp of a message in CDR that is taken at `now`, ns; `None` where the time of its arrival counts.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn admit(&self, message: &[u8], now: u64) -> Result<Option<u64>, WireRefusal> {
        let mut reader = Reader::in_either_order(message).map_err(|_| WireRefusal::Damaged)?;
        let (stamp, frame) = reader.foreign_header().map_err(|_| WireRefusal::Damaged)?;
        if self.frame.is_some_and(|expected| expected != frame) {
            return Err(WireRefusal::OtherFrame);
        }
        match (self.clock, stamp) {
            (Clock::Arrival, _) => Ok(None),
            (Clock::Stamp { .. }, None) => Err(WireRefusal::NoStamp),
            (Clock::Stamp { ahead }, Some(stamp)) if stamp > now.saturating_add(ahead) => {
                Err(WireRefusal::Ahead)
            }
            (Clock::Stamp { .. }, Some(stamp)) => Ok(Some(stamp)),
        }
    }
}

/// What a topic has brought, by what became of it: a message is in exactly one count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages that became clouds.
    pub clouds: u64,
    /// Descriptions of the camera.
    pub camera_infos: u64,
    refused: [u64; WireRefusal::ALL.len()],
    /// Messages that the numbers of their senders show to be missing.
    pub lost: u64,
    senders: u64,
}

impl Counts {
    /// Entries of [`metrics`](Self::metrics).
    pub const METRICS: usize = 4 + WireRefusal::ALL.len();

    /// Counts a message that was refused.
    pub fn refuse(&mut self, refusal: WireRefusal) {
        self.refused[refusal as usize] += 1;
    }

    /// How many were refused for this reason.
    pub fn refused(&self, refusal: WireRefusal) -> u64 {
        self.refused[refusal as usize]
    }

    /// How many messages came.
    pub fn total(&self) -> u64 {
        self.clouds + self.camera_infos + self.refused.iter().sum::<u64>()
    }

    /// All counts with their names.
    pub fn metrics(&self) -> [Metric; Self::METRICS] {
        let first = [
            ("clouds", self.clouds),
            ("camera_infos", self.camera_infos),
            ("lost", self.lost),
            ("senders", self.senders),
        ];
        let refused = WireRefusal::ALL.map(|refusal| (refusal.name(), self.refused(refusal)));
        let mut all = first.into_iter().chain(refused);
        std::array::from_fn(|_| {
            let (name, count) = all.next().unwrap_or_default();
            Metric::new(name, count as f64)
        })
    }
}

/// A message that may become a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accepted<'a> {
    /// The message in CDR.
    pub message: &'a [u8],
    /// Number of the camera of an image.
    pub camera: usize,
    /// When it was acquired, session time, ns.
    pub acquired: u64,
}

/// What takes the messages of a topic, and of its camera.
pub struct Intake {
    /// Messages are images, on rays of a camera.
    has_camera: bool,
    clock: Clock,
    frame: Option<String>,
    cameras: Cameras,
    /// Number of the newest camera.
    camera: Option<usize>,
    /// The senders with the number of the last message of each, the one that sent last behind the others.
    senders: Vec<([u8; 16], u64)>,
    /// What came.
    pub counts: Counts,
}

/// Number of the subscription of the camera; the topic itself has 0.
pub const CAMERA_INFO: u32 = 1;

impl Intake {
    /// Of a topic of images on rays of `cameras`, or of clouds. Messages of another frame than `frame` are refused.
    pub fn new(has_camera: bool, clock: Clock, frame: Option<String>, cameras: Cameras) -> Self {
        Self {
            has_camera,
            clock,
            frame,
            cameras,
            camera: None,
            senders: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// The cameras so far.
    pub fn cameras(&self) -> &Cameras {
        &self.cameras
    }

    /// Looks at what the bridge handed over at `now`, session time in ns. `None`: it was the description of a camera.
    ///
    /// # Errors
    /// Why it was refused. [`counts`](Self::counts) has it then; what is accepted is counted by whoever makes the cloud.
    pub fn accept<'a>(&mut self, bytes: &'a [u8], now: u64) -> Result<Option<Accepted<'a>>, WireRefusal> {
        let accepted = self.look(bytes, now);
        match &accepted {
            Ok(Some(_)) => {}
            Ok(None) => self.counts.camera_infos += 1,
            Err(refusal) => self.counts.refuse(*refusal),
        }
        accepted
    }

    fn look<'a>(&mut self, bytes: &'a [u8], now: u64) -> Result<Option<Accepted<'a>>, WireRefusal> {
        let delivery = Delivery::parse(bytes).map_err(|_| WireRefusal::Damaged)?;
        let (attachment, message) = match delivery.content {
            Content::Message { attachment, message } => (attachment, message),
            Content::TooLong => return Err(WireRefusal::TooLong),
            Content::OtherType => return Err(WireRefusal::OtherType),
            Content::Attachment => return Err(WireRefusal::Attachment),
        };
        let attachment = Attachment::parse(attachment).map_err(|_| WireRefusal::Attachment)?;
        self.follow(&attachment);
        if self.has_camera && delivery.subscription == CAMERA_INFO {
            self.camera = Some(self.cameras.number(message).map_err(|error| match error {
                CamerasError::TooLarge { .. } => WireRefusal::TooManyPoints,
                CamerasError::Info(_) | CamerasError::TooMany => WireRefusal::CameraInfo,
            })?);
            return Ok(None);
        }
        let admission = Admission { frame: self.frame.as_deref(), clock: self.clock };
        let acquired = admission.admit(message, now)?.unwrap_or(delivery.arrived);
        let camera = match (self.has_camera, self.camera) {
            (true, None) => return Err(WireRefusal::NoCameraInfo),
            (true, Some(camera)) => camera,
            (false, _) => 0,
        };
        // A clock that is a little ahead acquires nothing in the future.
        Ok(Some(Accepted { message, camera, acquired: acquired.min(now) }))
    }

    /// Counts what is missing before a message of its sender.
    fn follow(&mut self, attachment: &Attachment) {
        let Attachment { sequence, gid, .. } = *attachment;
        let last = match self.senders.iter().position(|(known, _)| *known == gid) {
            Some(place) => {
                let (_, last) = self.senders.remove(place);
                let missing = sequence.saturating_sub(last.saturating_add(1));
                self.counts.lost = self.counts.lost.saturating_add(missing);
                last.max(sequence)
            }
            None => {
                self.counts.senders += 1;
                if self.senders.len() == MOST_SENDERS {
                    self.senders.remove(0);
                }
                sequence
            }
        };
        self.senders.push((gid, last));
    }
}
