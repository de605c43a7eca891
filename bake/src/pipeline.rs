//! The bake, top to bottom: import -> prepare -> encode -> write.

use std::path::PathBuf;
use std::time::Instant;

use cairn_format::bounds::to_arrays;
use cairn_format::scene::{
    self as root, Bounds, MaterialInfo, MipFilter, Provenance, ReportRow, Setting, SourceFile,
};
use cairn_format::{SectionKind, Writer, features};

use crate::cache::Session;
use crate::diagnostic::{BakeError, Diagnostic, Result};
use crate::encode::{Codec, EncodeOptions, SkyFormat, Target};
use crate::environment::EnvironmentOptions;
use crate::import::{Rules, import_with};
use crate::materials::{self, Plan};
use crate::memory::{self, DEFAULT_LIMIT_MEMORY};
use crate::panorama::{self, Panorama};
use crate::peak::peak_memory;
use crate::prepare::{Prepared, StepTime, prepare_cached};
use crate::progress::Progress;
use crate::report::{Row, Stage, Summary};
use crate::scene::{Origin, Sampler, Scene, Source, Wrap};
use crate::strict::Strict;
use crate::textures::{self, Texels};
use crate::{constants, emitters, rebake, write};

/// What to bake, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// The scene: .gltf or .glb.
    pub input: PathBuf,
    /// An equirectangular panorama, .hdr or .exr.
    pub environment: Option<PathBuf>,
    /// The package to write: whole or not at all.
    pub output: PathBuf,
    /// Effort, mip filter and kernels of the texture encoders.
    pub textures: EncodeOptions,
    /// Sizes, sun and error bound of image-based light.
    pub light: EnvironmentOptions,
    /// Storage of the sky and of the prefiltered cube.
    pub sky_format: SkyFormat,
    /// Largest number of texels of one image.
    pub limit_pixels: u64,
    /// Bytes of memory: images are decoded fewer at a time to stay within. It decides no bytes of the package.
    pub limit_memory: u64,
    /// Files that the scene may name, and its most triangles.
    pub rules: Rules,
    /// Folder of the products of earlier bakes; `None` makes everything anew. It decides no bytes.
    pub cache: Option<PathBuf>,
    /// Warnings that stop the bake.
    pub strict: Strict,
}

impl Options {
    /// A bake without an environment, everything else as the command line has it by default.
    pub fn new(input: impl Into<PathBuf>, output: impl Into<PathBuf>) -> Self {
        Self {
            input: input.into(),
            environment: None,
            output: output.into(),
            textures: EncodeOptions::default(),
            light: EnvironmentOptions::default(),
            sky_format: SkyFormat::default(),
            limit_pixels: DEFAULT_LIMIT_PIXELS,
            limit_memory: DEFAULT_LIMIT_MEMORY,
            rules: Rules::default(),
            cache: None,
            strict: Strict::No,
        }
    }
}

/// Texels of an image of 16384 x 16384.
pub const DEFAULT_LIMIT_PIXELS: u64 = 1 << 28;

