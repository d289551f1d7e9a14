//! `stillpoint calibrate camera`

use std::path::PathBuf;

use clap::Args;
use nalgebra::{Isometry3, Point3, Vector3};
use serde_json::{Value, json};
use stillpoint_operator::frames::{Frame, Frames, Rigid};
use stillpoint_pose::isometry;
use stillpoint_recorder::Session;
use stillpoint_segment::extrinsic::{Ball, Limits, Parts, Placed, Targets, place};

use super::images;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::quantity::{quantity, within};

const DAY_NS: u64 = 86_400_000_000_000;

/// Place a camera over the couch by three balls of known size and place, or check its place.
///
/// The session has depth images or clouds of a bare couch with the balls; nothing moves. The command finds the balls in the
/// median of the images, prints how far each is from its place, and prints the entry of `frames:` with date and residual.
/// With --check, it compares the place with the one that the session has, and exits with 1 if it drifted.
#[derive(Args)]
pub struct Camera {
    /// The session with the images.
    session: PathBuf,
    /// Topic of depth images or clouds of the camera.
    #[arg(long, value_name = "TOPIC")]
    topic: String,
    /// A ball: x, y and z of its centre over the couch, and its diameter, in mm, such as -110,-60,30,60. Three or more.
    #[arg(long = "ball", value_name = "X,Y,Z,DIAMETER", required = true, allow_hyphen_values = true)]
    balls: Vec<String>,
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
    /// Largest drift at the balls, with --check.
    #[arg(long, value_name = "LENGTH", default_value = "0.5mm")]
    drift: String,
    /// Largest turn, with --check.
    #[arg(long, value_name = "ANGLE", default_value = "0.1deg")]
    turn: String,
    /// Largest distance of a ball from its place.
    #[arg(long, value_name = "LENGTH", default_value = "1mm")]
    residual: String,
    /// Do not compare the couch around the balls with height 0. The residual then has 0.5 mm for each stated place.
    #[arg(long)]
    without_surface: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Camera {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let residual = 1e-3 * within("residual", &self.residual, "mm", [0.01, 20.0])?;
        let drift = within("drift", &self.drift, "mm", [0.01, 20.0])?;
        let turn = within("turn", &self.turn, "deg", [0.001, 10.0])?;
        let date = self.date.as_deref().map(date).transpose()?;
        let balls = self.balls.iter().map(|text| ball(text)).collect::<Result<_, _>>()?;
        let targets = Targets::new(balls).map_err(Failure::wrong)?;
        let images = images::read(&self.session, &self.topic)?;
        // A simulated session has no day.
        let clock = images.session.clock().first().filter(|clock| clock.realtime_ns > 0);
        if let (Some(date), Some(clock)) = (date, clock) {
            not_later(date, clock.realtime_ns / DAY_NS)?;
        }
        let still = images.images.still().map_err(Failure::wrong)?;
        let surface = if self.without_surface { None } else { Limits::default().surface };
        let limits = Limits { residual, surface, ..Limits::default() };
        let placed = place(&still, &targets, limits).map_err(Failure::failed)?;
        let frame = self.frame.clone().or(images.frame.clone()).ok_or_else(|| {
            Failure::wrong(format!("{} is in no frame: name that of the camera with --frame", self.topic))
        })?;
        let measured = Measured { placed, frame, parent: self.parent.clone(), images: images.images.count() };
        let drifted = match self.check {
            true => Some(measured.drift(&images.session, &targets)?),
            false => None,
        };
        if self.json {
            print_json(&measured.reported(drifted))?;
        } else {
            measured.print(&targets);
            if let Some(date) = date {
                outln!("\n{}", measured.yaml(date));
            }
        }
        let Some(found) = drifted else { return Ok(Exit::Done) };
        let is_met = found.drift_mm <= drift && found.turn_deg <= turn;
        if !self.json {
            outln!(
                "\n{}: {:.2} mm at the balls (allowed: {drift} mm), {:.3} degrees (allowed: {turn})",
                if is_met { "pass" } else { "FAIL" },
                found.drift_mm,
                found.turn_deg
            );
        }
        Ok(if is_met { Exit::Done } else { Exit::Failed })
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
    placed: Placed,
    frame: String,
    parent: String,
    images: usize,
}

impl Measured {
    /// The error that the pipeline file states, mm, rounded up.
    fn residual_mm(&self) -> f64 {
        (1e5 * self.placed.error.sum()).ceil() / 100.0
    }

