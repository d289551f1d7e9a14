//! `stillpoint calibrate camera`

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use nalgebra::{Isometry3, Point3, Vector3};
use serde_json::{Map, Value, json};
use stillpoint_operator::frames::{Frame, Frames, Rigid};
use stillpoint_pose::isometry;
use stillpoint_recorder::Session;
use stillpoint_segment::extrinsic::{Still, at_and_rotation};

use super::{balls, board, edges, images};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::quantity::within;
use crate::recorded::with_topics;

const DAY_NS: u64 = 86_400_000_000_000;

/// Place a camera over the couch by balls, a printed board or the couch's edges, or check its place.
///
/// With --ball, a session has depth images or clouds of a bare couch with three balls or more; with --couch-width, of the bare
/// couch with its long edges and its head end. With --board, PNG files are grey images of a checkerboard, such as infrared or
/// amplitude images of a depth camera. Nothing moves meanwhile. The command finds the balls, edges or corners, prints how far
/// they are from their places, and prints the entry of `frames:` with date and residual. With --check, it compares the place with the one that the session has, and exits with 1 if it drifted.
#[derive(Args)]
#[command(group(ArgGroup::new("target").required(true).args(["balls", "board", "couch_width"])))]
pub struct Camera {
    /// The session with depth images or clouds; with --board, grey PNG files of 8 or 16 bits.
    #[arg(value_name = "SESSION|PNG", required = true)]
    images: Vec<PathBuf>,
    /// Topic of depth images or clouds of the camera.
    #[arg(long, value_name = "TOPIC", required_unless_present = "board", conflicts_with = "board")]
    topic: Option<String>,
    /// A ball: x, y and z of its centre over the couch, and its diameter, in mm, such as -110,-60,30,60. Three or more.
    #[arg(long = "ball", value_name = "X,Y,Z,DIAMETER", allow_hyphen_values = true)]
    balls: Vec<String>,
    /// A checkerboard: its inner corners along both sides, one number odd and one even, such as 11x8.
    #[arg(long, value_name = "COUNTxCOUNT", requires_all = ["square", "at", "intrinsics", "frame"])]
    board: Option<String>,
    /// Side of a square of the board as printed.
    #[arg(long, value_name = "LENGTH", requires = "board")]
    square: Option<String>,
    /// Where the middle of the board is over the couch: x, y and z in mm, and its turn about z in degrees, such as 0,30,2,90.
    /// The board's axis is along the odd number of corners, from the end with black outermost squares to the end with white
    /// ones; with turn 0, it is along x.
    #[arg(long, value_name = "X,Y,Z[,TURN]", allow_hyphen_values = true, requires = "board")]
    at: Option<String>,
    /// Focal lengths and principal point of the grey images, in pixels: fx,fy,cx,cy.
    #[arg(long, value_name = "FX,FY,CX,CY", requires = "board")]
    intrinsics: Option<String>,
    /// Width of the couch's top between its long edges.
    #[arg(long, value_name = "LENGTH", requires = "head_end")]
    couch_width: Option<String>,
    /// y of the edge at the head end of the couch's top.
    #[arg(long, value_name = "LENGTH", requires = "couch_width", allow_hyphen_values = true)]
    head_end: Option<String>,
    /// Frame of the couch.
    #[arg(long, value_name = "FRAME", default_value = "couch")]
    parent: String,
    /// Frame of the camera. Default: that of the topic.
    #[arg(long, value_name = "FRAME")]
    frame: Option<String>,
    /// Day of the measurement, such as 2026-11-28; not after that of the recording.
    #[arg(long, value_name = "DATE", required_unless_present = "check")]
    date: Option<String>,
    /// Compare with the place that the session has.
    #[arg(long)]
    check: bool,
    /// The session with the place to compare with. Default: that of the images.
    #[arg(long, value_name = "SESSION", requires = "check")]
    against: Option<PathBuf>,
    /// Largest drift at the balls, the board or the head end, with --check.
    #[arg(long, value_name = "LENGTH", default_value = "0.5mm")]
    drift: String,
    /// Largest turn, with --check.
    #[arg(long, value_name = "ANGLE", default_value = "0.1deg")]
    turn: String,
    /// Largest distance of a ball or a corner from its place.
    #[arg(long, value_name = "LENGTH", default_value = "1mm")]
    residual: String,
    /// Do not compare the couch around the balls with height 0. The residual then has 0.5 mm for each stated place.
    #[arg(long, conflicts_with_all = ["board", "couch_width"])]
    without_surface: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What images show of a camera, whatever they are of.
pub struct Found {
    pub couch_from_camera: Isometry3<f64>,
    /// The error of the place, m.
    pub error: f64,
    /// What is printed before the residual.
    pub lines: Vec<String>,
    /// Parts of the residual as they are printed.
    pub parts: String,
    /// How it was measured: the comment of the entry.
    pub method: String,
    /// The name of what is on the couch.
    pub target: &'static str,
    /// Where drift counts, in the couch's frame, m.
    pub places: Vec<Vector3<f64>>,
    /// Fields of the JSON that only this target has.
    pub fields: Map<String, Value>,
    /// Images that count.
    pub images: usize,
}

impl Camera {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let residual = 1e-3 * within("residual", &self.residual, "mm", [0.01, 20.0])?;
        let drift = within("drift", &self.drift, "mm", [0.01, 20.0])?;
        let turn = within("turn", &self.turn, "deg", [0.001, 10.0])?;
        let date = self.date.as_deref().map(date).transpose()?;
        let text = |given: &Option<String>| given.clone().unwrap_or_default();
        let (found, frame, session) = match (&self.board, &self.couch_width) {
            (Some(counts), _) => {
                let board = board::board(counts, &text(&self.square), &text(&self.at))?;
                let lens = board::lens(&text(&self.intrinsics))?;
                (board::found(&self.images, &board, &lens, residual)?, None, None)
            }
            (None, Some(width)) => {
                let couch = edges::couch(width, &text(&self.head_end))?;
                let found = self.in_session(date, |still| edges::found(still, &couch))?;
                (found.0, found.1, Some(found.2))
            }
            (None, None) => {
                let balls = balls::targets(&self.balls)?;
                let compare = !self.without_surface;
                let found = self.in_session(date, |still| balls::found(still, &balls, residual, compare))?;
                (found.0, found.1, Some(found.2))
            }
        };
        let frame = self.frame.clone().or(frame).ok_or_else(|| {
            Failure::wrong(format!(
                "{} is in no frame: name that of the camera with --frame",
                text(&self.topic)
            ))
        })?;
        let measured = Measured { found, frame, parent: self.parent.clone() };
        let drifted = match (self.check, &self.against, &session) {
            (false, ..) => None,
            (true, Some(path), _) => {
                Some(measured.drift(&with_topics(Session::open(path.as_path()), path)?)?)
            }
            (true, None, Some(session)) => Some(measured.drift(session)?),
            (true, None, None) => {
                return Err(Failure::wrong(
                    "--check: name the session with the place to compare with by --against",
                ));
            }
        };
        if self.json {
            print_json(&measured.reported(drifted))?;
        } else {
            measured.print();
            if let Some(date) = date {
                outln!("\n{}", measured.yaml(date));
            }
        }
        let Some(found) = drifted else { return Ok(Exit::Done) };
        let is_met = found.drift_mm <= drift && found.turn_deg <= turn;
        if !self.json {
            outln!(
                "\n{}: {:.2} mm at the {} (allowed: {drift} mm), {:.3} degrees (allowed: {turn})",
                if is_met { "pass" } else { "FAIL" },
                found.drift_mm,
                measured.found.target,
                found.turn_deg
            );
        }
        Ok(if is_met { Exit::Done } else { Exit::Failed })
    }

