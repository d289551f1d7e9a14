//! The fluence of a beam on leaf pairs and columns.
//!
//! A column is as wide as a bixel. Where the edges of the leaves lie on those of the bixels, the map is the fluence of the
//! bixels; a leaf that lies over two rows of bixels takes their mean by area.

use thiserror::Error;

use crate::RowsError;
use crate::dose::Collimator;
use crate::fluence::{GoalsError, ProblemError};

/// A leaf that lies over less of a bixel than this has no part in it, mm.
const TOUCH_MM: f64 = 1e-6;

/// Why a fluence cannot be sequenced.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LeavesError {
    /// A bixel lies where leaves cannot shape it.
    #[error(
        "the bixel at x = {x_mm} mm, z = {z_mm} mm is part of a beam, but the leaves shape fields of +-{x_most_mm} mm along x \
         and {z_least_mm} to {z_most_mm} mm along z; plan with another isocentre or another machine"
    )]
    Beyond {
        /// Centre of the bixel.
        x_mm: f64,
        /// Centre of the bixel.
        z_mm: f64,
        /// Over-travel of the leaves.
        x_most_mm: f64,
        /// Lowest edge of the leaves.
        z_least_mm: f64,
        /// Highest edge of the leaves.
        z_most_mm: f64,
    },
    /// A weight is negative or not finite, or there are not as many as bixels.
    #[error(
        "a fluence of {bixels} bixels has {weights} weights; each bixel needs one that is finite and not negative"
    )]
    Weights {
        /// Bixels.
        bixels: usize,
        /// Weights.
        weights: usize,
    },
    /// The number of levels is out of range.
    #[error("a fluence cannot be brought to {0} levels; 1 to 1000 are possible")]
    Levels(u32),
    /// The doses make no problem.
    #[error(transparent)]
    Goals(#[from] GoalsError),
    /// The doses make no problem.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The doses of the segments make no matrix.
    #[error("the doses of the segments of a beam: {0}")]
    Rows(#[from] RowsError),
}

/// Part of the fluences above zero that are within the levels of which there are so many.
const TOP: f64 = 0.95;

/// Fluence by leaf pair and column.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafMap {
    /// The first pair of the map.
    pub first_pair: usize,
    /// Number of the first column: its centre is at this many widths.
    pub first_column: i64,
    /// Columns.
    pub columns: usize,
    /// Width of a column, mm.
    pub width_mm: f64,
    /// Fluence, pair by pair.
    pub fluence: Vec<f64>,
}

/// A map in whole levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels {
    /// Columns.
    pub columns: usize,
    /// Fluence of one level.
    pub unit: f64,
    /// Levels, pair by pair.
    pub levels: Vec<u32>,
}

/// Refuses bixels (centres x and z) of which the leaves cannot shape one, whatever their weights are.
///
/// # Errors
/// The first of these bixels.
pub fn within_leaves(
    collimator: &Collimator,
    bixels_mm: impl IntoIterator<Item = [f64; 2]>,
    width_mm: f64,
) -> Result<(), LeavesError> {
    let half = 0.5 * width_mm;
    let (x_most_mm, edges) = (collimator.over_travel_mm, &collimator.leaf_edges_mm);
    let (z_least_mm, z_most_mm) = (edges[0], edges[collimator.pairs()]);
    let is_beyond = |[x, z]: &[f64; 2]| {
        x.abs() + half > x_most_mm + TOUCH_MM
            || z - half < z_least_mm - TOUCH_MM
            || z + half > z_most_mm + TOUCH_MM
    };
    match bixels_mm.into_iter().find(is_beyond) {
        Some([x_mm, z_mm]) => Err(LeavesError::Beyond { x_mm, z_mm, x_most_mm, z_least_mm, z_most_mm }),
        None => Ok(()),
    }
}

impl LeafMap {
    /// The map of the weights of bixels whose centres (x, z) lie on multiples of `width_mm`; nothing where no bixel has a
    /// weight.
    pub fn new(
        collimator: &Collimator,
        bixels_mm: &[[f64; 2]],
        weights: &[f64],
        width_mm: f64,
    ) -> Result<Option<Self>, LeavesError> {
        let sound = weights.iter().all(|w| w.is_finite() && *w >= 0.0);
        if weights.len() != bixels_mm.len() || !sound {
            return Err(LeavesError::Weights { bixels: bixels_mm.len(), weights: weights.len() });
        }
        let lit: Vec<([f64; 2], f64)> =
            bixels_mm.iter().copied().zip(weights.iter().copied()).filter(|(_, w)| *w > 0.0).collect();
        within_leaves(collimator, lit.iter().map(|(bixel, _)| *bixel), width_mm)?;
        let half = 0.5 * width_mm;
        let column = |x: f64| libm::round(x / width_mm) as i64;
        let touches = |pair: usize| {
            lit.iter().any(|([_, z], _)| overlap(collimator.pair_mm(pair), [z - half, z + half]) > TOUCH_MM)
        };
        let Some(first_pair) = (0..collimator.pairs()).find(|pair| touches(*pair)) else { return Ok(None) };
        let last_pair = (0..collimator.pairs()).rfind(|pair| touches(*pair)).unwrap_or(first_pair);
        let first_column = lit.iter().map(|([x, _], _)| column(*x)).min().unwrap_or_default();
        let last_column = lit.iter().map(|([x, _], _)| column(*x)).max().unwrap_or_default();
        let columns = (last_column - first_column) as usize + 1;
        let mut fluence = vec![0.0; (last_pair - first_pair + 1) * columns];
        for ([x, z], weight) in lit {
            for pair in first_pair..=last_pair {
                let [low, high] = collimator.pair_mm(pair);
                let part = overlap([low, high], [z - half, z + half]) / (high - low);
                let at = (pair - first_pair) * columns + (column(x) - first_column) as usize;
                fluence[at] += part * weight;
            }
        }
        Ok(Some(Self { first_pair, first_column, columns, width_mm, fluence }))
    }

    /// The map in levels; each fluence goes to the nearest. The fluence that `TOP` of those above zero do not exceed is
    /// `count` of them, and what is above has more: so one bixel does not set the unit of all others.
    pub fn levels(&self, count: u32) -> Result<Levels, LeavesError> {
        if !(1..=1000).contains(&count) {
            return Err(LeavesError::Levels(count));
        }
        let mut lit: Vec<f64> = self.fluence.iter().copied().filter(|fluence| *fluence > 0.0).collect();
        lit.sort_by(f64::total_cmp);
        let place = libm::ceil(TOP * lit.len() as f64) as usize;
        let unit = lit.get(place.saturating_sub(1)).copied().unwrap_or(1.0) / f64::from(count);
        let level = |fluence: &f64| libm::round(fluence / unit) as u32;
        Ok(Levels { columns: self.columns, unit, levels: self.fluence.iter().map(level).collect() })
    }

    /// Leaf pairs of the map.
    pub fn pairs(&self) -> usize {
        self.fluence.len() / self.columns
    }

    /// Lower edge of a column of the map, mm; that of the one behind the last is its upper edge.
    pub fn edge_mm(&self, column: usize) -> f64 {
        ((self.first_column + column as i64) as f64 - 0.5) * self.width_mm
    }
}

/// Length that two ranges share.
pub(super) fn overlap([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    (b.min(d) - a.max(c)).max(0.0)
}
