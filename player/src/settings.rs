//! Every tunable of a frame, its default, and its allowed values.

use clap::ValueEnum;

/// How the specular lobe treats light that bounces more than once between microfacets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Brdf {
    /// Compensated, so that a white furnace closes (Turquin 2019).
    #[default]
    Energy,
    /// Single scatter, exactly glTF 2.0 appendix B.
    GltfCore,
}

/// How linear radiance becomes a display value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tonemap {
    /// Narkowicz's fit of the ACES curve.
    #[default]
    Aces,
    /// Clamped to 0..=1.
    Linear,
}

/// What a frame looks like.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub brdf: Brdf,
    pub tonemap: Tonemap,
    /// Exposure value: radiance is multiplied by `2^ev`.
    pub ev: f32,
    /// Multiplier of image-based light.
    pub ibl_intensity: f32,
    /// Yaw of the environment about +Y, radians.
    pub ibl_yaw: f32,
    /// Whether the environment is drawn behind the scene.
    pub skybox: bool,
    /// Debug view; 0 is the full image.
    pub debug_view: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            brdf: Brdf::default(),
            tonemap: Tonemap::default(),
            ev: 0.0,
            ibl_intensity: 1.0,
            ibl_yaw: 0.0,
            skybox: true,
            debug_view: 0,
        }
    }
}