    /// What the images of a session show, with the frame of their topic.
    fn in_session(
        &self,
        date: Option<&str>,
        find: impl FnOnce(&Still) -> Result<Found, Failure>,
    ) -> Result<(Found, Option<String>, Session), Failure> {
        let [path] = self.images.as_slice() else {
            return Err(Failure::wrong(format!("{} sessions are given: give one", self.images.len())));
        };
        let images = images::read(path, self.topic.as_deref().unwrap_or_default())?;
        // A simulated session has no day.
        let clock = images.session.clock().first().filter(|clock| clock.realtime_ns > 0);
        if let (Some(date), Some(clock)) = (date, clock) {
            not_later(date, clock.realtime_ns / DAY_NS)?;
        }
        let still = images.images.still().map_err(Failure::wrong)?;
        let found = Found { images: images.images.count(), ..find(&still)? };
        Ok((found, images.frame, images.session))
    }
}

/// How far a camera is from where the session has it.
#[derive(Clone, Copy)]
struct Drift {
    drift_mm: f64,
    turn_deg: f64,
}

/// A camera with its names.
struct Measured {
    found: Found,
    frame: String,
    parent: String,
}

impl Measured {
    /// The error that the pipeline file states, mm, rounded up.
    fn residual_mm(&self) -> f64 {
        (1e5 * self.found.error).ceil() / 100.0
    }

