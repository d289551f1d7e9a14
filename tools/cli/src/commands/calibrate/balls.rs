//! A camera by balls of known size and place.

use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use stillpoint_segment::extrinsic::{Ball, Limits, Parts, Placed, Still, Targets, place};

use super::camera::Found;
use crate::exit::Failure;
use crate::quantity::millimetres;

/// The balls of the command line.
pub fn targets(texts: &[String]) -> Result<Targets, Failure> {
    let balls = texts.iter().map(|text| ball(text)).collect::<Result<_, _>>()?;
    Targets::new(balls).map_err(Failure::wrong)
}

/// Finds the balls; `compare` is whether the couch around them counts.
pub fn found(still: &Still, targets: &Targets, residual: f64, compare: bool) -> Result<Found, Failure> {
    let surface = if compare { Limits::default().surface } else { None };
    let limits = Limits { residual, surface, ..Limits::default() };
    let placed = place(still, targets, limits).map_err(Failure::failed)?;
    let Parts { balls, height, tilt, scale, stated } = placed.error;
    let [balls, height, tilt, scale, stated] = [balls, height, tilt, scale, stated].map(|m| 1e3 * m);
    let couch = match placed.surface {
        Some(_) => format!("height {height:.2}, tilt at a head {tilt:.2}"),
        None => format!("stated places of the balls at a head {stated:.2}"),
    };
    Ok(Found {
        couch_from_camera: placed.couch_from_camera,
        error: placed.error.sum(),
        lines: lines(&placed, targets),
        parts: format!("balls {balls:.2}, {couch}, scale at a head {scale:.2}"),
        method: format!(
            "{} balls, largest distance of a ball from its place {:.2} mm",
            placed.balls.len(),
            1e3 * placed.residual()
        ),
        target: "balls",
        places: targets.balls().iter().map(|ball| ball.at).collect(),
        fields: fields(&placed),
        images: 0,
    })
}

fn lines(placed: &Placed, targets: &Targets) -> Vec<String> {
    let ball = |((found, given), off): ((&_, &Ball), &f64)| {
        let found: &stillpoint_segment::extrinsic::FoundBall = found;
        let [x, y, z] = [0, 1, 2].map(|axis| 1e3 * given.at[axis]);
        format!(
            "ball at ({x}, {y}, {z}) mm: {:.2} mm off, diameter {:.2} mm (given: {:.2}), {} points, depths {:.2} mm rms",
            1e3 * off,
            2e3 * found.free_radius,
            1e3 * given.diameter,
            found.points,
            1e3 * found.rms
        )
    };
    let mut lines: Vec<String> =
        placed.balls.iter().zip(targets.balls()).zip(&placed.residuals).map(ball).collect();
    lines.push(format!("distances between balls: {:+.2} % of those given", 100.0 * placed.scale));
    lines.push(match placed.surface {
        Some(surface) => format!(
            "couch around the balls: {:+.2} mm high, tilted by {:.3} degrees, {:.2} mm rms from a plane, {} points",
            1e3 * surface.height,
            surface.tilt.to_degrees(),
            1e3 * surface.rms,
            surface.points
        ),
        None => "couch around the balls: not compared".to_owned(),
    });
    lines
}

fn fields(placed: &Placed) -> Map<String, Value> {
    let fields = json!({
        "ball_residuals_mm": placed.residuals.iter().map(|off| 1e3 * off).collect::<Vec<_>>(),
        "distance_scale": placed.scale,
        "residual_parts_mm": {
            "balls": 1e3 * placed.error.balls,
            "height": 1e3 * placed.error.height,
            "tilt": 1e3 * placed.error.tilt,
            "scale": 1e3 * placed.error.scale,
            "stated": 1e3 * placed.error.stated,
        },
        "surface_height_mm": placed.surface.map(|surface| 1e3 * surface.height),
        "surface_tilt_deg": placed.surface.map(|surface| surface.tilt.to_degrees()),
    });
    if let Value::Object(fields) = fields { fields } else { Map::new() }
}

/// A ball of the command line.
fn ball(text: &str) -> Result<Ball, Failure> {
    let parts: Vec<&str> = text.split(',').collect();
    let &[x, y, z, diameter] = parts.as_slice() else {
        return Err(Failure::wrong(format!(
            "--ball {text}: give x,y,z,diameter in mm, such as -110,-60,30,60"
        )));
    };
    let mm = |part: &str| millimetres(part, &format!("--ball {text}"));
    let at = Vector3::new(mm(x)?, mm(y)?, mm(z)?) * 1e-3;
    Ok(Ball { at, diameter: 1e-3 * mm(diameter)? })
}
