//! Vertex colours as a package stores them.

use cairn_format::gpu::VertexColor;

use crate::scene::Primitive;

/// What primitives without colours have.
pub(super) const WHITE: VertexColor = VertexColor {
    red_green: u32::MAX,
    blue_alpha: u32::MAX,
};

const LARGEST: f64 = 65535.0;

/// Colours of a primitive's vertices.
#[derive(Clone, Debug)]
pub(super) struct Colors {
    /// One per source vertex.
    pub(super) stored: Vec<VertexColor>,
    /// Largest difference to a source channel of a vertex that a triangle uses.
    pub(super) error: f64,
}

/// The colours of `primitive`; `None` where it has none, or all that its triangles use are stored as white.
pub(super) fn stored(primitive: &Primitive) -> Option<Colors> {
    let source = primitive.colors.as_ref()?;
    let stored: Vec<VertexColor> = source.iter().map(|color| quantize(*color)).collect();
    let used = || primitive.indices.iter().map(|index| *index as usize);
    if used().all(|index| stored[index] == WHITE) {
        return None;
    }
    let error = used()
        .map(|index| difference(source[index], stored[index]))
        .fold(0.0, f64::max);
    Some(Colors { stored, error })
}

/// Channels in 0..=1 (glTF 2.0 section 3.7.2.1: others are clamped).
fn clamped(color: [f32; 4]) -> [f64; 4] {
    color.map(|channel| f64::from(channel.clamp(0.0, 1.0)))
}

/// Rounds to the nearest of 65536 steps, halves up.
fn quantize(color: [f32; 4]) -> VertexColor {
    let [red, green, blue, alpha] =
        clamped(color).map(|channel| (channel * LARGEST + 0.5).floor() as u32);
    VertexColor {
        red_green: red | green << 16,
        blue_alpha: blue | alpha << 16,
    }
}

fn difference(source: [f32; 4], stored: VertexColor) -> f64 {
    let channel = |word: u32, shift: u32| f64::from(word >> shift & 0xFFFF) / LARGEST;
    let stored = [
        channel(stored.red_green, 0),
        channel(stored.red_green, 16),
        channel(stored.blue_alpha, 0),
        channel(stored.blue_alpha, 16),
    ];
    let pairs = clamped(source).into_iter().zip(stored);
    pairs
        .map(|(source, stored)| (source - stored).abs())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn colored(colors: Vec<[f32; 4]>, indices: Vec<u32>) -> Primitive {
        Primitive {
            positions: vec![[0.0; 3]; colors.len()],
            colors: Some(colors),
            indices,
            ..Primitive::default()
        }
    }

    proptest! {
        #[test]
        fn the_error_is_half_a_step(color in prop::array::uniform4(0.0f32..=1.0)) {
            prop_assert!(difference(color, quantize(color)) <= 0.5 / LARGEST + 1e-16);
        }

        #[test]
        fn sixteen_bit_sources_are_kept(channels in prop::array::uniform4(any::<u16>())) {
            let color = channels.map(|channel| (f64::from(channel) / LARGEST) as f32);
            let [red, green, blue, alpha] = channels.map(u32::from);
            let stored = quantize(color);
            prop_assert_eq!(stored.red_green, red | green << 16);
            prop_assert_eq!(stored.blue_alpha, blue | alpha << 16);
        }
    }

    #[test]
    fn channels_have_their_place_and_are_clamped() {
        let stored = quantize([1.0, 0.0, -3.0, 9.0]);
        assert_eq!((stored.red_green, stored.blue_alpha), (0xFFFF, 0xFFFF_0000));
        assert_eq!(quantize([0.5; 4]).red_green, 0x8000_8000, "halves go up");
        assert_eq!(quantize([1.0; 4]), WHITE);
    }

    #[test]
    fn white_is_dropped_where_it_is_used() {
        let grey = [0.25, 0.25, 0.25, 1.0];
        assert!(stored(&Primitive::default()).is_none());
        assert!(stored(&colored(vec![[1.0; 4], grey], vec![0, 0, 0])).is_none());
        let kept = stored(&colored(vec![[1.0; 4], grey], vec![0, 0, 1])).expect("grey is used");
        assert_eq!(kept.stored, [WHITE, quantize(grey)]);
        assert!(kept.error > 0.0 && kept.error <= 0.5 / LARGEST);
    }
}