    fn print(&self, targets: &Targets) {
        for ((found, given), off) in self.placed.balls.iter().zip(targets.balls()).zip(&self.placed.residuals)
        {
            let [x, y, z] = [0, 1, 2].map(|axis| 1e3 * given.at[axis]);
            outln!(
                "ball at ({x}, {y}, {z}) mm: {:.2} mm off, diameter {:.2} mm (given: {:.2}), {} points, depths {:.2} mm rms",
                1e3 * off,
                2e3 * found.free_radius,
                1e3 * given.diameter,
                found.points,
                1e3 * found.rms
            );
        }
        outln!("distances between balls: {:+.2} % of those given", 100.0 * self.placed.scale);
        match self.placed.surface {
            Some(surface) => outln!(
                "couch around the balls: {:+.2} mm high, tilted by {:.3} degrees, {:.2} mm rms from a plane, {} points",
                1e3 * surface.height,
                surface.tilt.to_degrees(),
                1e3 * surface.rms,
                surface.points
            ),
            None => outln!("couch around the balls: not compared"),
        }
        let Parts { balls, height, tilt, scale, stated } = self.placed.error;
        let [balls, height, tilt, scale, stated] = [balls, height, tilt, scale, stated].map(|m| 1e3 * m);
        let couch = match self.placed.surface {
            Some(_) => format!("height {height:.2}, tilt at a head {tilt:.2}"),
            None => format!("stated places of the balls at a head {stated:.2}"),
        };
        outln!(
            "residual: {:.2} mm (balls {balls:.2}, {couch}, scale at a head {scale:.2})",
            self.residual_mm()
        );
        outln!("images: {}", self.images);
    }

    /// The entry of `frames:`.
    fn yaml(&self, date: &str) -> String {
        let (at, rotation) = self.placed.at_and_rotation();
        let at = at.map(|part| format!("{:.3} mm", 1e3 * part)).join(", ");
        let rotation = rotation.map(|part| format!("{:.4} deg", part.to_degrees())).join(", ");
        format!(
            "frames:\n  # stillpoint calibrate camera: {} balls, {} images, largest distance of a ball from its place {:.2} mm\n  \
             {}: {{ parent: {}, at: [{at}], rotation: [{rotation}], measured: {date}, residual: {:.2} mm }}",
            self.placed.balls.len(),
            self.images,
            1e3 * self.placed.residual(),
            self.frame,
            self.parent,
            self.residual_mm(),
        )
    }

    fn drift(&self, session: &Session, targets: &Targets) -> Result<Drift, Failure> {
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
        let now = &self.placed.couch_from_camera;
        // Where the old place would have each ball.
        let off = |ball: &Ball| {
            let at = Point3::from(ball.at);
            (before * now.inverse() * at - at).norm()
        };
        let drift_mm = 1e3 * targets.balls().iter().map(off).fold(0.0, f64::max);
        Ok(Drift { drift_mm, turn_deg: before.rotation.angle_to(&now.rotation).to_degrees() })
    }

    fn reported(&self, drift: Option<Drift>) -> Value {
        let (at, rotation) = self.placed.at_and_rotation();
        json!({
            "frame": self.frame,
            "parent": self.parent,
            "at_m": at,
            "rotation_rad": rotation,
            "residual_mm": self.residual_mm(),
            "ball_residuals_mm": self.placed.residuals.iter().map(|off| 1e3 * off).collect::<Vec<_>>(),
            "distance_scale": self.placed.scale,
            "residual_parts_mm": {
                "balls": 1e3 * self.placed.error.balls,
                "height": 1e3 * self.placed.error.height,
                "tilt": 1e3 * self.placed.error.tilt,
                "scale": 1e3 * self.placed.error.scale,
                "stated": 1e3 * self.placed.error.stated,
            },
            "surface_height_mm": self.placed.surface.map(|surface| 1e3 * surface.height),
            "surface_tilt_deg": self.placed.surface.map(|surface| surface.tilt.to_degrees()),
            "images": self.images,
            "drift_mm": drift.map(|drift| drift.drift_mm),
            "turn_deg": drift.map(|drift| drift.turn_deg),
        })
    }
}

/// A ball of the command line.
fn ball(text: &str) -> Result<Ball, Failure> {
    let parts: Vec<&str> = text.split(',').collect();
    let &[x, y, z, diameter] = parts.as_slice() else {
        return Err(Failure::wrong(format!(
            "--ball {text}: give x,y,z,diameter in mm, such as -110,-60,30,60"
        )));
    };
    let mm = |part: &str| {
        let part = part.trim();
        let with_unit = if part.ends_with("mm") { part.to_owned() } else { format!("{part}mm") };
        quantity(&with_unit, "mm", &format!("--ball {text}"))
    };
    let at = Vector3::new(mm(x)?, mm(y)?, mm(z)?) * 1e-3;
    Ok(Ball { at, diameter: 1e-3 * mm(diameter)? })
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
            "--date {date}: the session was recorded before that day; give the day on which the balls were measured"
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
