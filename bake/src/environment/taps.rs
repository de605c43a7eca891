//! The weights with which a texel of the cube takes texels of the map.

use glam::DVec3;

use super::cubemap::to_f32;
use super::equirect::{Equirect, Rows};
use super::mirrors::Mirror;
use super::resample::Meridian;

/// A rectangle of columns (not wrapped) and rows, with weights that sum to 1.
#[derive(Default)]
pub(super) struct Taps {
    first_column: i64,
    columns: usize,
    first_row: usize,
    /// Row by row.
    weights: Vec<f64>,
    /// Column, row and weight in the order in which they were found.
    found: Vec<(i64, usize, f64)>,
    area: f64,
    /// Room for the caller.
    pub meridians: Vec<Meridian>,
}

impl Taps {
    /// Forgets the last texel; the meridians bound the columns of the next.
    pub fn start(&mut self, meridians: &[Meridian]) {
        self.found.clear();
        self.weights.clear();
        self.area = 0.0;
        let first = meridians.iter().map(|meridian| meridian.left).min();
        let last = meridians.iter().map(|meridian| meridian.right).max();
        self.first_column = first.unwrap_or(0);
        self.columns = (last.unwrap_or(0) - self.first_column + 1) as usize;
    }

    /// Adds a meridian between two `y`.
    pub fn add(&mut self, rows: &Rows, meridian: &Meridian, low: f64, high: f64) {
        rows.integrate(low, high, |row, weight| {
            let weight = weight * meridian.weight;
            let right = weight * meridian.blend;
            self.found.push((meridian.left, row, weight - right));
            self.found.push((meridian.right, row, right));
        });
        self.area += meridian.weight * (high - low);
    }

    /// Sums what falls on the same texel of the map.
    pub fn finish(&mut self) {
        let first = self.found.iter().map(|found| found.1).min().unwrap_or(0);
        let last = self.found.iter().map(|found| found.1).max().unwrap_or(0);
        self.first_row = first;
        self.weights.resize((last - first + 1) * self.columns, 0.0);
        for &(column, row, weight) in &self.found {
            let at = (row - first) * self.columns + (column - self.first_column) as usize;
            self.weights[at] += weight / self.area;
        }
    }

    /// The weighted mean of the map, seen in a mirror.
    pub fn mean(&self, input: &Equirect, mirror: &Mirror) -> [f32; 3] {
        let width = input.width as usize;
        let start = mirror.column(self.first_column);
        let mut sum = DVec3::ZERO;
        for (down, weights) in self.weights.chunks_exact(self.columns).enumerate() {
            let row = mirror.row(self.first_row + down);
            let texels = &input.texels[row * width..][..width];
            let mut column = start;
            for weight in weights {
                let [r, g, b] = texels[column];
                sum += DVec3::new(f64::from(r), f64::from(g), f64::from(b)) * *weight;
                column = mirror.next(column);
            }
        }
        to_f32(sum)
    }
}
