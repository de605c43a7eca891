//! Loads, bakes and stores the environment: three cubes and the BRDF table.

use std::time::Instant;

use cairn_format::TextureFormat;
use cairn_format::brdf_table::BRDF_TABLE_SIZE;
use cairn_format::scene::{Environment, IDENTITY_SWIZZLE, ImageRole, Sun};

use crate::encode::{Codec, RadianceError};
use crate::environment::{
    Cube, EnvironmentOptions, EnvironmentProducts, Equirect, bake_environment, brdf_lut,
    level_roughness,
};
use crate::import::EnvironmentImage;
use crate::report::Row;
use crate::textures::{ImageInfo, Texels};

/// Bakes the cubes of a panorama, whose texels are taken out of `image`.
pub fn bake(
    image: &mut EnvironmentImage,
    options: &EnvironmentOptions,
    progress: &(dyn Fn(&str, f32) + Sync),
) -> EnvironmentProducts {
    let equirect = Equirect {
        width: image.width,
        height: image.height,
        texels: std::mem::take(&mut image.texels),
    };
    bake_environment(equirect, options, progress)
}

/// Appends the cubes to the texels.
pub fn store(
    texels: &mut Texels,
    image: &EnvironmentImage,
    products: &EnvironmentProducts,
    codec: Codec,
) -> Environment {
    let replaced = &image.replaced;
    let levels = products.prefiltered.levels.len();
    let environment = Environment {
        sky: push_cube(texels, "sky", &products.sky, codec),
        irradiance: push_cube(texels, "irradiance", &products.irradiance, Codec::Half),
        prefiltered: push_cube(texels, "prefiltered", &products.prefiltered, codec),
        prefiltered_roughness: (0..levels)
            .map(|level| level_roughness(level, levels) as f32)
            .collect(),
        scale: products.scale,
        sun: products.sun.map(|sun| Sun {
            direction: sun.direction,
            color: sun.color,
            illuminance: sun.illuminance,
            angular_radius: sun.angular_radius,
        }),
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
            setting: format!("error {}", products.error_bound),
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
    let halves: Vec<u8> = brdf_lut(BRDF_TABLE_SIZE, sheen)
        .iter()
        .flatten()
        .flat_map(|value| half::f16::from_f32(*value).to_le_bytes())
        .collect();
    let info = ImageInfo {
        name: "brdf-lut",
        role: ImageRole::Environment,
        format: TextureFormat::Rgba16Float,
        swizzle: IDENTITY_SWIZZLE,
        width: BRDF_TABLE_SIZE,
        height: BRDF_TABLE_SIZE,
        layers: 1,
    };
    texels.push(&info, std::iter::once(halves.as_slice()))
}

fn push_cube(texels: &mut Texels, name: &str, cube: &Cube, codec: Codec) -> u32 {
    let start = Instant::now();
    let sized = || (0..).map(|level| cube.level_size(level));
    let levels = cube.levels.iter().zip(sized());
    let levels: Vec<Vec<u8>> = levels
        .map(|(level, size)| codec.compress_cube(level, size))
        .collect();
    let seconds = start.elapsed().as_secs_f64();
    let mut lost = RadianceError::default();
    for ((level, size), bytes) in cube.levels.iter().zip(sized()).zip(&levels) {
        lost.merge(&RadianceError::of(codec, level, size, bytes));
    }
    let count: usize = cube.levels.iter().map(Vec::len).sum();
    let format = codec.radiance_format();
    let setting = format!("{format:?} {}", codec.setting());
    let row = |metric: &str, error| Row {
        stage: "environment".into(),
        item: format!("{name} stored"),
        setting: setting.trim_end().into(),
        seconds,
        throughput: Some(count as f64 / 1e6 / seconds.max(1e-9)),
        throughput_unit: "Mpix/s",
        metric: metric.into(),
        error,
        bytes: levels.iter().map(|level| level.len() as u64).sum(),
    };
    texels.report.extend([
        row("relative rms of the storage", lost.relative_rms()),
        row("log2 psnr dB of the storage", lost.log.psnr_db()),
    ]);
    let info = ImageInfo {
        name,
        role: ImageRole::Environment,
        format,
        swizzle: IDENTITY_SWIZZLE,
        width: cube.size,
        height: cube.size,
        layers: 6,
    };
    texels.push(&info, levels.iter().map(Vec::as_slice))
}
