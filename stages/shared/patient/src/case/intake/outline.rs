//! One outline, whole, made from the CT where none is drawn.

use std::collections::BTreeSet;

use super::super::mask::Mask;
use super::super::structure::{Role, Structure};
use super::IntakeError;
use crate::Grid;

/// Tissue and fat are above this, air and most lung below it, HU.
const BODY_HU: i16 = -300;
/// What is thinner than twice this is no body: couch tops and masks, mm.
const THIN_MM: f64 = 5.0;
/// A body has at least this, cm3.
const LEAST_CM3: f64 = 1.0;
/// Holes that are more than this part of an outline make it a shell.
const SHELL: f64 = 0.2;
/// Holes below this are not worth a word, cm3.
const HOLE_CM3: f64 = 1.0;

/// Leaves one outline: of several, the one with the most voxels. The others are aids.
pub(super) fn one(grid: &Grid, structures: &mut [Structure], notes: &mut Vec<String>) {
    let outlines: Vec<usize> =
        (0..structures.len()).filter(|&i| structures[i].role == Role::External).collect();
    let size = |i: &usize| structures[*i].mask.count();
    let Some(largest) = outlines.iter().copied().rev().max_by_key(size) else { return };
    for i in outlines.into_iter().filter(|&i| i != largest) {
        notes.push(format!(
            "{:?} ({:.2} cm3) and {:?} ({:.2} cm3) are both outlines of the patient: the larger is taken; a line in a names table (`--names`) gives the other the role external",
            structures[largest].name,
            structures[largest].mask.count() as f64 * grid.voxel_cm3(),
            structures[i].name,
            structures[i].mask.count() as f64 * grid.voxel_cm3(),
        ));
        structures[i].role = Role::Other;
    }
}

/// Fills an outline that is a shell.
pub(super) fn whole(grid: &Grid, hu: &[i16], structures: &mut [Structure], notes: &mut Vec<String>) {
    let Some(outline) = structures.iter_mut().find(|s| s.role == Role::External) else { return };
    let filled = filled(grid, &outline.mask);
    let holes: Vec<usize> = filled.indices().filter(|&i| !outline.mask.contains(i)).collect();
    let (own, hollow) = (outline.mask.count() as f64, holes.len() as f64);
    let volume = |voxels: f64| voxels * grid.voxel_cm3();
    let tissue = holes.iter().filter(|&&i| hu.get(i).is_some_and(|&h| h > BODY_HU)).count() as f64;
    let name = &outline.name;
    if hollow > SHELL * own && tissue > 0.0 {
        notes.push(format!(
            "the outline {name:?} is a shell of {:.2} cm3 around {:.2} cm3, and is filled",
            volume(own),
            volume(hollow)
        ));
        outline.mask = filled;
    } else if volume(tissue) >= HOLE_CM3 {
        notes.push(format!(
            "the outline {name:?} has holes of {:.2} cm3, {:.2} cm3 of it tissue: no dose is computed there",
            volume(hollow),
            volume(tissue)
        ));
    }
}

/// Makes an outline from the images where there is none.
pub(super) fn made(
    grid: &Grid,
    hu: &[i16],
    structures: &mut Vec<Structure>,
    notes: &mut Vec<String>,
) -> Result<(), IntakeError> {
    if structures.iter().any(|s| s.role == Role::External) {
        return Ok(());
    }
    let tissue = Mask::from_fn(grid.len(), |i| hu.get(i).is_some_and(|&h| h > BODY_HU));
    let body = filled(grid, &largest(grid, &tissue));
    let found_cm3 = body.count() as f64 * grid.voxel_cm3();
    if found_cm3 < LEAST_CM3 {
        return Err(IntakeError::NoBody { above_hu: BODY_HU, found_cm3 });
    }
    let taken: BTreeSet<&str> = structures.iter().map(|s| s.name.as_str()).collect();
    // One of one more name than there are structures is free.
    let names =
        (1..=structures.len() + 1).map(|n| if n == 1 { "Body".to_owned() } else { format!("Body {n}") });
    let name = names.into_iter().find(|name| !taken.contains(name.as_str())).unwrap_or_default();
    notes.push(format!(
        "no structure is the outline of the patient: {name:?} is made from the images, the largest region above {BODY_HU} HU with its holes filled: {found_cm3:.2} cm3"
    ));
    structures.push(Structure { name, role: Role::External, mask: body });
    Ok(())
}

