//! Every tunable of a frame, its default, and its allowed values.
//!
//! This is the one place where a setting is declared. From the tables below follow the command line
//! (`--shadow-cascades 3`, `--no-ao`: see [`flags`]), the JSON of `--settings` and of reports (see [`json`]), and
//! the panel of the window. **To add a setting**, add one line to its group:
//!
//! ```text
//! /// What it does, and its unit. This text is the help of the flag and of the panel.
//! name: type = default, kind;
//! ```
//!
//! `type` is `bool`, `u32`, `f32` or an enumeration declared with `choice!`; `kind` is [`Switch`],
//! `Integer(least, most)`, `OneOf(&[..])`, `Number(least, most)`, `Degrees(least, most)` (an `f32` in radians that
//! people write in degrees; JSON has radians) or `Choice(Type::CHOICES)`. The flag is `--GROUP-NAME` with hyphens;
//! `enabled` is `--GROUP`. A switch has `--X` and `--no-X`. A test holds that every default is allowed.

pub mod flags;
pub mod json;
pub mod table;

use table::Kind::{Choice, Degrees, Integer, Number, OneOf, Switch};
use table::{choice, group};

/// Reach of ambient occlusion where none is set, as a share of the scene's diagonal.
const AO_RADIUS_SHARE: f32 = 0.04;

choice! {
    /// What draws the frame.
    pub enum Mode {
        /// The raster pipeline.
        Raster = "raster",
        /// The path-traced reference, where the device can trace rays.
        PathTrace = "path-trace",
    }
}

choice! {
    /// Sample coordinates of the path tracer; in the order of `SAMPLER_*` in `path_options.glsl`.
    pub enum PathSampler {
        /// Owen-scrambled Sobol points, those of neighbouring pixels in each other's gaps: at low counts the error has
        /// high frequency over the screen.
        BlueNoise = "blue-noise",
        /// Independent random numbers, what the others are measured against.
        Independent = "independent",
        /// Owen-scrambled Sobol points, every pixel's without regard to its neighbours'.
        Owen = "owen",
    }
}

choice! {
    /// How the specular lobe treats light that bounces more than once between microfacets.
    pub enum Brdf {
        /// Compensated, so that a white furnace closes (Turquin 2019).
        Energy = "energy",
        /// Single scatter, exactly glTF 2.0 appendix B.
        GltfCore = "gltf-core",
    }
}

choice! {
    /// How linear radiance becomes a display value.
    pub enum Tonemap {
        /// Narkowicz's fit of the ACES curve.
        Aces = "aces",
        /// Clamped to 0..=1.
        Linear = "linear",
        /// Troy Sobotka's AgX, base look.
        Agx = "agx",
        /// Khronos PBR Neutral.
        Neutral = "neutral",
    }
}

choice! {
    /// Where surfaces are shaded.
    pub enum Shading {
        /// In compute on GPUs, in fragments on software devices.
        Auto = "auto",
        /// In fragments, as they are drawn.
        Forward = "forward",
        /// In compute, from a target that holds which triangle is seen.
        Compute = "compute",
    }
}

choice! {
    /// Whether depth is drawn before surfaces are shaded.
    pub enum Prepass {
        /// Where a pass reads depth or normals before surfaces are shaded.
        Auto = "auto",
        /// Always.
        On = "on",
        /// Only where a pass could not work without.
        Off = "off",
    }
}

choice! {
    /// Which directional lights shine.
    pub enum LightSource {
        /// Those of the scene; without them the environment's sun; without an environment the fallback light.
        Auto = "auto",
        /// Those of the scene.
        Scene = "scene",
        /// The sun that the bake took out of the environment.
        Sun = "sun",
        /// One white light from `light.yaw` and `light.pitch`.
        Fallback = "fallback",
        /// None.
        None = "none",
    }
}

choice! {
    /// How many taps soft shadows take.
    pub enum Quality {
        /// 16 blocker and 16 filter taps.
        Low = "low",
        /// 16 and 25.
        Medium = "medium",
        /// 32 and 49.
        High = "high",
    }
}

choice! {
    /// How shadow edges are filtered.
    pub enum ShadowFilter {
        /// A fixed kernel of hardware comparisons.
        Pcf = "pcf",
        /// Penumbrae that grow with the distance to the blocker.
        Pcss = "pcss",
    }
}

choice! {
    /// How ambient occlusion darkens reflections.
    pub enum SpecularOcclusion {
        /// From the amount of occlusion (Lagarde and de Rousiers 2014).
        Lagarde = "lagarde",
        /// From the bent normal (Jimenez et al. 2016).
        Gtso = "gtso",
    }
}