/// Bakes one package.
///
/// # Errors
/// [`BakeError`] naming file, place and remedy; the output is then as it was.
pub fn bake(options: &Options, progress: &dyn Progress) -> Result<Summary> {
    let start = Instant::now();
    let mut clock = Clock::default();
    refuse_to_overwrite_an_input(options)?;
    refuse_an_unportable_sky(options)?;
    let session = rebake::session(options);
    if let Some(mut summary) = rebake::unchanged(&session, options) {
        clock.lap("unchanged");
        options.strict.check(&summary.diagnostics)?;
        summary.stages = clock.stages;
        summary.peak_memory_bytes = peak_memory();
        summary.seconds = start.elapsed().as_secs_f64();
        return Ok(summary);
    }

    progress.update("import", 0.0);
    let mut scene = import_with(&options.input, &options.rules)?;
    let radiance = Codec::radiance(options.sky_format, options.textures.effort);
    let mut environment = options
        .environment
        .as_deref()
        .map(|path| {
            let limit = options.limit_memory;
            Panorama::open(path, &options.light, radiance, limit, &session)
        })
        .transpose()?;
    clock.lap("import");

    constants::fold(&mut scene, options.limit_pixels, &session)?;
    clock.lap("constants");

    // Preparing takes the meshes out of the scene.
    let panorama = environment.as_ref().map_or(0, Panorama::held_bytes);
    let left = memory::left_for_images(&scene, panorama, options.limit_memory)?;
    let mut prepared = prepare_cached(&mut scene, &session, &|fraction| {
        progress.update("geometry", fraction)
    })?;
    let geometry_seconds = clock.lap("geometry");

    let plan = materials::plan(&scene, &prepared.materials_used, options.textures.toksvig);
    let encoded = textures::encode_all(
        &scene,
        &plan,
        &options.textures,
        textures::Limits {
            pixels: options.limit_pixels,
            memory: left,
        },
        &session,
        &|fraction| {
            progress.update("textures", fraction);
        },
    )?;
    let mut texels = Texels::default();
    let stored = textures::store(&mut texels, &scene, &plan, &encoded);
    drop(encoded);
    clock.lap("textures");

    emitters::weigh_cached(
        &scene,
        &prepared.materials_used,
        &mut prepared.emissive_triangles,
        options.limit_pixels,
        &session,
    )?;
    let emissive_table = emitters::table(&prepared.emissive_triangles);
    clock.lap("emitters");

    let light = store_environment(
        &session,
        &mut texels,
        environment.as_mut(),
        &prepared,
        progress,
    )?;
    clock.lap("environment");

    let stages = [
        &scene.diagnostics,
        &prepared.diagnostics,
        &light.diagnostics,
        &texels.diagnostics,
    ];
    options.strict.check(stages.into_iter().flatten())?;

    progress.update("write", 0.0);
    let products = Products {
        scene: &scene,
        panorama: environment.as_ref(),
        prepared: &prepared,
        plan: &plan,
        stored: &stored,
        texels: &texels,
        light: &light,
    };
    let root = assemble(options, products);
    let bounds =
        [&prepared.instance_bounds, &prepared.cluster_bounds].map(|boxes| to_arrays(boxes));
    let mut writer = sections(&prepared, &plan, &bounds, &texels, &light);
    writer.bytes(
        SectionKind::EmissiveAlias,
        bytemuck::cast_slice::<_, u8>(&emissive_table),
    );
    let written = write::write(&options.output, &writer, &root)?;
    clock.lap("write");
    progress.update("write", 1.0);

    let mut summary = summarize(options, &scene, &prepared, &root, geometry_seconds);
    summary.diagnostics.extend(light.diagnostics);
    summary.diagnostics.extend(texels.diagnostics);
    summary.report.extend(texels.report);
    summary.package_bytes = written.bytes;
    summary.content_hash = hex(&written.content_hash);
    summary.sections = written.sections;
    summary.stages = clock.stages;
    summary.peak_memory_bytes = peak_memory();
    let panorama = environment.map(|panorama| panorama.source.hash);
    rebake::remember(
        session,
        options,
        &scene,
        panorama,
        written.content_hash,
        &mut summary,
    );
    summary.seconds = start.elapsed().as_secs_f64();
    Ok(summary)
}

/// Wall times of the stages.
struct Clock {
    last: Instant,
    stages: Vec<Stage>,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            last: Instant::now(),
            stages: Vec::new(),
        }
    }
}

impl Clock {
    fn lap(&mut self, name: &'static str) -> f64 {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        self.stages.push(Stage { name, seconds });
        seconds
    }
}

fn refuse_to_overwrite_an_input(options: &Options) -> Result<()> {
    let Ok(output) = options.output.canonicalize() else {
        return Ok(());
    };
    let inputs = [Some(&options.input), options.environment.as_ref()];
    let same = |input: &&PathBuf| input.canonicalize().is_ok_and(|input| input == output);
    match inputs.into_iter().flatten().find(same) {
        Some(input) => {
            let origin = Origin {
                file: input.display().to_string(),
                pointer: String::new(),
            };
            Err(BakeError::input(
                "output-is-input",
                &origin,
                "the output would overwrite this input; choose another -o",
            ))
        }
        None => Ok(()),
    }
}

/// BC6H is what portable packages must not hold.
fn refuse_an_unportable_sky(options: &Options) -> Result<()> {
    let portable = options.textures.target == Target::Portable;
    match &options.environment {
        Some(path) if portable && options.sky_format == SkyFormat::Bc6h => {
            let origin = Origin {
                file: path.display().to_string(),
                pointer: String::new(),
            };
            let message = "not every GPU reads BC6H: with --target portable choose --sky-format rgb9e5 or rgba16f";
            Err(BakeError::input("sky-format", &origin, message))
        }
        _ => Ok(()),
    }
}

/// What the stored environment adds to the root, and its importance table's section.
#[derive(Default)]
struct StoredLight {
    environment: Option<root::Environment>,
    brdf_lut: Option<u32>,
    alias: Vec<u8>,
    diagnostics: Vec<Diagnostic>,
}

