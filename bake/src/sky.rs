//! Loads, bakes and stores the environment: three cubes and the BRDF table.

use cairn_format::TextureFormat;
use cairn_format::scene::{Environment, ImageRole};

use crate::environment::{
    Cube, DEFAULT_LUT_SIZE, EnvironmentOptions, EnvironmentProducts, Equirect, bake_environment,
    brdf_lut, level_roughness, level_to_rgba16f,
};
use crate::import::EnvironmentImage;
use crate::report::Row;
use crate::textures::{ImageInfo, Texels};

/// Edge length of the BRDF table.
const LUT_SIZE: u32 = DEFAULT_LUT_SIZE;

/// Bakes the cubes of a panorama, whose texels are taken out of `image`.
pub fn bake(
    image: &mut EnvironmentImage,
    progress: &(dyn Fn(&str, f32) + Sync),
) -> EnvironmentProducts {
    let equirect = Equirect {
        width: image.width,
        height: image.height,
        texels: std::mem::take(&mut image.texels),
    };
    bake_environment(&equirect, &EnvironmentOptions::default(), progress)
}

/// Appends the cubes to the texels.
pub fn store(
    texels: &mut Texels,
    image: &EnvironmentImage,
    products: &EnvironmentProducts,
) -> Environment {
    let replaced = &image.replaced;
    let levels = products.prefiltered.levels.len();
    let environment = Environment {
        sky: push_cube(texels, "sky", &products.sky),
        irradiance: push_cube(texels, "irradiance", &products.irradiance),
        prefiltered: push_cube(texels, "prefiltered", &products.prefiltered),
        prefiltered_roughness: (0..levels)
            .map(|level| level_roughness(level, levels) as f32)
            .collect(),
        scale: 1.0,
        sun: None,
        irradiance_sh: products.irradiance_sh,
        source_width: image.width,
        source_height: image.height,
        replaced_texels: replaced.nan + replaced.infinite + replaced.negative,
        clamped_texels: products.clamped_texels,
    };
    for stage in &products.reports {
        let bytes = texels
            .images
            .iter()
            .filter(|image| stage.name.starts_with(image.name.as_str()));
        let bytes = bytes
            .flat_map(|image| &image.levels)
            .map(|level| level.length)
            .sum();
        texels.report.extend(stage.error.map(|error| Row {
            stage: "environment".into(),
            item: stage.name.clone(),
            setting: "Rgba16Float default".into(),
            seconds: stage.seconds,
            throughput: None,
            throughput_unit: "",
            metric: stage.metric.into(),
            error,
            bytes,
        }));
    }
    environment
}

/// Appends the BRDF table; returns its image index.
pub fn store_lut(texels: &mut Texels, sheen: bool) -> u32 {
    let halves: Vec<u8> = brdf_lut(LUT_SIZE, sheen)
        .iter()
        .flatten()
        .flat_map(|value| half::f16::from_f32(*value).to_le_bytes())
        .collect();
    let info = ImageInfo {
        name: "brdf-lut",
        role: ImageRole::Environment,
        format: TextureFormat::Rgba16Float,
        width: LUT_SIZE,
        height: LUT_SIZE,
        layers: 1,
    };
    texels.push(&info, std::iter::once(halves.as_slice()))
}

fn push_cube(texels: &mut Texels, name: &str, cube: &Cube) -> u32 {
    let levels: Vec<Vec<u8>> = cube
        .levels
        .iter()
        .map(|level| level_to_rgba16f(level))
        .collect();
    let info = ImageInfo {
        name,
        role: ImageRole::Environment,
        format: TextureFormat::Rgba16Float,
        width: cube.size,
        height: cube.size,
        layers: 6,
    };
    texels.push(&info, levels.iter().map(Vec::as_slice))
}
