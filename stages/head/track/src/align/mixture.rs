//! Whether the patches of a surface move alike. Where a perforated mask that is fixed to the couch lies over a face, some
//! patches are of the mask and some of the face behind its holes: the fit follows a mean of both, in all pieces alike, so
//! that no piece moves against the rest.
//!
//! For each patch, the slope of its distances from the fit over the movement of the fit along its normal: 0 where all move
//! as one. Their variance, of which the part that noise feigns is taken away, is the measure. With a part f of the points on
//! the face it is (1 - f) / f.

use super::together::Verdict;

/// Frames in which a patch has to be seen.
const FRAMES_LEAST: f64 = 5.0;
/// Patches that are needed.
const PATCHES_LEAST: usize = 50;
/// Variance of the slopes: surely below the first limit, patches move alike; surely above the second, they do not. Heads
/// alone have 0.02 before a good camera, 0.13 without noise, and 0.2 before a poor one, which is not sure there; masks that
/// hold a pose back had 0.7 and more, and 0.1 where little of them was seen.
const LIMITS: [f64; 2] = [0.35, 0.2];
/// Standard deviations between the variance and the limits, where it is sure.
const SURE: [f64; 2] = [1.5, 4.0];

/// Sums over the frames of a patch, each frame counted as often as it has points.
#[derive(Debug, Clone, Copy, Default)]
struct Spot {
    /// Points of this frame, and the sum of their distances, m.
    points: f64,
    distances: f64,
    /// Of all frames.
    frames: f64,
    count: f64,
    distance: f64,
    movement: f64,
    squares: f64,
    product: f64,
    movements: f64,
}

impl Spot {
    /// Ends a frame in which the surface moved by so much along the normal of the patch, m.
    fn end(&mut self, movement: f64) {
        let (points, distances) = (self.points, self.distances);
        (self.points, self.distances) = (0.0, 0.0);
        if points > 0.0 {
            self.frames += 1.0;
            self.count += points;
            self.distance += distances;
            self.movement += points * movement;
            self.squares += distances * distances / points;
            self.product += distances * movement;
            self.movements += points * movement * movement;
        }
    }

    /// Sum of squared movements about their mean, product of distance and movement about theirs, and variance of the
    /// distance that no slope explains; of one point.
    fn slope(&self) -> Option<[f64; 3]> {
        if self.frames < FRAMES_LEAST {
            return None;
        }
        let movements = self.movements - self.movement * self.movement / self.count;
        let product = self.product - self.distance * self.movement / self.count;
        let squares = self.squares - self.distance * self.distance / self.count;
        let left = (squares - product * product / movements).max(0.0) / (self.frames - 2.0);
        (movements > 0.0).then_some([movements, product, left])
    }
}

/// The patches of a surface, in all frames so far.
#[derive(Debug, Clone)]
pub(super) struct Mixture {
    spots: Vec<Spot>,
}

impl Mixture {
    /// Of a surface of so many patches, before its first frame.
    pub fn of(patches: usize) -> Self {
        Self { spots: vec![Spot::default(); patches] }
    }

    /// Adds a point that lies over a patch by this distance, m.
    pub fn add(&mut self, patch: usize, distance: f64) {
        if let Some(spot) = self.spots.get_mut(patch) {
            spot.points += 1.0;
            spot.distances += distance;
        }
    }

    /// Ends a frame that tells nothing.
    pub fn skip(&mut self) {
        self.spots.iter_mut().for_each(|spot| (spot.points, spot.distances) = (0.0, 0.0));
    }

    /// Ends a frame; `movements` are those of the fit since the first frame along the normals of the patches, m.
    pub fn end(&mut self, movements: impl Iterator<Item = f64>) {
        self.spots.iter_mut().zip(movements).for_each(|(spot, movement)| spot.end(movement));
    }

    /// Whether the patches move alike (`With`) or not (`Against`).
    pub fn verdict(&self) -> Verdict {
        match self.variance() {
            Some((variance, sd)) if variance - SURE[1] * sd > LIMITS[1] => Verdict::Against,
            Some((variance, sd)) if variance + SURE[0] * sd < LIMITS[0] => Verdict::With,
            _ => Verdict::Open,
        }
    }

