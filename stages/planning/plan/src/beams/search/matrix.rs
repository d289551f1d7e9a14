//! Matrix games: what each player is sure of, the value, and fictitious play (5.3, SCIENCE G4).
//!
//! The first player chooses a row and minimises, the second a column and maximises. `costs[row][column]`.

/// The most that the second player is sure of with one column: the largest column minimum.
pub fn gain_floor(costs: &[Vec<f64>]) -> f64 {
    let columns = costs.first().map_or(0, Vec::len);
    let least = |column: usize| costs.iter().map(|row| row[column]).fold(f64::INFINITY, f64::min);
    (0..columns).map(least).fold(f64::NEG_INFINITY, f64::max)
}

/// The least that the first player is sure of with one row, and that row: the smallest row maximum.
pub fn loss_ceiling(costs: &[Vec<f64>]) -> (f64, usize) {
    let most = |row: &Vec<f64>| row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let ceilings = costs.iter().map(most).enumerate();
    ceilings.fold((f64::INFINITY, 0), |best, (row, cost)| if cost < best.0 { (cost, row) } else { best })
}

/// A pair of mixed strategies.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixed {
    /// Expected cost.
    pub value: f64,
    /// Probabilities of the rows.
    pub rows: Vec<f64>,
    /// Probabilities of the columns.
    pub columns: Vec<f64>,
}

/// How much both players together could gain by leaving a pair of strategies: 0 at a saddle point.
pub fn exploitability(costs: &[Vec<f64>], rows: &[f64], columns: &[f64]) -> f64 {
    let against_row = |column: usize| costs.iter().zip(rows).map(|(row, p)| p * row[column]).sum::<f64>();
    let against_column = |row: &Vec<f64>| row.iter().zip(columns).map(|(cost, p)| p * cost).sum::<f64>();
    let most = (0..columns.len()).map(against_row).fold(f64::NEG_INFINITY, f64::max);
    most - costs.iter().map(against_column).fold(f64::INFINITY, f64::min)
}

/// The saddle point in mixed strategies, by the simplex method with Bland's rule: `max sum x, M^T x <= 1, x >= 0` for the
/// costs `M` moved above zero. `None` for a matrix without entries, with rows of different lengths or without finite costs.
pub fn saddle_point(costs: &[Vec<f64>]) -> Option<Mixed> {
    let (m, n) = (costs.len(), costs.first()?.len());
    let fits = costs.iter().all(|row| row.len() == n && row.iter().all(|cost| cost.is_finite()));
    if !fits || n == 0 {
        return None;
    }
    let shift = 1.0 - costs.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    // Variables: the first player's, then slack; at the end the right-hand side. The last row is the objective.
    let width = m + n + 1;
    let mut table = vec![vec![0.0; width]; n + 1];
    for (j, constraint) in table.iter_mut().take(n).enumerate() {
        costs.iter().enumerate().for_each(|(i, row)| constraint[i] = row[j] + shift);
        constraint[m + j] = 1.0;
        constraint[width - 1] = 1.0;
    }
    table[n][..m].fill(-1.0);
    let mut basis: Vec<usize> = (m..m + n).collect();
    while let Some(enter) = (0..width - 1).find(|variable| table[n][*variable] < -1e-12) {
        let ratio = |j: &usize| table[*j][width - 1] / table[*j][enter];
        let leave = (0..n)
            .filter(|j| table[*j][enter] > 1e-12)
            .min_by(|a, b| ratio(a).total_cmp(&ratio(b)).then(basis[*a].cmp(&basis[*b])))?;
        let pivot = table[leave][enter];
        table[leave].iter_mut().for_each(|value| *value /= pivot);
        let pivot_row = table[leave].clone();
        for (j, row) in table.iter_mut().enumerate() {
            let factor = row[enter];
            if j != leave && factor != 0.0 {
                row.iter_mut().zip(&pivot_row).for_each(|(value, pivot)| *value -= factor * pivot);
            }
        }
        basis[leave] = enter;
    }
    let sum = table[n][width - 1];
    let mut rows = vec![0.0; m];
    for (j, variable) in basis.iter().enumerate() {
        if *variable < m {
            rows[*variable] = table[j][width - 1] / sum;
        }
    }
    let columns = (0..n).map(|j| table[n][m + j] / sum).collect();
    Some(Mixed { value: 1.0 / sum - shift, rows, columns })
}

/// Fictitious play: in each round both answer the mean of what the other played, the first move among equals.
pub fn fictitious_play(costs: &[Vec<f64>], rounds: usize) -> Mixed {
    let (m, n) = (costs.len(), costs.first().map_or(0, Vec::len));
    let (mut rows, mut columns) = (vec![0.0; m], vec![0.0; n]);
    let (mut row_costs, mut column_costs) = (vec![0.0; m], vec![0.0; n]);
    for _ in 0..rounds {
        let row = (0..m).fold(0, |best, i| if row_costs[i] < row_costs[best] { i } else { best });
        let column = (0..n).fold(0, |best, j| if column_costs[j] > column_costs[best] { j } else { best });
        rows[row] += 1.0 / rounds as f64;
        columns[column] += 1.0 / rounds as f64;
        (0..m).for_each(|i| row_costs[i] += costs[i][column]);
        (0..n).for_each(|j| column_costs[j] += costs[row][j]);
    }
    let of_row = |(row, p): (&Vec<f64>, &f64)| p * row.iter().zip(&columns).map(|(c, q)| c * q).sum::<f64>();
    Mixed { value: costs.iter().zip(&rows).map(of_row).sum(), rows, columns }
}
