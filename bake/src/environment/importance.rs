//! The environment's importance table: an alias table over an equirectangular grid of solid-angle weights.

use cairn_format::gpu::{EnvAliasEntry, EnvAliasHeader};

use super::equirect::{Equirect, Rows};
use super::resample;

/// Most columns of a table; its entries weigh 12 bytes.
const LARGEST_WIDTH: u32 = 1024;

/// Header and entries of the importance table.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportanceTable {
    pub header: EnvAliasHeader,
    pub entries: Vec<EnvAliasEntry>,
}

impl ImportanceTable {
    /// Bytes of the package's section.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = bytemuck::bytes_of(&self.header).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&self.entries));
        bytes
    }

    /// Relative error of the density's integral over the sphere, in f64 over the stored values.
    pub fn integral_error(&self) -> f64 {
        let (width, height) = (self.header.width, self.header.height);
        let rows = Rows::new(height);
        let angle = |row: usize| rows.thickness(row) * std::f64::consts::TAU / f64::from(width);
        let strips = self.entries.chunks_exact(width as usize).enumerate();
        let sum: f64 = strips
            .map(|(row, strip)| {
                let sum: f64 = strip.iter().map(|cell| f64::from(cell.luminance)).sum();
                sum * angle(row)
            })
            .sum();
        (sum / f64::from(self.header.total_luminance) - 1.0).abs()
    }
}

/// The table of a map whose texels times `scale` are radiance, at half the map's resolution; `None` where it
/// is black.
pub(super) fn build(input: &Equirect, rows: &Rows, scale: f32) -> Option<ImportanceTable> {
    let width = (input.width / 2).clamp(1, LARGEST_WIDTH);
    let height = (input.height / 2).clamp(1, LARGEST_WIDTH / 2);
    let means = resample::equirect_means(input, rows, width, height);
    let luminance: Vec<f32> = means
        .iter()
        .map(|[r, g, b]| scale * (0.2126 * r + 0.7152 * g + 0.0722 * b))
        .collect();
    let bands = Rows::new(height);
    let weights: Vec<f64> = luminance
        .iter()
        .enumerate()
        .map(|(index, &value)| {
            let thickness = bands.thickness(index / width as usize);
            f64::from(value) * thickness * std::f64::consts::TAU / f64::from(width)
        })
        .collect();
    let total: f64 = weights.iter().sum();
    if total as f32 <= 0.0 {
        return None;
    }
    let entries = alias(&weights, total)
        .into_iter()
        .zip(luminance)
        .map(|((prob, alias_index), luminance)| EnvAliasEntry {
            prob,
            alias_index,
            luminance,
        })
        .collect();
    let header = EnvAliasHeader {
        total_luminance: total as f32,
        entry_count: width * height,
        width,
        height,
    };
    Some(ImportanceTable { header, entries })
}

/// Vose's alias method: probability of keeping each entry, and what is taken otherwise.
///
/// M. Vose, "A Linear Algorithm for Generating Random Numbers with a Given Distribution", IEEE TSE 17, 1991.
fn alias(weights: &[f64], total: f64) -> Vec<(f32, u32)> {
    let mean = total / weights.len() as f64;
    let mut shares: Vec<f64> = weights.iter().map(|weight| weight / mean).collect();
    let mut table: Vec<(f32, u32)> = (0..weights.len()).map(|at| (1.0, at as u32)).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) =
        (0..weights.len()).partition(|&index| shares[index] < 1.0);
    while let (Some(&less), Some(&more)) = (small.last(), large.last()) {
        small.pop();
        table[less] = (shares[less] as f32, more as u32);
        shares[more] -= 1.0 - shares[less];
        if shares[more] < 1.0 {
            large.pop();
            small.push(more);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: u32, height: u32, value: impl Fn(usize) -> f32) -> Equirect {
        let texels = (0..(width * height) as usize).map(|index| [value(index); 3]);
        Equirect {
            width,
            height,
            texels: texels.collect(),
        }
    }

    #[test]
    fn every_cell_is_drawn_as_often_as_it_is_bright() {
        for (width, height) in [(2, 1), (7, 5), (64, 32), (1, 9)] {
            let input = map(width, height, |index| ((index * 7919) % 103) as f32);
            let Some(table) = build(&input, &Rows::new(height), 2.0) else {
                continue;
            };
            cairn_format::check::env_alias(&table.to_bytes()).expect("a sound table");
            assert!(table.integral_error() < 1e-6);
        }
    }

    #[test]
    fn luminance_is_the_mean_of_the_reconstruction() {
        let input = map(8, 4, |_| 3.0);
        let table = build(&input, &Rows::new(4), 2.0).expect("light");
        assert_eq!((table.header.width, table.header.height), (4, 2));
        assert!((table.header.total_luminance - 24.0 * std::f32::consts::PI).abs() < 1e-4);
        assert!(
            table
                .entries
                .iter()
                .all(|e| (e.luminance - 6.0).abs() < 1e-5)
        );
        assert!(table.entries.iter().all(|e| e.prob > 0.9999));
    }

    #[test]
    fn black_skies_have_no_table() {
        assert_eq!(build(&map(8, 4, |_| 0.0), &Rows::new(4), 1.0), None);
    }
}