group! {
    /// The directional light.
    pub struct LightSettings {
        /// Which directional lights shine.
        source: LightSource = LightSource::Auto, Choice(LightSource::CHOICES);
        /// Fallback light: about +Y; 0 shines from +Z.
        yaw: f32 = 0.7, Degrees(-360.0, 360.0);
        /// Fallback light: negative shines from above.
        pitch: f32 = -0.9, Degrees(-90.0, 90.0);
        /// Fallback light: lux.
        intensity: f32 = 3.0, Number(0.0, 1e6);
    }
}

group! {
    /// Cascaded shadow maps.
    pub struct ShadowSettings {
        /// Directional lights cast shadows.
        enabled: bool = true, Switch;
        /// Shadow maps that share the distance.
        cascades: u32 = 4, Integer(1, 4);
        /// Texels of a side of each map.
        resolution: u32 = 2048, OneOf(&[512, 1024, 2048, 4096]);
        /// Metres; 0 takes 1.5 diagonals of the scene.
        max_distance: f32 = 0.0, Number(0.0, 1e9);
        /// 0 splits the distance evenly, 1 logarithmically.
        lambda: f32 = 0.75, Number(0.0, 1.0);
        /// Depth bias per slope.
        slope_bias: f32 = 0.5, Number(0.0, 16.0);
        /// Offset along the geometric normal, in shadow texels.
        normal_offset: f32 = 1.0, Number(0.0, 16.0);
        /// How edges are filtered.
        filter: ShadowFilter = ShadowFilter::Pcf, Choice(ShadowFilter::CHOICES);
        /// PCF: a kernel of 2 r + 1 taps a side.
        pcf_radius: u32 = 1, Integer(0, 5);
        /// PCSS: taps.
        quality: Quality = Quality::Medium, Choice(Quality::CHOICES);
        /// PCSS: angular diameter of lights that have none of their own.
        angular_diameter: f32 = 0.00925, Degrees(0.0, 45.0);
        /// PCSS: a search that finds blockers only ends there.
        early_out: bool = true, Switch;
        /// Fraction of a cascade's end over which it blends into the next.
        blend_width: f32 = 0.1, Number(0.0, 1.0);
        /// Fraction of the distance over which shadows fade.
        fade_width: f32 = 0.1, Number(0.0, 1.0);
    }
}

group! {
    /// Ground-truth ambient occlusion.
    pub struct AoSettings {
        /// Ambient light is occluded by what the screen shows.
        enabled: bool = true, Switch;
        /// Metres; 0 takes a fraction of the scene's diagonal.
        radius: f32 = 0.0, Number(0.0, 1e9);
        /// Slices per pixel.
        directions: u32 = 4, Integer(1, 16);
        /// Steps per side of a slice.
        steps: u32 = 4, Integer(1, 32);
        /// How much thin occluders let through.
        thin_compensation: f32 = 0.2, Number(0.0, 0.7);
        /// Exponent of the visibility.
        intensity: f32 = 1.0, Number(0.0, 8.0);
        /// Weight of the history.
        temporal: f32 = 0.9, Number(0.0, 0.98);
        /// How reflections are occluded.
        specular: SpecularOcclusion = SpecularOcclusion::Gtso, Choice(SpecularOcclusion::CHOICES);
    }
}

group! {
    /// Screen-space shadows of small things.
    pub struct ContactSettings {
        /// Small things cast shadows that no map resolves.
        enabled: bool = true, Switch;
        /// Steps per ray.
        steps: u32 = 16, Integer(1, 64);
        /// Metres; 0 takes a fraction of the scene's diagonal.
        distance: f32 = 0.0, Number(0.0, 1e9);
        /// Metres; 0 takes a fraction of the distance.
        thickness: f32 = 0.0, Number(0.0, 1e9);
    }
}