    /// Whether the patches surely do not move alike, in any later frame either. Where few patches are judged, a mask that moves
    /// with its head has 0.3 in the first frames and 0.2 soon after, masks at rest have 0.6 and more.
    pub fn is_mixed(&self) -> bool {
        self.variance().is_some_and(|(variance, sd)| variance - SURE[1] * sd > LIMITS[0])
    }

    /// The variance of the slopes, weighted by what each patch tells, and its standard deviation.
    fn variance(&self) -> Option<(f64, f64)> {
        let (mut own, mut all, mut noise, mut patches) = (0.0, 0.0, 0.0, 0);
        for spot in &self.spots {
            let Some([movements, product, left]) = spot.slope() else { continue };
            let feigned = left * movements;
            own += product * product - feigned;
            all += movements * movements;
            noise += 2.0 * feigned * feigned * (1.0 + 1.0 / (spot.frames - 2.0));
            patches += 1;
        }
        (patches >= PATCHES_LEAST && all > 0.0).then(|| (own / all, noise.sqrt() / all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_mechanics::random::Random;

    /// The mixture after frames of 0.1 s of a breath of 0.2 mm, on 500 patches of five points each. A part `still` of the
    /// patches does not move; the fit follows the mean.
    fn after(frames: u32, still: f64, noise: f64) -> Mixture {
        let mut mixture = Mixture::of(500);
        let mut random = Random::stream(7, 0);
        for frame in (0..frames).map(f64::from) {
            let breath = 0.2e-3 * (std::f64::consts::TAU * 0.25 * 0.1 * frame).sin();
            let fit = (1.0 - still) * breath;
            for patch in 0..500_u32 {
                let is_still = f64::from(patch) < 500.0 * still;
                // Each patch has an error of its own.
                let own = 1e-3 * f64::from(patch % 7);
                let moved = if is_still { 0.0 } else { breath };
                (0..5).for_each(|_| {
                    mixture.add(patch as usize, own + moved - fit + noise * random.normal());
                });
            }
            mixture.end(std::iter::repeat_n(fit, 500));
        }
        mixture
    }

    #[test]
    fn a_head_moves_as_one_and_a_mask_over_a_face_does_not() {
        for noise in [0.1e-3, 0.5e-3] {
            assert_eq!(after(40, 0.0, noise).verdict(), Verdict::With, "{noise}");
            assert_eq!(after(40, 0.65, noise).verdict(), Verdict::Against, "{noise}");
            assert!(after(40, 0.65, noise).is_mixed() && !after(40, 0.0, noise).is_mixed(), "{noise}");
        }
    }

    #[test]
    fn the_measure_is_that_of_the_points_on_the_face() {
        let (variance, sd) = after(60, 0.6, 0.05e-3).variance().unwrap_or_default();
        assert!((variance - 1.5).abs() < 0.05 && sd < 0.05, "{variance} {sd}");
        // Without a movement there is none beyond what noise feigns, however many frames there are.
        let (variance, sd) = after(60, 0.0, 0.5e-3).variance().unwrap_or_default();
        assert!(variance.abs() < 4.0 * sd, "{variance} {sd}");
    }

    #[test]
    fn a_variance_between_the_limits_is_against_for_now_and_not_for_good() {
        // A fifth of the points on what is at rest: 0.25.
        let between = after(60, 0.2, 0.02e-3);
        assert_eq!((between.verdict(), between.is_mixed()), (Verdict::Against, false));
    }

    #[test]
    fn what_did_not_move_or_was_not_seen_tells_nothing() {
        assert_eq!(Mixture::of(500).verdict(), Verdict::Open);
        assert_eq!(after(4, 0.0, 0.1e-3).verdict(), Verdict::Open);
        assert_eq!(after(40, 1.0, 0.1e-3).verdict(), Verdict::Open);
        assert_eq!(after(8, 0.65, 3e-3).verdict(), Verdict::Open);
    }
}
