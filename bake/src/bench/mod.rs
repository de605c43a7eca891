//! Measurements of single stages against others' tools: speed beside error.

pub mod basisu;
pub mod clock;
pub mod plot;
pub mod radiance;
pub mod textures;
