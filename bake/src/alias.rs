//! Alias tables: draws from a discrete distribution with one lookup (Walker 1977, built as in Vose 1991).

/// One cell: taken with probability `keep`, else `other` is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Probability of keeping the cell.
    pub keep: f32,
    /// The cell taken otherwise.
    pub other: u32,
}

/// The table of `weights`, which are finite and not negative, and their sum. Weights of zero are never drawn.
/// The same weights give the same table on every machine. Without any weight the table is empty.
pub fn build(weights: &[f64]) -> (Vec<Cell>, f64) {
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return (Vec::new(), 0.0);
    }
    let count = weights.len() as f64;
    let mut scaled: Vec<f64> = weights
        .iter()
        .map(|weight| weight / total * count)
        .collect();
    let (mut small, mut large): (Vec<u32>, Vec<u32>) =
        (0..weights.len() as u32).partition(|index| scaled[*index as usize] < 1.0);
    let mut cells: Vec<Cell> = (0..weights.len() as u32)
        .map(|index| Cell {
            keep: 1.0,
            other: index,
        })
        .collect();
    while let (Some(less), Some(more)) = (small.last().copied(), large.last().copied()) {
        small.pop();
        let kept = scaled[less as usize];
        cells[less as usize] = Cell {
            keep: kept as f32,
            other: more,
        };
        scaled[more as usize] -= 1.0 - kept;
        if scaled[more as usize] < 1.0 {
            large.pop();
            small.push(more);
        }
    }
    // What rounding left over: only cells of weight zero must not be kept.
    let heaviest = (0..weights.len()).max_by(|a, b| weights[*a].total_cmp(&weights[*b]));
    for less in small {
        if weights[less as usize] == 0.0 {
            cells[less as usize] = Cell {
                keep: 0.0,
                other: heaviest.unwrap_or(0) as u32,
            };
        }
    }
    (cells, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Probability of each cell.
    fn drawn(cells: &[Cell]) -> Vec<f64> {
        let mut drawn = vec![0.0; cells.len()];
        for (index, cell) in cells.iter().enumerate() {
            drawn[index] += f64::from(cell.keep);
            drawn[cell.other as usize] += 1.0 - f64::from(cell.keep);
        }
        drawn.iter().map(|sum| sum / cells.len() as f64).collect()
    }

    proptest! {
        #[test]
        fn cells_are_drawn_by_weight(
            weights in prop::collection::vec(prop_oneof![Just(0.0), 0.0..1.0, 0.0..1e9f64], 1..200)
        ) {
            let (cells, total) = build(&weights);
            prop_assume!(total > 0.0);
            for (drawn, weight) in drawn(&cells).iter().zip(&weights) {
                prop_assert!((drawn - weight / total).abs() < 1e-6);
                prop_assert!(*weight > 0.0 || *drawn == 0.0);
            }
        }
    }

    #[test]
    fn one_weight_takes_all() {
        let mut weights = vec![0.0; 1000];
        weights[417] = 3.0;
        let (cells, total) = build(&weights);
        assert_eq!(total, 3.0);
        assert_eq!(drawn(&cells)[417], 1.0);
        assert_eq!(build(&[0.0, 0.0]), (Vec::new(), 0.0));
    }
}
