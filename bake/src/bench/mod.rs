//! Measurements of single stages against others' tools: speed beside error.

pub mod basisu;
pub mod cpu;
pub mod plot;
pub mod textures;
