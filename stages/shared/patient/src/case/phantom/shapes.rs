//! Distances from simple bodies, of which the inside of a phantom is made.

/// Distance from an ellipsoid along the axes, to the first order; negative inside.
pub fn ellipsoid(at: [f64; 3], centre: [f64; 3], radii: [f64; 3]) -> f64 {
    let unit: [f64; 3] = std::array::from_fn(|i| (at[i] - centre[i]) / radii[i]);
    let level = libm::sqrt(unit.iter().map(|u| u * u).sum());
    let gradient = libm::sqrt((0..3).map(|i| (unit[i] / radii[i]) * (unit[i] / radii[i])).sum());
    if gradient == 0.0 {
        -radii.iter().copied().fold(f64::INFINITY, f64::min)
    } else {
        level * (level - 1.0) / gradient
    }
}

/// Distance of two points.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    libm::sqrt((0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum())
}

/// Distance from the line between two points.
pub fn rod(at: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let along = |p: [f64; 3]| (0..3).map(|i| (p[i] - a[i]) * (b[i] - a[i])).sum::<f64>();
    let t = (along(at) / along(b)).clamp(0.0, 1.0);
    distance(at, std::array::from_fn(|i| a[i] + t * (b[i] - a[i])))
}
