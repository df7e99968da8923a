//! The dense reference operator: the same rows and weights as one matrix, for tests. Never optimised.

use super::receivers::Receivers;
use super::rows::FIRST_MARK;
use super::spread::Spread;

/// R without albedo, site by site: `matrix[receiver site][source site]`, row sums at most one.
pub fn matrix(sites: usize, receivers: &Receivers, spread: &Spread) -> Vec<Vec<f64>> {
    let mut gather = vec![vec![0.0; sites]; receivers.len()];
    for (r, row) in gather.iter_mut().enumerate() {
        let (rows, r) = receivers.row(r);
        let weight = f64::from(rows.weight(r));
        for &m in rows.row(r).iter().filter(|&&m| m < FIRST_MARK) {
            row[m as usize] += weight;
        }
    }
    (0..sites)
        .map(|site| {
            let mut row = vec![0.0; sites];
            for (&r, &w) in spread.receivers_of(site).iter().zip(spread.weights_of(site)) {
                for (out, g) in row.iter_mut().zip(&gather[r as usize]) {
                    *out += f64::from(w) * g;
                }
            }
            row
        })
        .collect()
}