fn store_environment(
    session: &Session,
    texels: &mut Texels,
    panorama: Option<&mut Panorama>,
    prepared: &Prepared,
    progress: &dyn Progress,
) -> Result<StoredLight> {
    let mut light = StoredLight::default();
    if let Some(panorama) = panorama {
        let stored = panorama.store(texels, session, &|stage, fraction| {
            progress.update(&format!("environment: {stage}"), fraction);
        })?;
        light.environment = Some(stored.environment);
        light.alias = stored.alias;
        light.diagnostics = stored.diagnostics;
    }
    let lights = !prepared.lights.is_empty() || !prepared.emissive_triangles.is_empty();
    let sheen = prepared.features & features::SHEEN != 0;
    if light.environment.is_some() || lights || sheen {
        light.brdf_lut = Some(panorama::store_lut(texels, sheen, session)?);
    }
    Ok(light)
}

fn sections<'a>(
    prepared: &'a Prepared,
    plan: &'a Plan,
    [instance_bounds, cluster_bounds]: &'a [Vec<f32>; 2],
    texels: &'a Texels,
    light: &'a StoredLight,
) -> Writer<'a> {
    let mut writer = Writer::new();
    writer
        .records(SectionKind::Vertices, &prepared.vertices)
        .bytes(
            SectionKind::Indices,
            bytemuck::cast_slice::<_, u8>(&prepared.indices),
        )
        .records(SectionKind::Instances, &prepared.instances)
        .bytes(
            SectionKind::InstanceBounds,
            bytemuck::cast_slice::<_, u8>(instance_bounds),
        )
        .bytes(
            SectionKind::ClusterBounds,
            bytemuck::cast_slice::<_, u8>(cluster_bounds),
        )
        .records(SectionKind::DrawGroups, &prepared.draw_groups)
        .records(SectionKind::MeshInstances, &prepared.mesh_instances)
        .records(SectionKind::Materials, &plan.materials)
        .records(SectionKind::DirectionalLights, &prepared.directional_lights)
        .records(SectionKind::EmissiveTriangles, &prepared.emissive_triangles)
        .records(SectionKind::TextureTransforms, &plan.transforms)
        .records(SectionKind::VertexColors, &prepared.colors)
        .records(SectionKind::PunctualLights, &prepared.punctual_lights)
        .records(SectionKind::MaterialExtensions, &plan.extensions)
        .bytes(SectionKind::Texels, texels.bytes.as_slice())
        .bytes(SectionKind::EnvAlias, light.alias.as_slice());
    writer
}

/// What the stages produced, on its way into the root.
struct Products<'a> {
    scene: &'a Scene,
    panorama: Option<&'a Panorama>,
    prepared: &'a Prepared,
    plan: &'a Plan,
    /// Stored image of each of the plan's images.
    stored: &'a [u32],
    texels: &'a Texels,
    light: &'a StoredLight,
}

fn assemble(options: &Options, products: Products) -> root::Scene {
    let Products {
        scene,
        panorama,
        prepared,
        plan,
        stored,
        texels,
        light,
    } = products;
    let environment_bits = light.environment.as_ref().map_or(0, |environment| {
        let sun = environment.sun.as_ref().map_or(0, |_| features::SUN);
        features::ENVIRONMENT | sun
    });
    let textures = plan.slots.iter().map(|slot| root::Texture {
        image: stored[slot.image as usize],
        sampler: slot.sampler,
    });
    let bounds = if prepared.bounds.is_empty() {
        Bounds::ZERO
    } else {
        Bounds {
            min: prepared.bounds.min.to_array(),
            max: prepared.bounds.max.to_array(),
        }
    };
    root::Scene {
        name: scene.name.clone(),
        features: prepared.features | plan.features | environment_bits,
        bounds,
        meshes: prepared.meshes.clone(),
        primitives: prepared.primitives.clone(),
        materials: plan
            .names
            .iter()
            .map(|name| MaterialInfo { name: name.clone() })
            .collect(),
        textures: textures.collect(),
        images: texels.images.clone(),
        samplers: plan.samplers.iter().map(sampler).collect(),
        lights: prepared.lights.clone(),
        cameras: prepared.cameras.clone(),
        environment: light.environment.clone(),
        brdf_lut: light.brdf_lut,
        provenance: provenance(options, scene, panorama),
        report: prepared
            .report
            .iter()
            .cloned()
            .chain(texels.report.iter().map(report_row))
            .collect(),
    }
}

fn sampler(sampler: &Sampler) -> root::Sampler {
    let wrap = |wrap| match wrap {
        Wrap::Repeat => root::Wrap::Repeat,
        Wrap::MirroredRepeat => root::Wrap::MirroredRepeat,
        Wrap::ClampToEdge => root::Wrap::ClampToEdge,
    };
    root::Sampler {
        mag_linear: sampler.mag_linear,
        min_linear: sampler.min_linear,
        mip: match sampler.mip_linear {
            None => MipFilter::None,
            Some(false) => MipFilter::Nearest,
            Some(true) => MipFilter::Linear,
        },
        wrap_u: wrap(sampler.wrap_u),
        wrap_v: wrap(sampler.wrap_v),
    }
}

