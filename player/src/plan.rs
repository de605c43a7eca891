//! What a frame consists of: the passes and images that a package and the settings ask for.

use cairn_format::Package;
use cairn_format::gpu::{
    ALPHA_BLEND, ALPHA_MASK, FEATURE_AO, FEATURE_CONTACT_SHADOWS, LOBE_CLEARCOAT, LOBE_SHEEN,
    LOBE_SPECULAR,
};

use crate::PlayerError;
use crate::cascade::MAX_CASCADES;
use crate::gpu::Gpu;
use crate::passes::Variant;
use crate::scene::GpuScene;
use crate::settings::{LightSource, Prepass, Settings, Shading};

/// Number of the debug view that shows how often pixels are shaded.
const OVERDRAW_VIEW: u32 = 11;

/// What the passes of ambient occlusion are compiled with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AoPlan {
    /// Slices per pixel.
    pub directions: u32,
    /// Steps per side of a slice.
    pub steps: u32,
    /// Whether frames are joined.
    pub temporal: bool,
}

/// The choices that pipelines and images depend on. A renderer is rebuilt where its plan changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// What is compiled into the surface pipelines.
    pub variant: Variant,
    /// Samples per pixel; what was asked for, or the most that the device has below it.
    pub samples: u32,
    /// Whether surfaces are shaded in compute, from a target that holds which triangle is seen.
    pub compute: bool,
    /// Whether depth is drawn before anything is shaded.
    pub prepass: bool,
    /// Whether the prepass also writes normals and roughness, because a pass reads them.
    pub normals: bool,
    /// Ground-truth ambient occlusion.
    pub ao: Option<AoPlan>,
    /// Contact shadows.
    pub contact: bool,
    /// The sky behind the scene.
    pub skybox: bool,
    /// Counts the fragments that are shaded, without a prepass, instead of drawing them.
    pub overdraw: bool,
    /// The shadow map of the first light that casts.
    pub shadow: Option<ShadowMap>,
}

/// What a shadow map is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShadowMap {
    /// Texels of a side.
    pub resolution: u32,
    /// Layers.
    pub cascades: u32,
}

impl Plan {
    /// The choices come from the draw groups, not from the feature bits that the bake wrote beside them.
    ///
    /// # Errors
    /// A damaged package.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        package: &Package,
        settings: &Settings,
    ) -> Result<Self, PlayerError> {
        let groups = package.draw_groups()?;
        let has = |mode: u32| groups.iter().any(|group| group.alpha_mode == mode);
        let (lights, casts) = scene.lights.count(settings);
        let overdraw = settings.debug_view == OVERDRAW_VIEW;
        let drawn = !groups.is_empty() && !overdraw;
        let ao = drawn && settings.ao.enabled;
        let contact = drawn && settings.contact.enabled && lights > 0;
        let extensions = package.material_extensions()?;
        let casters = groups.iter().any(|group| group.alpha_mode != ALPHA_BLEND);
        let shadow = (drawn && settings.shadow.enabled && casts && casters).then(|| ShadowMap {
            resolution: settings.shadow.resolution,
            cascades: settings.shadow.cascades.clamp(1, MAX_CASCADES as u32),
        });
        let has_lobe = |bit: u32| extensions.iter().any(|lobes| lobes.lobes & bit != 0);
        let variant = Variant {
            masked: has(ALPHA_MASK),
            blended: has(ALPHA_BLEND),
            environment: scene.environment.is_some(),
            brdf_lut: scene.brdf_lut_slot.is_some(),
            lights: lights > 0,
            brdf: settings.brdf,
            vertex_colors: scene.vertex_colors.is_some(),
            texture_transforms: scene.texture_transforms.is_some(),
            clearcoat: has_lobe(LOBE_CLEARCOAT),
            specular: has_lobe(LOBE_SPECULAR),
            sheen: has_lobe(LOBE_SHEEN) && scene.brdf_lut_slot.is_some(),
            punctual_lights: match settings.light.source {
                LightSource::Auto | LightSource::Scene => scene.punctual_light_count,
                LightSource::Sun | LightSource::Fallback | LightSource::None => 0,
            },
            debug_view: settings.debug_view != 0,
            screen_occlusion: ao,
            contact_shadows: contact,
            shadows: shadow.map(|_| settings.shadow.filter),
        };
        let normals = ao || contact;
        let compute = drawn && shades_in_compute(gpu, scene, package, settings)?;
        Ok(Self {
            variant,
            samples: match compute {
                true => gpu.integer_samples(settings.msaa),
                false => gpu.samples(settings.msaa),
            },
            compute,
            prepass: match settings.prepass {
                _ if compute => false,
                Prepass::Auto => normals,
                Prepass::On => !overdraw,
                Prepass::Off => normals,
            },
            normals,
            ao: ao.then_some(AoPlan {
                directions: settings.ao.directions,
                steps: settings.ao.steps,
                temporal: settings.ao.temporal > 0.0,
            }),
            contact,
            skybox: variant.environment && settings.skybox && !overdraw,
            overdraw,
            shadow,
        })
    }

    /// Bits of `GlobalUniform::feature_flags`: what runs before surfaces are shaded, shadow maps excepted.
    pub fn feature_flags(&self) -> u32 {
        let flag = |on: bool, bit| if on { bit } else { 0 };
        flag(self.ao.is_some(), FEATURE_AO) | flag(self.contact, FEATURE_CONTACT_SHADOWS)
    }
}

/// Needs a device that tells fragments their triangle, arenas that shaders can read whole, and draw groups in the
/// order of their instances, which is the bake's. Software devices shade fragments as fast as anything else.
fn shades_in_compute(
    gpu: &Gpu,
    scene: &GpuScene,
    package: &Package,
    settings: &Settings,
) -> Result<bool, PlayerError> {
    let wanted = match settings.shading {
        Shading::Auto => !gpu.is_software(),
        Shading::Compute => true,
        Shading::Forward => false,
    };
    let groups = package.draw_groups()?;
    let ordered = groups.is_sorted_by_key(|group| group.first_instance);
    let largest = u64::from(gpu.limits().max_storage_buffer_range);
    let arenas = [&scene.vertices, &scene.indices];
    let readable = arenas.iter().all(|arena| {
        arena
            .as_ref()
            .is_some_and(|buffer| buffer.size() <= largest)
    });
    Ok(wanted && ordered && readable && gpu.numbers_triangles())
}
