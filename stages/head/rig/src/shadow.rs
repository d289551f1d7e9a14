//! What a projector beside the camera cannot light, and a camera cannot match: the dark band at a near edge.
//!
//! A point in column u at depth z is in column u - f b / z of a projector at b along the camera's x axis.
//! Of the points of a row the projector reaches those that no nearer point stands before, which are those
//! beyond all columns that points on its own side have taken. A second camera in the projector's place
//! hides the same points.

/// Half a pixel: so far one surface may fold over itself before it counts as hidden.
const TOLERANCE_PX: f32 = 0.5;

/// Marks the pixels of one row that the projector reaches.
///
/// `depth_m` in metres, infinite where there is nothing; `focal_baseline` is fx b in pixel metres, positive
/// when the projector is to the camera's right (shadows fall to the left), negative to its left.
/// `column` is scratch; it and `lit` have the length of the row, and what exceeds the shortest stays as it was.
pub fn light_row(depth_m: &[f32], focal_baseline: f32, column: &mut [f32], lit: &mut [bool]) {
    for ((u, &z), column) in depth_m.iter().enumerate().zip(column.iter_mut()) {
        *column = u as i32 as f32 - focal_baseline / z;
    }
    let pixels = column.iter().zip(lit);
    if focal_baseline >= 0.0 {
        let mut taken = f32::INFINITY;
        for (&column, lit) in pixels.rev() {
            *lit = column <= taken + TOLERANCE_PX;
            taken = if column < taken { column } else { taken };
        }
    } else {
        let mut taken = f32::NEG_INFINITY;
        for (&column, lit) in pixels {
            *lit = column >= taken - TOLERANCE_PX;
            taken = if column > taken { column } else { taken };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at 1 m with a bar at 0.5 m before it, in columns 50 to 69.
    fn bar_before_a_wall() -> Vec<f32> {
        (0..120).map(|u| if (50..70).contains(&u) { 0.5 } else { 1.0 }).collect()
    }

    fn dark_columns(focal_baseline: f32) -> Vec<usize> {
        let mut lit = vec![false; 120];
        light_row(&bar_before_a_wall(), focal_baseline, &mut [0.0; 120], &mut lit);
        (0..120).filter(|&u| !lit[u]).collect()
    }

    #[test]
    fn the_shadow_is_as_wide_as_the_difference_of_disparities() {
        // f b (1 / 0.5 - 1 / 1) = 10 px.
        assert_eq!(dark_columns(10.0), (41..50).collect::<Vec<_>>());
    }

    #[test]
    fn a_projector_at_the_left_throws_the_shadow_to_the_right() {
        assert_eq!(dark_columns(-10.0), (70..79).collect::<Vec<_>>());
    }

    #[test]
    fn without_a_baseline_everything_is_lit() {
        assert_eq!(dark_columns(0.0), Vec::<usize>::new());
    }

    #[test]
    fn where_there_is_nothing_no_shadow_is_thrown() {
        let mut lit = [false; 8];
        light_row(&[f32::INFINITY; 8], 40.0, &mut [0.0; 8], &mut lit);
        assert_eq!(lit, [true; 8]);
    }
}
