//! Measurements of single stages against others' tools: speed beside error.

pub mod basisu;
pub mod clock;
pub mod plot;
pub mod radiance;
pub mod textures;

/// First texel and number of texels of whole blocks about the centre of an axis, `crop` at most; images below a block repeat
/// their edge.
fn middle(extent: usize, crop: u32) -> (usize, usize) {
    let length = (extent.min(crop as usize) / 4 * 4).max(4);
    (extent.saturating_sub(length) / 2, length)
}
