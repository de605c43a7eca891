//! Every tunable of a frame, its default, and its allowed values.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// What draws the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The raster pipeline.
    #[default]
    Raster,
    /// The path-traced reference, where the device can trace rays.
    PathTrace,
}

/// How the specular lobe treats light that bounces more than once between microfacets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Brdf {
    /// Compensated, so that a white furnace closes (Turquin 2019).
    #[default]
    Energy,
    /// Single scatter, exactly glTF 2.0 appendix B.
    GltfCore,
}

/// How linear radiance becomes a display value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tonemap {
    /// Narkowicz's fit of the ACES curve.
    #[default]
    Aces,
    /// Clamped to 0..=1.
    Linear,
    /// Troy Sobotka's AgX, base look.
    Agx,
    /// Khronos PBR Neutral.
    Neutral,
}

/// Whether depth is drawn before surfaces are shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Prepass {
    /// Where a pass reads depth or normals before surfaces are shaded.
    #[default]
    Auto,
    /// Always.
    On,
    /// Only where a pass could not work without.
    Off,
}

/// Which directional lights shine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightSource {
    /// Those of the scene; without them the environment's sun; without an environment the fallback light.
    #[default]
    Auto,
    /// Those of the scene.
    Scene,
    /// The sun that the bake took out of the environment.
    Sun,
    /// One white light at [`LightSettings::yaw`] and [`LightSettings::pitch`].
    Fallback,
    /// None.
    None,
}

/// How many taps soft shadows take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// 16 blocker and 16 filter taps.
    Low,
    /// 16 and 25.
    #[default]
    Medium,
    /// 32 and 49.
    High,
}

/// How shadow edges are filtered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadowFilter {
    /// A fixed kernel of hardware comparisons.
    #[default]
    Pcf,
    /// Penumbrae that grow with the distance to the blocker.
    Pcss,
}

/// How ambient occlusion darkens reflections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpecularOcclusion {
    /// From the amount of occlusion (Lagarde and de Rousiers 2014).
    Lagarde,
    /// From the bent normal (Jimenez et al. 2016).
    #[default]
    Gtso,
}

/// The directional light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightSettings {
    /// Which lights shine.
    pub source: LightSource,
    /// Fallback light: radians about +Y; 0 shines from +Z.
    pub yaw: f32,
    /// Fallback light: radians; negative shines from above.
    pub pitch: f32,
    /// Fallback light: lux.
    pub intensity: f32,
}

/// Cascaded shadow maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ShadowSettings {
    pub enabled: bool,
    /// 1..=4.
    pub cascades: u32,
    /// Texels of a side: 512, 1024, 2048 or 4096.
    pub resolution: u32,
    /// Metres; 0 takes 1.5 diagonals of the scene.
    pub max_distance: f32,
    /// 0 splits evenly, 1 logarithmically.
    pub lambda: f32,
    /// Depth bias per slope.
    pub slope_bias: f32,
    /// Offset along the geometric normal, in shadow texels.
    pub normal_offset: f32,
    /// PCF or PCSS.
    pub filter: ShadowFilter,
    /// PCF: 0..=5, a kernel of `2 r + 1` taps a side.
    pub pcf_radius: u32,
    /// PCSS: taps.
    pub quality: Quality,
    /// PCSS: angular diameter of lights that have none of their own, radians.
    pub angular_diameter: f32,
    /// PCSS: whether a search that finds blockers only ends there.
    pub early_out: bool,
    /// Fraction of a cascade's end over which it blends into the next.
    pub blend_width: f32,
    /// Fraction of the distance over which shadows fade.
    pub fade_width: f32,
}

/// Ground-truth ambient occlusion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AoSettings {
    pub enabled: bool,
    /// Metres; 0 takes a fraction of the scene's diagonal.
    pub radius: f32,
    /// Slices per pixel.
    pub directions: u32,
    /// Steps per side of a slice.
    pub steps: u32,
    /// 0..=0.7: how much thin occluders let through.
    pub thin_compensation: f32,
    /// Exponent of the visibility.
    pub intensity: f32,
    /// Weight of the history, 0..=0.98.
    pub temporal: f32,
    /// How reflections are occluded.
    pub specular: SpecularOcclusion,
}

/// Screen-space shadows of small things.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ContactSettings {
    pub enabled: bool,
    /// Steps per ray.
    pub steps: u32,
    /// Metres; 0 takes a fraction of the scene's diagonal.
    pub distance: f32,
    /// Metres; 0 takes a fraction of the distance.
    pub thickness: f32,
}

/// The path tracer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PathSettings {
    /// Longest path, in surface hits after the camera's.
    pub bounces: u32,
    /// Firefly clamp of indirect light by its largest channel; 0 is off.
    pub clamp: f32,
    /// Samples the environment's table.
    pub sample_environment: bool,
    /// Samples directional, point and spot lights.
    pub sample_lights: bool,
    /// Samples emissive triangles.
    pub sample_emitters: bool,
    /// Samples per pixel in a frame.
    pub samples_per_frame: u32,
}

/// What a frame looks like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    pub mode: Mode,
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
    /// Samples per pixel: 1, 2, 4 or 8.
    pub msaa: u32,
    /// Depth before shading.
    pub prepass: Prepass,
    pub light: LightSettings,
    pub shadow: ShadowSettings,
    pub ao: AoSettings,
    pub contact: ContactSettings,
    pub path: PathSettings,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self {
            source: LightSource::default(),
            yaw: 0.7,
            pitch: -0.9,
            intensity: 3.0,
        }
    }
}

impl Default for ShadowSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            cascades: 4,
            resolution: 2048,
            max_distance: 0.0,
            lambda: 0.75,
            slope_bias: 1.5,
            normal_offset: 1.0,
            filter: ShadowFilter::default(),
            pcf_radius: 1,
            quality: Quality::default(),
            angular_diameter: 0.00925,
            early_out: true,
            blend_width: 0.1,
            fade_width: 0.1,
        }
    }
}

impl Default for AoSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            radius: 0.0,
            directions: 4,
            steps: 4,
            thin_compensation: 0.2,
            intensity: 1.0,
            temporal: 0.9,
            specular: SpecularOcclusion::default(),
        }
    }
}

impl Default for ContactSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            steps: 16,
            distance: 0.0,
            thickness: 0.0,
        }
    }
}

impl Default for PathSettings {
    fn default() -> Self {
        Self {
            bounces: 16,
            clamp: 0.0,
            sample_environment: true,
            sample_lights: true,
            sample_emitters: true,
            samples_per_frame: 1,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            brdf: Brdf::default(),
            tonemap: Tonemap::default(),
            ev: 0.0,
            ibl_intensity: 1.0,
            ibl_yaw: 0.0,
            skybox: true,
            debug_view: 0,
            msaa: 1,
            prepass: Prepass::default(),
            light: LightSettings::default(),
            shadow: ShadowSettings::default(),
            ao: AoSettings::default(),
            contact: ContactSettings::default(),
            path: PathSettings::default(),
        }
    }
}