group! {
    /// The path tracer.
    pub struct PathSettings {
        /// Longest path, in surface hits after the camera's.
        bounces: u32 = 16, Integer(0, 256);
        /// Firefly clamp of indirect light by its largest channel; 0 is off.
        clamp: f32 = 0.0, Number(0.0, 1e9);
        /// Samples the environment's table.
        sample_environment: bool = true, Switch;
        /// Samples directional, point and spot lights.
        sample_lights: bool = true, Switch;
        /// Samples emissive triangles.
        sample_emitters: bool = true, Switch;
        /// Samples per pixel in a frame.
        samples_per_frame: u32 = 1, Integer(1, 1024);
        /// Where sample coordinates come from.
        sampler: PathSampler = PathSampler::Owen, Choice(PathSampler::CHOICES);
        /// Seed of the samples.
        seed: u32 = 0, Integer(0, 0x7fff_ffff);
        /// Camera rays pass single-sided surfaces from behind, as raster shows it; otherwise they end there, in black, as
        /// in renderers that cull nothing.
        see_through: bool = true, Switch;
        /// Texture levels follow the width of rays; otherwise the finest is read.
        lod: bool = true, Switch;
        /// Meshes share one acceleration structure where that copies few triangles. Read when a scene is opened.
        merge: bool = true, Switch;
        /// Denoises headless pictures by Open Image Denoise: needs a build with the feature `oidn`, and the library.
        /// A reference is never denoised: `compare`, `sweep` and `bench` refuse it.
        denoise: bool = false, Switch;
    }
}

group! {
    /// What a frame looks like.
    pub struct Settings {
        /// What draws the frame.
        mode: Mode = Mode::Raster, Choice(Mode::CHOICES);
        /// Energy-compensated BRDF, or exactly glTF's core one.
        brdf: Brdf = Brdf::Energy, Choice(Brdf::CHOICES);
        /// Display curve.
        tonemap: Tonemap = Tonemap::Aces, Choice(Tonemap::CHOICES);
        /// Exposure value: radiance is multiplied by 2^ev.
        ev: f32 = 0.0, Number(-64.0, 64.0);
        /// Multiplier of image-based light.
        ibl_intensity: f32 = 1.0, Number(0.0, 1e6);
        /// Yaw of the environment about +Y.
        ibl_yaw: f32 = 0.0, Degrees(-360.0, 360.0);
        /// The environment is drawn behind the scene.
        skybox: bool = true, Switch;
        /// Debug view: 0 full image, 1 diffuse, 2 specular, 3 indirect, 4 normal, 5 metallic, 6 roughness, 7 occlusion,
        /// 8 cascades, 9 raw ambient occlusion, 10 contact shadows, 11 overdraw, 12 mip level.
        debug_view: u32 = 0, Integer(0, 12);
        /// Samples per pixel.
        msaa: u32 = 1, OneOf(&[1, 2, 4, 8]);
        /// Where surfaces are shaded.
        shading: Shading = Shading::Auto, Choice(Shading::CHOICES);
        /// Depth before shading.
        prepass: Prepass = Prepass::Auto, Choice(Prepass::CHOICES);
        + light: LightSettings;
        + shadow: ShadowSettings;
        + ao: AoSettings;
        + contact: ContactSettings;
        + path: PathSettings;
    }
}

/// Where a setting is: a group (0 is [`Settings`] itself, then [`Settings::MEMBERS`]) and a field in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the group.
    pub group: usize,
    /// Number of the field in it.
    pub field: usize,
}

impl Settings {
    /// Names of the groups in [`Place`]'s order; the first has none.
    pub fn group_names() -> impl Iterator<Item = &'static str> {
        std::iter::once("").chain(Self::MEMBERS.iter().copied())
    }

    /// The group of that number.
    ///
    /// # Panics
    /// Where there are fewer.
    pub fn group(&self, group: usize) -> &dyn table::Group {
        match group.checked_sub(1) {
            None => self,
            Some(member) => self.member(member),
        }
    }

    /// As [`Self::group`].
    ///
    /// # Panics
    /// Where there are fewer.
    pub fn group_mut(&mut self, group: usize) -> &mut dyn table::Group {
        match group.checked_sub(1) {
            None => self,
            Some(member) => self.member_mut(member),
        }
    }

    /// Every setting with its group's name, in the order of declaration.
    pub fn places(&self) -> Vec<(Place, &'static str, &'static table::Field)> {
        let mut places = Vec::new();
        for (group, name) in Self::group_names().enumerate() {
            for (field, entry) in self.group(group).fields().iter().enumerate() {
                places.push((Place { group, field }, name, entry));
            }
        }
        places
    }

    /// The value there.
    pub fn get(&self, place: Place) -> table::Value {
        self.group(place.group).get(place.field)
    }

    /// Replaces the value there; false where it is not allowed.
    pub fn set(&mut self, place: Place, value: table::Value) -> bool {
        self.group_mut(place.group).set(place.field, value)
    }
}

impl AoSettings {
    /// Reach in a scene of this diagonal, metres.
    pub fn reach(&self, diagonal: f32) -> f32 {
        match self.radius {
            0.0 => AO_RADIUS_SHARE * diagonal,
            radius => radius,
        }
    }
}

#[cfg(test)]
mod tests;
