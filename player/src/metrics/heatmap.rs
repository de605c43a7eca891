//! Colours for error maps: dark for nothing, through violet and orange, to pale yellow for the most.

use super::Picture;
use super::color::srgb_to_linear;
use super::flip::ErrorMap;

/// sRGB bytes at equal steps, lightness rising evenly (CIELAB L* 2 to 97); between them colours are interpolated.
const STOPS: [[u8; 3]; 9] = [
    [3, 3, 10],
    [30, 20, 70],
    [84, 20, 115],
    [130, 42, 120],
    [180, 56, 112],
    [226, 83, 92],
    [247, 136, 92],
    [252, 193, 131],
    [253, 247, 190],
];

/// The colour of `value` in 0..=1, encoded, 0..=1.
pub fn color(value: f32) -> [f32; 3] {
    let last = STOPS.len() - 1;
    let at = value.clamp(0.0, 1.0) * last as f32;
    let index = (at as usize).min(last - 1);
    let fraction = at - index as f32;
    std::array::from_fn(|channel| {
        let [low, high] = [index, index + 1].map(|index| f32::from(STOPS[index][channel]) / 255.0);
        low + (high - low) * fraction
    })
}

/// The map in colours.
pub fn picture(map: &ErrorMap) -> Picture {
    let texel = |value: &f32| color(*value).map(srgb_to_linear);
    Picture {
        width: map.width,
        height: map.height,
        texels: map.values.iter().map(texel).collect(),
    }
}
