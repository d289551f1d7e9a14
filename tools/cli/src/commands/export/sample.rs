//! One sample as a file of its own: a cloud as PLY or PCD, an image as PNG.

use std::io::Write;
use std::path::Path;

use stillpoint_ingest::pcd;
use stillpoint_recorder::{Recorded, Session};
use stillpoint_samples::{DepthImage, GreyImage, Pieces, PointCloud, Sample, SampleKind};

use super::{Format, Written};
use crate::exit::Failure;
use crate::private;

/// Writes the sample of this number of a topic into a folder. Of several incarnations, the first that has it.
pub fn write(
    session: &Session,
    topic: usize,
    sequence: u64,
    format: Format,
    out: &Path,
) -> Result<Written, Failure> {
    let name = session.topics()[topic].name.clone();
    let (recorded, kind) = find(session, topic, sequence)?;
    let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
    let wrong =
        |what: &str| Failure::wrong(format!("{name} has samples of the type {}: --format {what}", kind.name));
    let (bytes, extension) = match format {
        Format::Ply | Format::Pcd if *kind == *PointCloud::KIND => {
            let view = pieces.view::<PointCloud>().map_err(Failure::failed)?;
            let points: Vec<[f32; 3]> = view.elements.iter().map(|p| p.xyz).collect();
            match format {
                Format::Ply => (ply(&points), "ply"),
                _ => (pcd::write_binary(&points, view.body.width as usize), "pcd"),
            }
        }
        Format::Png if *kind == *DepthImage::KIND => {
            let view = pieces.view::<DepthImage>().map_err(Failure::failed)?;
            let bytes: Vec<u8> = view.elements.iter().flat_map(|count| count.to_be_bytes()).collect();
            (png(view.body.width, view.body.height, png::BitDepth::Sixteen, &bytes)?, "png")
        }
        Format::Png if *kind == *GreyImage::KIND => {
            let view = pieces.view::<GreyImage>().map_err(Failure::failed)?;
            (png(view.body.width, view.body.height, png::BitDepth::Eight, view.elements)?, "png")
        }
        Format::Ply | Format::Pcd => return Err(wrong("ply and --format pcd need a PointCloud")),
        _ => return Err(wrong("png needs a DepthImage or a GreyImage")),
    };
    let file = out.join(format!("{}.{sequence:06}.{extension}", name.replace(['/', '\\'], "_")));
    private::create(&file)
        .and_then(|mut created| created.write_all(&bytes))
        .map_err(|e| Failure::failed(format!("{}: {e}", file.display())))?;
    Ok(Written { file, topic: name, samples: 1, lines: 0 })
}

fn find(session: &Session, topic: usize, sequence: u64) -> Result<(Recorded, &'static SampleKind), Failure> {
    let found = &session.topics()[topic];
    let name = &found.name;
    let number = session.numbers(topic).find(|(_, number)| *number == sequence);
    let recorded = match number {
        Some((incarnation, _)) => session.sample(topic, incarnation, sequence).map_err(Failure::failed)?,
        None => None,
    };
    match (recorded, found.kind.kind()) {
        (Some(recorded), Some(kind)) => Ok((recorded, kind)),
        _ => {
            let numbers: Vec<u64> = session.numbers(topic).map(|(_, number)| number).collect();
            let range = match (numbers.iter().min(), numbers.iter().max()) {
                (Some(first), Some(last)) => format!("it has {first} to {last}"),
                _ => "it has none".to_owned(),
            };
            Err(Failure::wrong(format!("{name} has no sample {sequence} in the session; {range}")))
        }
    }
}

/// A binary PLY file of the points that were measured.
fn ply(points: &[[f32; 3]]) -> Vec<u8> {
    let measured: Vec<&[f32; 3]> = points.iter().filter(|p| p.iter().all(|c| c.is_finite())).collect();
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n",
        measured.len()
    )
    .into_bytes();
    file.extend(measured.into_iter().flatten().flat_map(|c| c.to_le_bytes()));
    file
}

fn png(width: u32, height: u32, depth: png::BitDepth, pixels: &[u8]) -> Result<Vec<u8>, Failure> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(pixels));
    written.map_err(|e| Failure::failed(format!("the image cannot become a PNG file: {e}")))?;
    Ok(file)
}
