//! The exposure scale that brings a map within the range of half floats.

use super::cubemap::HALF_MAX;
use super::equirect::Equirect;

/// The median texel stays at or above this after scaling: two bits above the half floats' smallest normal.
const LEAST_MEDIAN: f32 = 1.0 / 4096.0;

/// Divides the map by a power of two that brings its largest channel to at most [`HALF_MAX`], or as far as
/// the median texel stays well within a half's normal range; returns it.
///
/// What is still above is clamped where it is stored, and counted.
pub(super) fn normalize(input: &mut Equirect) -> f32 {
    let largest = input
        .texels
        .as_flattened()
        .iter()
        .copied()
        .fold(0.0, f32::max);
    if largest <= HALF_MAX {
        return 1.0;
    }
    let mut values: Vec<f32> = input
        .texels
        .iter()
        .map(|texel| texel.iter().copied().fold(0.0, f32::max))
        .filter(|value| *value > 0.0)
        .collect();
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    let mut scale = 1.0;
    while largest / scale > HALF_MAX && *median / (2.0 * scale) >= LEAST_MEDIAN {
        scale *= 2.0;
    }
    for channel in input.texels.as_flattened_mut() {
        *channel /= scale;
    }
    scale
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: &[f32]) -> Equirect {
        Equirect {
            width: values.len() as u32,
            height: 1,
            texels: values
                .iter()
                .map(|&value| [value, 0.5 * value, 0.0])
                .collect(),
        }
    }

    #[test]
    fn maps_within_range_stay_as_they_are() {
        for values in [[0.0, 0.0, 0.0], [1e-6, 1.0, 65504.0]] {
            let mut input = map(&values);
            assert_eq!(normalize(&mut input), 1.0);
            assert_eq!(input, map(&values));
        }
    }

    #[test]
    fn bright_maps_come_into_range_and_keep_their_bits() {
        let mut input = map(&[1.0, 2.0, 1e6, 3.0]);
        assert_eq!(normalize(&mut input), 16.0);
        assert_eq!(input.texels[2][0] * 16.0, 1e6);
        let mut all = map(&[1e30, 2e30]);
        let scale = normalize(&mut all);
        assert!(all.texels[1][0] <= HALF_MAX && all.texels[1][0] * scale == 2e30);
    }

    #[test]
    fn dark_maps_with_a_lamp_keep_their_darks() {
        let mut input = map(&[1e-3, 1e-3, 1e9, 1e-3, 1e-3]);
        assert_eq!(normalize(&mut input), 4.0);
        assert!(input.texels[2][0] > HALF_MAX);
    }
}