/// Says which structures leave the outline.
pub(super) fn leaving(grid: &Grid, structures: &[Structure], notes: &mut Vec<String>) {
    let Some(outline) = structures.iter().find(|s| s.role == Role::External) else { return };
    for structure in structures {
        if matches!(structure.role, Role::External | Role::Other) {
            continue;
        }
        let outside = structure.mask.indices().filter(|&i| !outline.mask.contains(i)).count();
        if outside > 0 {
            let volume = |voxels: usize| voxels as f64 * grid.voxel_cm3();
            notes.push(format!(
                "{:?} leaves the outline {:?}: {:.2} of its {:.2} cm3 are outside of it and get no dose",
                structure.name,
                outline.name,
                volume(outside),
                volume(structure.mask.count())
            ));
        }
    }
}

/// The mask with all that it encloses in each slice.
fn filled(grid: &Grid, mask: &Mask) -> Mask {
    let [nx, ny, nz] = grid.counts;
    let mut outside = vec![false; grid.len()];
    let mut open = Vec::new();
    for z in 0..nz {
        let edge =
            (0..nx).flat_map(|x| [[x, 0], [x, ny - 1]]).chain((0..ny).flat_map(|y| [[0, y], [nx - 1, y]]));
        for [x, y] in edge {
            visit(grid.index([x, y, z]), mask, &mut outside, &mut open);
        }
        while let Some(index) = open.pop() {
            let [x, y, _] = grid.voxel(index);
            for [x, y] in [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]] {
                if x < nx && y < ny {
                    visit(grid.index([x, y, z]), mask, &mut outside, &mut open);
                }
            }
        }
    }
    Mask::from_fn(grid.len(), |i| !outside[i])
}

fn visit(index: usize, mask: &Mask, outside: &mut [bool], open: &mut Vec<usize>) {
    if !outside[index] && !mask.contains(index) {
        outside[index] = true;
        open.push(index);
    }
}

/// The largest connected part, without what is thin across the patient.
fn largest(grid: &Grid, tissue: &Mask) -> Mask {
    let core = shrunk(grid, tissue);
    let mut seen = Mask::empty(grid.len());
    let mut best: Vec<usize> = Vec::new();
    for start in core.indices() {
        if seen.contains(start) {
            continue;
        }
        let mut part = vec![start];
        seen.insert(start);
        let mut next = 0;
        while next < part.len() {
            for index in neighbours(grid, part[next]) {
                if core.contains(index) && !seen.contains(index) {
                    seen.insert(index);
                    part.push(index);
                }
            }
            next += 1;
        }
        if part.len() > best.len() {
            best = part;
        }
    }
    grown(grid, &best, tissue)
}

fn neighbours(grid: &Grid, index: usize) -> impl Iterator<Item = usize> + '_ {
    let voxel = grid.voxel(index);
    (0..6).filter_map(move |side| {
        let (axis, up) = (side / 2, side % 2 == 1);
        let mut at = voxel;
        at[axis] = if up { at[axis] + 1 } else { at[axis].checked_sub(1)? };
        (at[axis] < grid.counts[axis]).then(|| grid.index(at))
    })
}

/// How many voxels a thin thing is thick, along x and along y.
fn thin(grid: &Grid) -> [usize; 2] {
    [0, 1].map(|axis| ((THIN_MM / grid.spacing_mm[axis]) as usize).max(1))
}

/// The voxels whose surroundings across the patient are all tissue; beyond the images counts as tissue.
fn shrunk(grid: &Grid, tissue: &Mask) -> Mask {
    let [rx, ry] = thin(grid);
    let [nx, ny, _] = grid.counts;
    let along = |mask: &Mask, axis: usize, reach: usize| {
        Mask::from_fn(grid.len(), |index| {
            let voxel = grid.voxel(index);
            let (from, to) =
                (voxel[axis].saturating_sub(reach), (voxel[axis] + reach).min([nx, ny][axis] - 1));
            (from..=to).all(|place| {
                let mut at = voxel;
                at[axis] = place;
                mask.contains(grid.index(at))
            })
        })
    };
    along(&along(tissue, 0, rx), 1, ry)
}

/// The part with the tissue that shrinking took from its border.
fn grown(grid: &Grid, part: &[usize], tissue: &Mask) -> Mask {
    let [rx, ry] = thin(grid);
    let [nx, ny, _] = grid.counts;
    let mut mask = Mask::empty(grid.len());
    for &index in part {
        let [x, y, z] = grid.voxel(index);
        for y in y.saturating_sub(ry)..=(y + ry).min(ny - 1) {
            for x in x.saturating_sub(rx)..=(x + rx).min(nx - 1) {
                let near = grid.index([x, y, z]);
                if tissue.contains(near) {
                    mask.insert(near);
                }
            }
        }
    }
    mask
}