    fn print(&self) {
        for line in &self.found.lines {
            outln!("{line}");
        }
        outln!("residual: {:.2} mm ({})", self.residual_mm(), self.found.parts);
        outln!("images: {}", self.found.images);
    }

    /// The entry of `frames:`.
    fn yaml(&self, date: &str) -> String {
        let (at, rotation) = at_and_rotation(&self.found.couch_from_camera);
        let at = at.map(|part| format!("{:.3} mm", 1e3 * part)).join(", ");
        let rotation = rotation.map(|part| format!("{:.4} deg", part.to_degrees())).join(", ");
        format!(
            "frames:\n  # stillpoint calibrate camera: {}\n  {}: {{ parent: {}, at: [{at}], rotation: [{rotation}], measured: \
             {date}, residual: {:.2} mm }}",
            self.found.method,
            self.frame,
            self.parent,
            self.residual_mm(),
        )
    }

    fn drift(&self, session: &Session) -> Result<Drift, Failure> {
        let mut frames = Frames::default();
        for placed in session.frames() {
            let turn = isometry(placed.translation, placed.rotation).rotation.to_rotation_matrix();
            let rotation = std::array::from_fn(|row| std::array::from_fn(|column| turn[(row, column)]));
            let parent_from_frame = Rigid { translation: placed.translation, rotation };
            let parent = placed.parent.clone();
            let frame = Frame { parent, parent_from_frame, measured: None, residual: None };
            frames.placed.insert(placed.child.clone(), frame);
        }
        let before = frames.transform(&self.parent, &self.frame).ok_or_else(|| {
            Failure::wrong(format!(
                "the session does not place {} in {}: there is nothing to compare with; name frames of its pipeline",
                self.frame, self.parent
            ))
        })?;
        let before: Isometry3<f64> = isometry(before.translation, before.quaternion());
        let now = &self.found.couch_from_camera;
        // Where the old place would have each ball or corner.
        let off = |at: &Vector3<f64>| {
            let at = Point3::from(*at);
            (before * now.inverse() * at - at).norm()
        };
        let drift_mm = 1e3 * self.found.places.iter().map(off).fold(0.0, f64::max);
        Ok(Drift { drift_mm, turn_deg: before.rotation.angle_to(&now.rotation).to_degrees() })
    }

    fn reported(&self, drift: Option<Drift>) -> Value {
        let (at, rotation) = at_and_rotation(&self.found.couch_from_camera);
        let mut fields = self.found.fields.clone();
        let common = json!({
            "frame": self.frame,
            "parent": self.parent,
            "at_m": at,
            "rotation_rad": rotation,
            "residual_mm": self.residual_mm(),
            "images": self.found.images,
            "drift_mm": drift.map(|drift| drift.drift_mm),
            "turn_deg": drift.map(|drift| drift.turn_deg),
        });
        if let Value::Object(common) = common {
            fields.extend(common);
        }
        Value::Object(fields)
    }
}

/// A day as `frames:` takes it.
fn date(text: &str) -> Result<&str, Failure> {
    let numbers: Vec<Option<u32>> = text.split('-').map(|part| part.parse().ok()).collect();
    let is_shaped = text.len() == 10 && text.as_bytes()[4] == b'-' && text.as_bytes()[7] == b'-';
    match numbers.as_slice() {
        [Some(year), Some(month), Some(day)] if is_shaped && (1..=days(*year, *month)).contains(day) => {
            Ok(text)
        }
        _ => Err(Failure::wrong(format!("--date {text}: give a day as YYYY-MM-DD, such as 2026-11-28"))),
    }
}

/// Refuses a day after that of the recording, a day of UTC from 1970-01-01. Clocks on land are up to 14 hours ahead of it.
fn not_later(date: &str, recorded: u64) -> Result<(), Failure> {
    let [year, month, day] = [&date[..4], &date[5..7], &date[8..]].map(|part| part.parse().unwrap_or(0));
    let before: u32 = (1970..year).map(|year| 337 + days(year, 2)).sum();
    let in_year: u32 = (1..month).map(|month| days(year, month)).sum();
    match u64::from(before + in_year + day).saturating_sub(1) > recorded + 1 {
        true => Err(Failure::wrong(format!(
            "--date {date}: the session was recorded before that day; give the day of the measurement"
        ))),
        false => Ok(()),
    }
}

/// Days of a month; 0 for a month that does not exist.
fn days(year: u32, month: u32) -> u32 {
    match month {
        2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    }
}
