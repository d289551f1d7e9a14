//! RTSTRUCT: the structures of a case, for one that came without.

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};
use stillpoint_patient::case::{Case, Role, Structure};

use crate::outlines::outlines;
use crate::write::{Export, ExportError, Exported, Writer, fitting};

/// Characters of a name of a region.
const MOST_NAME: usize = 64;
/// Colours of the regions, in turn.
const COLOURS: [[u8; 3]; 8] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [90, 90, 90],
    [140, 90, 60],
];

/// The RTSTRUCT file of a case, under the UID of the structure set in `export`, which the RTPLAN refers to.
///
/// Contours run along the edges of voxels, in every slice of the image, so that they enclose exactly the voxels. Structures
/// without a voxel have no contour.
pub fn structure_file(export: &Export<'_>, case: &Case) -> Result<Exported, ExportError> {
    let mut file = Writer::default();
    file.belongs(export, uids::RT_STRUCTURE_SET_STORAGE, "RTSTRUCT");
    file.put(tags::STRUCTURE_SET_LABEL, VR::SH, "stillpoint");
    file.put(tags::STRUCTURE_SET_DESCRIPTION, VR::ST, "Research only. Contours along the edges of voxels.");
    file.empty(tags::STRUCTURE_SET_DATE, VR::DA).empty(tags::STRUCTURE_SET_TIME, VR::TM);
    file.empty(tags::INSTANCE_NUMBER, VR::IS);
    let frame = export.uids.frame_of_reference.as_str();
    let mut images = Writer::default();
    images.put(tags::FRAME_OF_REFERENCE_UID, VR::UI, frame);
    file.sequence(tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE, vec![images]);
    let (mut regions, mut contours, mut observations) = (Vec::new(), Vec::new(), Vec::new());
    for (at, structure) in case.structures().iter().enumerate() {
        let number = at + 1;
        let name: String = structure.name.replace('\\', "/").chars().take(MOST_NAME).collect();
        let mut region = Writer::default();
        region.whole(tags::ROI_NUMBER, number).put(tags::REFERENCED_FRAME_OF_REFERENCE_UID, VR::UI, frame);
        region.put(tags::ROI_NAME, VR::LO, fitting("name of a structure", &name, MOST_NAME)?);
        region.put(tags::ROI_GENERATION_ALGORITHM, VR::CS, "AUTOMATIC");
        regions.push(region);
        let mut drawn = Writer::default();
        let colour = COLOURS[at % COLOURS.len()].map(|c| c.to_string());
        drawn.put(tags::ROI_DISPLAY_COLOR, VR::IS, PrimitiveValue::Strs(colour.to_vec().into()));
        drawn.whole(tags::REFERENCED_ROI_NUMBER, number);
        drawn.sequence(tags::CONTOUR_SEQUENCE, contours_of(case, structure));
        contours.push(drawn);
        let mut observation = Writer::default();
        observation.whole(tags::OBSERVATION_NUMBER, number).whole(tags::REFERENCED_ROI_NUMBER, number);
        observation.put(tags::RTROI_INTERPRETED_TYPE, VR::CS, interpreted(structure));
        observation.empty(tags::ROI_INTERPRETER, VR::PN);
        observations.push(observation);
    }
    file.sequence(tags::STRUCTURE_SET_ROI_SEQUENCE, regions);
    file.sequence(tags::ROI_CONTOUR_SEQUENCE, contours);
    file.sequence(tags::RTROI_OBSERVATIONS_SEQUENCE, observations);
    file.finish_as(uids::RT_STRUCTURE_SET_STORAGE, export.uids.structure_set.clone())
}

fn contours_of(case: &Case, structure: &Structure) -> Vec<Writer> {
    let grid = case.grid();
    let [nx, ny, nz] = grid.counts;
    let mut items = Vec::new();
    for z in 0..nz {
        let inside = |x: usize, y: usize| structure.mask.contains(grid.index([x, y, z]));
        for polygon in outlines([nx, ny], inside) {
            let edge =
                |axis: usize, at: usize| grid.origin_mm[axis] + (at as f64 - 0.5) * grid.spacing_mm[axis];
            let height = grid.centre_mm([0, 0, z])[2];
            let points: Vec<f64> =
                polygon.iter().flat_map(|[x, y]| [edge(0, *x), edge(1, *y), height]).collect();
            let mut item = Writer::default();
            item.put(tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, "CLOSED_PLANAR");
            item.whole(tags::NUMBER_OF_CONTOUR_POINTS, polygon.len()).decimals(tags::CONTOUR_DATA, &points);
            items.push(item);
        }
    }
    items
}

fn interpreted(structure: &Structure) -> &'static str {
    match structure.role {
        Role::External => "EXTERNAL",
        Role::Target => "PTV",
        Role::ClinicalTarget if structure.name.to_ascii_uppercase().starts_with("GTV") => "GTV",
        Role::ClinicalTarget => "CTV",
        Role::Organ => "ORGAN",
        Role::Other => "CONTROL",
    }
}
