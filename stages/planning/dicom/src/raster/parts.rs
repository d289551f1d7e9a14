//! The parts of a structure that lie apart: islands whose planes must not displace each other's.

use std::collections::BTreeMap;

use super::contour::Contour;

/// Contours apart by more than this are of two parts, mm.
const TOUCHING_MM: f64 = 0.01;

/// The contours of each part. Two contours are of one part if the rectangles around them overlap, in whatever planes they
/// are, or if contours of one part lie between them in this sense.
pub(super) fn apart<'a>(contours: &[&'a Contour]) -> Vec<Vec<&'a Contour>> {
    let around: Vec<[[f64; 2]; 2]> = contours.iter().map(|c| rectangle(c)).collect();
    let mut order: Vec<usize> = (0..contours.len()).collect();
    order.sort_by(|&a, &b| around[a][0][0].total_cmp(&around[b][0][0]).then(a.cmp(&b)));
    let mut part: Vec<usize> = (0..contours.len()).collect();
    // Contours that reach beyond the left end of the present one.
    let mut open: Vec<usize> = Vec::new();
    for &i in &order {
        open.retain(|&j| around[j][1][0] + TOUCHING_MM >= around[i][0][0]);
        for &j in &open {
            let [low, high] = [around[i][0][1].max(around[j][0][1]), around[i][1][1].min(around[j][1][1])];
            if low <= high + TOUCHING_MM {
                let (a, b) = (root(&mut part, i), root(&mut part, j));
                part[a.max(b)] = a.min(b);
            }
        }
        // Of a stack of equal rectangles one is enough.
        open.retain(|&j| !holds(&around[i], &around[j]));
        open.push(i);
    }
    let mut parts: BTreeMap<usize, Vec<&Contour>> = BTreeMap::new();
    for (i, contour) in contours.iter().enumerate() {
        parts.entry(root(&mut part, i)).or_default().push(contour);
    }
    parts.into_values().collect()
}

fn rectangle(contour: &Contour) -> [[f64; 2]; 2] {
    let mut around = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for corner in &contour.xy_mm {
        for axis in 0..2 {
            around[0][axis] = around[0][axis].min(corner[axis]);
            around[1][axis] = around[1][axis].max(corner[axis]);
        }
    }
    around
}

/// Whether all that overlaps `inner` and comes after it overlaps `outer`, too: `outer` reaches as far in all but the left.
fn holds(outer: &[[f64; 2]; 2], inner: &[[f64; 2]; 2]) -> bool {
    outer[0][1] <= inner[0][1] && outer[1][1] >= inner[1][1] && outer[1][0] >= inner[1][0]
}

fn root(part: &mut [usize], mut i: usize) -> usize {
    while part[i] != i {
        part[i] = part[part[i]];
        i = part[i];
    }
    i
}
