//! A camera by the plane and the edges of the bare couch.

use serde_json::{Map, Value, json};
use stillpoint_segment::extrinsic::Still;
use stillpoint_segment::extrinsic::edges::{Couch, EdgeParts, EdgePlace, place_by_edges};

use super::camera::Found;
use crate::exit::Failure;
use crate::quantity::within;

/// The couch of the command line.
pub fn couch(width: &str, head_end: &str) -> Result<Couch, Failure> {
    let width = 1e-3 * within("couch-width", width, "mm", [200.0, 1000.0])?;
    let head_end = 1e-3 * within("head-end", head_end, "mm", [-1000.0, 2000.0])?;
    Couch::new(width, head_end).map_err(Failure::wrong)
}

/// Finds the plane and the edges.
pub fn found(still: &Still, couch: &Couch) -> Result<Found, Failure> {
    let placed = place_by_edges(still, couch).map_err(Failure::failed)?;
    let EdgeParts { pixels, blur, plane, stated } = placed.error;
    let [pixels, blur, plane, stated] = [pixels, blur, plane, stated].map(|m| 1e3 * m);
    Ok(Found {
        couch_from_camera: placed.couch_from_camera,
        error: placed.error.sum(),
        lines: lines(&placed),
        parts: format!(
            "pixels of the edges {pixels:.2}, their blur {blur:.2}, plane {plane:.2}, stated width and head end {stated:.2}"
        ),
        method: format!(
            "plane and three edges of the couch, width measured {:+.2} mm of that given",
            1e3 * placed.width
        ),
        target: "head end",
        places: couch.corners().to_vec(),
        fields: fields(&placed),
        images: 0,
    })
}

fn lines(placed: &EdgePlace) -> Vec<String> {
    let (points, rms) = placed.plane;
    let names = ["long edge", "long edge", "head end"];
    let mut lines = vec![format!("couch: {points} points, {:.2} mm rms from a plane", 1e3 * rms)];
    lines.extend(names.iter().zip(&placed.edges).map(|(name, edge)| {
        format!(
            "{name}: {} places, {:.2} px rms from a line, across {} lines of pixels of {:.2} mm",
            edge.places,
            edge.scatter,
            edge.lines,
            1e3 * edge.pixel
        )
    }));
    lines.push(format!(
        "width: {:+.2} mm of that given, so each edge appears {:.2} px inwards",
        1e3 * placed.width,
        placed.blur
    ));
    lines.push(format!(
        "head end: {:.3} degrees from square to the long edges",
        placed.off_square.to_degrees()
    ));
    lines
}

fn fields(placed: &EdgePlace) -> Map<String, Value> {
    let fields = json!({
        "plane_points": placed.plane.0,
        "plane_rms_mm": 1e3 * placed.plane.1,
        "edge_places": placed.edges.map(|edge| edge.places),
        "edge_rms_px": placed.edges.map(|edge| edge.scatter),
        "width_off_mm": 1e3 * placed.width,
        "blur_px": placed.blur,
        "off_square_deg": placed.off_square.to_degrees(),
        "residual_parts_mm": {
            "pixels": 1e3 * placed.error.pixels,
            "blur": 1e3 * placed.error.blur,
            "plane": 1e3 * placed.error.plane,
            "stated": 1e3 * placed.error.stated,
        },
    });
    if let Value::Object(fields) = fields { fields } else { Map::new() }
}