fn provenance(options: &Options, scene: &Scene, environment: Option<&Panorama>) -> Provenance {
    let setting = |name: &str, value: String| Setting {
        name: name.into(),
        value,
    };
    let file = |source: &Source, path: String| SourceFile {
        path,
        bytes: source.bytes,
        hash: source.hash,
    };
    let mut sources: Vec<SourceFile> = scene
        .sources
        .iter()
        .map(|source| file(source, source.path.clone()))
        .collect();
    // Only the file name: where a panorama lies must not change the bytes.
    sources.extend(environment.map(|image| {
        let name = options
            .environment
            .as_deref()
            .and_then(|path| path.file_name())
            .unwrap_or_default();
        file(&image.source, name.to_string_lossy().into_owned())
    }));
    let sky_size = environment.and(options.light.sky_size);
    Provenance {
        tool: tool(),
        settings: options
            .textures
            .provenance()
            .into_iter()
            .map(|(name, value)| setting(name, value))
            .chain(environment.into_iter().flat_map(|_| {
                [
                    setting(
                        "sky-format",
                        format!("{:?}", options.sky_format).to_lowercase(),
                    ),
                    setting("sun", format!("{:?}", options.light.sun).to_lowercase()),
                    setting("ibl-error", options.light.error.to_string()),
                ]
            }))
            .chain(sky_size.map(|size| setting("sky-size", size.to_string())))
            .collect(),
        sources,
    }
}

/// Name and version of this tool.
pub fn tool() -> String {
    concat!("cairn-bake ", env!("CARGO_PKG_VERSION")).into()
}

fn report_row(row: &crate::report::Row) -> ReportRow {
    ReportRow {
        stage: row.stage.clone(),
        item: row.item.clone(),
        setting: row.setting.clone(),
        metric: row.metric.clone(),
        error: row.error,
        bytes: row.bytes,
    }
}

fn summarize(
    options: &Options,
    scene: &Scene,
    prepared: &Prepared,
    root: &root::Scene,
    geometry_seconds: f64,
) -> Summary {
    Summary {
        input: options.input.display().to_string(),
        output: options.output.display().to_string(),
        tool: tool(),
        triangles: prepared.indices.len() as u64 / 3,
        vertices: prepared.vertices.len() as u64,
        meshes: root.meshes.len() as u64,
        primitives: root.primitives.len() as u64,
        instances: prepared.instances.len() as u64,
        draw_groups: prepared.draw_groups.len() as u64,
        materials: root.materials.len() as u64,
        textures: root.textures.len() as u64,
        images: root.images.len() as u64,
        lights: root.lights.len() as u64,
        cameras: root.cameras.len() as u64,
        features: features::names(root.features),
        geometry: prepared.stats,
        report: prepared
            .report
            .iter()
            .map(|row| geometry_row(row, &prepared.steps, geometry_seconds))
            .collect(),
        geometry_steps: prepared.steps.clone(),
        diagnostics: scene
            .diagnostics
            .iter()
            .chain(&prepared.diagnostics)
            .cloned()
            .collect(),
        ..Summary::default()
    }
}

/// A row that is named after a step states its time and speed, others state the time of the whole stage.
fn geometry_row(row: &ReportRow, steps: &[StepTime], seconds: f64) -> Row {
    let step = steps.iter().find(|step| row.item == step.name);
    Row {
        stage: row.stage.clone(),
        item: row.item.clone(),
        setting: row.setting.clone(),
        seconds: step.map_or(seconds, |step| step.seconds),
        throughput: step.and_then(StepTime::mega_triangles_per_second),
        throughput_unit: "Mtri/s",
        metric: row.metric.clone(),
        error: row.error,
        bytes: row.bytes,
    }
}

/// Lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_steps_have_their_time() {
        let row = |item: &str| ReportRow {
            stage: "geometry".into(),
            item: item.into(),
            setting: String::new(),
            metric: String::new(),
            error: 0.0,
            bytes: 0,
        };
        let step = StepTime {
            name: "weld",
            seconds: 0.5,
            triangles: 2_000_000,
        };
        let weld = geometry_row(&row("weld"), &[step], 9.0);
        assert_eq!((weld.seconds, weld.throughput), (0.5, Some(4.0)));
        let other = geometry_row(&row("instance bounds"), &[step], 9.0);
        assert_eq!((other.seconds, other.throughput), (9.0, None));
    }
}
