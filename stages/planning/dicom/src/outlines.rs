//! The outlines of a mask in a slice: closed polygons along the edges of voxels, with exactly the mask's area.

/// Polygons of the voxels that are inside, in voxel edges: `[0, 0]` is the lower corner of the first voxel. Holes are
/// polygons of their own. Two voxels that share a corner alone lie in two polygons.
pub fn outlines([width, height]: [usize; 2], inside: impl Fn(usize, usize) -> bool) -> Vec<Vec<[usize; 2]>> {
    // Edges go round with the inside on their left: by the corner that they begin at, the corner that they end at.
    let is_inside = |x: Option<usize>, y: Option<usize>| match (x, y) {
        (Some(x), Some(y)) => x < width && y < height && inside(x, y),
        _ => false,
    };
    let mut from: std::collections::BTreeMap<[usize; 2], Vec<[usize; 2]>> = std::collections::BTreeMap::new();
    for y in 0..height {
        for x in (0..width).filter(|x| inside(*x, y)) {
            let mut edge = |outside: bool, a: [usize; 2], b: [usize; 2]| {
                if outside {
                    from.entry(a).or_default().push(b);
                }
            };
            edge(!is_inside(Some(x), y.checked_sub(1)), [x, y], [x + 1, y]);
            edge(!is_inside(Some(x + 1), Some(y)), [x + 1, y], [x + 1, y + 1]);
            edge(!is_inside(Some(x), Some(y + 1)), [x + 1, y + 1], [x, y + 1]);
            edge(!is_inside(x.checked_sub(1), Some(y)), [x, y + 1], [x, y]);
        }
    }
    let mut polygons = Vec::new();
    while let Some((first, _)) = from.first_key_value() {
        let (first, mut at) = (*first, *first);
        let (mut corners, mut before): (Vec<[usize; 2]>, Option<[i64; 2]>) = (Vec::new(), None);
        while let Some(ends) = from.get_mut(&at) {
            let direction = |end: &[usize; 2]| [0, 1].map(|k| end[k] as i64 - at[k] as i64);
            // Where two polygons touch, a left turn stays with the voxel that the way came along.
            let left = before.map(|[dx, dy]: [i64; 2]| [-dy, dx]);
            let choice = ends.iter().position(|end| Some(direction(end)) == left).unwrap_or(0);
            let next = ends.swap_remove(choice);
            if ends.is_empty() {
                from.remove(&at);
            }
            let now = [0, 1].map(|k| next[k] as i64 - at[k] as i64);
            if before != Some(now) {
                corners.push(at);
            }
            (before, at) = (Some(now), next);
            if at == first {
                break;
            }
        }
        polygons.push(corners);
    }
    polygons
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&str]) -> Vec<Vec<[usize; 2]>> {
        let size = [rows[0].len(), rows.len()];
        outlines(size, |x, y| rows[y].as_bytes()[x] == b'#')
    }

    /// Twice the area, by the shoelace formula; negative round a hole.
    fn area(polygon: &[[usize; 2]]) -> i64 {
        let next = polygon.iter().cycle().skip(1);
        polygon.iter().zip(next).map(|(a, b)| (a[0] * b[1]) as i64 - (b[0] * a[1]) as i64).sum()
    }

    #[test]
    fn a_square_has_four_corners_and_a_hole_is_a_polygon_of_its_own() {
        assert_eq!(of(&["...", ".#.", "..."]), vec![vec![[1, 1], [2, 1], [2, 2], [1, 2]]]);
        let ring = of(&["###", "#.#", "###"]);
        assert_eq!(ring.iter().map(|p| (p.len(), area(p))).collect::<Vec<_>>(), [(4, 18), (4, -2)]);
        assert!(of(&["..", ".."]).is_empty());
    }

    #[test]
    fn voxels_that_share_a_corner_alone_lie_in_two_polygons_and_areas_are_those_of_the_voxels() {
        for rows in [["#.", ".#"], [".#", "#."]] {
            let found = of(&rows);
            assert_eq!(
                found.iter().map(|p| (p.len(), area(p))).collect::<Vec<_>>(),
                [(4, 2), (4, 2)],
                "{rows:?}"
            );
        }
        let rows = ["##.#.", "#.##.", ".###.", "#.#.#"];
        let voxels = rows.iter().flat_map(|r| r.bytes()).filter(|b| *b == b'#').count() as i64;
        assert_eq!(of(&rows).iter().map(|p| area(p)).sum::<i64>(), 2 * voxels);
    }
}
