//! A camera by a printed board.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use stillpoint_ingest::{depth, grey};
use stillpoint_segment::extrinsic::board::{
    Board, BoardError, BoardLimits, BoardParts, BoardPlace, Lens, Picture, place_by_board,
};

use super::camera::Found;
use crate::exit::Failure;
use crate::quantity::{millimetres, quantity, within};

/// Most images that are read.
const MOST: usize = 60;

/// The board of the command line.
pub fn board(counts: &str, square: &str, at: &str) -> Result<Board, Failure> {
    let numbers: Vec<usize> = counts.split('x').filter_map(|part| part.trim().parse().ok()).collect();
    let &[along, across] = numbers.as_slice() else {
        return Err(Failure::wrong(format!(
            "--board {counts}: give the inner corners along both sides, such as 11x8"
        )));
    };
    let square = 1e-3 * within("square", square, "mm", [2.0, 200.0])?;
    let parts: Vec<&str> = at.split(',').collect();
    let [x, y, z, turn] = match *parts.as_slice() {
        [x, y, z] => [x, y, z, "0"],
        [x, y, z, turn] => [x, y, z, turn],
        _ => {
            return Err(Failure::wrong(format!(
                "--at {at}: give x,y,z of the board's middle in mm, and its turn in degrees, such as 0,30,2,90"
            )));
        }
    };
    let whole = format!("--at {at}");
    let mm = |part: &str| millimetres(part, &whole);
    let middle = Vector3::new(mm(x)?, mm(y)?, mm(z)?) * 1e-3;
    let turn = turn.trim();
    let turn = if turn.ends_with("deg") { turn.to_owned() } else { format!("{turn}deg") };
    let turn = quantity(&turn, "deg", &whole)?.to_radians();
    Board::new([along, across], square, middle, turn).map_err(Failure::wrong)
}

/// The intrinsics of the command line.
pub fn lens(text: &str) -> Result<Lens, Failure> {
    let numbers: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match numbers.as_slice() {
        &[fx, fy, cx, cy] => Ok(Lens { fx, fy, cx, cy }),
        _ => Err(Failure::wrong(format!(
            "--intrinsics {text}: give fx,fy,cx,cy in pixels, such as 365.5,365.5,255.5,211.5"
        ))),
    }
}

/// Finds the board in the images.
pub fn found(paths: &[PathBuf], board: &Board, lens: &Lens, residual: f64) -> Result<Found, Failure> {
    let pictures = paths.iter().take(MOST).map(|path| picture(path)).collect::<Result<Vec<_>, _>>()?;
    let limits = BoardLimits { residual, ..BoardLimits::default() };
    let placed = place_by_board(&pictures, board, lens, limits).map_err(|fault| match fault {
        BoardError::Intrinsics { .. } | BoardError::Size { .. } => Failure::wrong(fault),
        fault => Failure::failed(fault),
    })?;
    let BoardParts { corners, noise, scale } = placed.error;
    let [corners, noise, scale] = [corners, noise, scale].map(|m| 1e3 * m);
    Ok(Found {
        couch_from_camera: placed.couch_from_camera,
        error: placed.error.sum(),
        lines: lines(&placed),
        parts: format!("corners {corners:.2}, noise at a head {noise:.2}, scale at a head {scale:.2}"),
        method: format!(
            "board of {} x {} corners, {} images, largest distance of a corner from its place {corners:.2} mm",
            board.along,
            board.across,
            pictures.len()
        ),
        target: "board",
        places: placed.outermost.to_vec(),
        fields: fields(&placed),
        images: pictures.len(),
    })
}

fn lines(placed: &BoardPlace) -> Vec<String> {
    let at = placed.couch_from_camera.translation.vector * 1e3;
    let to = |value: f64, [more, less]: [&str; 2]| {
        format!("{:.0} mm {}", value.abs(), if value < 0.0 { less } else { more })
    };
    let (focal, sigma) = placed.focal;
    vec![
        format!(
            "{} corners: {:.3} px rms, at most {:.3} px or {:.2} mm from their places; squares of {:.1} px at least",
            placed.corners,
            placed.rms,
            placed.largest,
            1e3 * placed.error.corners,
            placed.shortest
        ),
        format!(
            "turn known to {:.3} degrees, board seen {:.0} degrees from its normal",
            placed.tilt.to_degrees(),
            placed.oblique.to_degrees()
        ),
        format!(
            "focal length by the perspective of the board: {:+.2} % of that given, known to {:.2} %",
            100.0 * focal,
            100.0 * sigma
        ),
        format!(
            "camera: {}, {}, {}; check this, since a board looks the same in a mirror",
            to(at.x, ["to the patient's left", "to the patient's right"]),
            to(at.y, ["to the head end", "to the feet"]),
            to(at.z, ["up", "down"])
        ),
    ]
}

fn fields(placed: &BoardPlace) -> Map<String, Value> {
    let (focal, sigma) = placed.focal;
    let fields = json!({
        "corners": placed.corners,
        "corner_rms_px": placed.rms,
        "corner_largest_px": placed.largest,
        "turn_sigma_deg": placed.tilt.to_degrees(),
        "oblique_deg": placed.oblique.to_degrees(),
        "focal_scale": focal,
        "focal_scale_sigma": sigma.is_finite().then_some(sigma),
        "residual_parts_mm": {
            "corners": 1e3 * placed.error.corners,
            "noise": 1e3 * placed.error.noise,
            "scale": 1e3 * placed.error.scale,
        },
    });
    if let Value::Object(fields) = fields { fields } else { Map::new() }
}

/// A grey PNG of 8 or 16 bits.
fn picture(path: &Path) -> Result<Picture, Failure> {
    let wrong = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(path).map_err(|fault| wrong(&fault))?;
    let (size, pixels) = match grey::decode_png(&bytes) {
        Err(grey::GreyError::PixelType { bits: 16, colour: "greyscale" }) => {
            let image = depth::decode_png(&bytes).map_err(|fault| wrong(&fault))?;
            ([image.width, image.height], image.counts.iter().map(|count| f32::from(*count)).collect())
        }
        image => {
            let image = image.map_err(|fault| wrong(&fault))?;
            ([image.width, image.height], image.pixels.iter().map(|count| f32::from(*count)).collect())
        }
    };
    Picture::new(size, pixels).map_err(|fault| wrong(&fault))
}
