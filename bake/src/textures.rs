//! Decodes and encodes the planned images, and lays all texels out in one section.

use std::sync::atomic::{AtomicUsize, Ordering};

use cairn_format::TextureFormat;
use cairn_format::header::{ALIGNMENT, align_up};
use cairn_format::scene::{IDENTITY_SWIZZLE, Image, ImageRole, Level, Swizzle};

use crate::bounded;
use crate::cache::{self, Inputs, Kind, Session};
use crate::diagnostic::{Diagnostic, Result};
use crate::encode::{
    AlphaUse, EncodeOptions, EncodedTexture, Kernels, Role, Source, TextureReport, encode,
    is_opaque,
};
use crate::import::decode_image;
use crate::materials::{ImageUse, Plan};
use crate::report::Row;
use crate::scene::{Image as SourceImage, Scene};

/// The texel section in the making.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Debug, Default)]
pub struct Texels {
    pub images: Vec<Image>,
    pub bytes: Vec<u8>,
    pub report: Vec<Row>,
    pub diagnostics: Vec<Diagnostic>,
}

/// What an image is, apart from its levels.
pub struct ImageInfo<'a> {
    pub name: &'a str,
    pub role: ImageRole,
    pub format: TextureFormat,
    pub swizzle: [Swizzle; 4],
    pub width: u32,
    pub height: u32,
    pub layers: u32,
}

impl Texels {
    /// Appends an image with its levels, largest first; returns its index.
    pub fn push<'a>(&mut self, info: &ImageInfo, levels: impl Iterator<Item = &'a [u8]>) -> u32 {
        let levels = levels
            .map(|level| {
                self.bytes
                    .resize(align_up(self.bytes.len() as u64, ALIGNMENT) as usize, 0);
                let offset = self.bytes.len() as u64;
                self.bytes.extend_from_slice(level);
                Level {
                    offset,
                    length: level.len() as u64,
                }
            })
            .collect();
        self.images.push(Image {
            name: info.name.to_owned(),
            role: info.role,
            format: info.format,
            swizzle: info.swizzle,
            width: info.width,
            height: info.height,
            layers: info.layers,
            levels,
        });
        self.images.len() as u32 - 1
    }

    /// Appends all images of `other`; returns the index of its first.
    pub fn append(&mut self, other: Self) -> u32 {
        let first = self.images.len() as u32;
        self.bytes
            .resize(align_up(self.bytes.len() as u64, ALIGNMENT) as usize, 0);
        let start = self.bytes.len() as u64;
        self.bytes.extend_from_slice(&other.bytes);
        self.images
            .extend(other.images.into_iter().map(|mut image| {
                for level in &mut image.levels {
                    level.offset += start;
                }
                image
            }));
        self.report.extend(other.report);
        self.diagnostics.extend(other.diagnostics);
        first
    }
}

/// Encodes the plan's images, each on all cores that are free; as many are decoded at once as there are threads.
///
/// # Errors
/// The first image, in plan order, that cannot be decoded.
pub fn encode_all(
    scene: &Scene,
    plan: &Plan,
    options: &EncodeOptions,
    limit_pixels: u64,
    session: &Session,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Vec<EncodedTexture>> {
    let done = AtomicUsize::new(0);
    let encoded = bounded::map(plan.images.len(), |index| {
        let wanted = &plan.images[index];
        let image = &scene.images[wanted.image as usize];
        let texture = session.fetch(
            || inputs(image, wanted, options, limit_pixels),
            || encode_one(image, wanted, options, limit_pixels),
        )?;
        let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(finished as f32 / plan.images.len() as f32);
        Ok(texture)
    });
    encoded.into_iter().collect()
}

/// What decides the bytes of a texture.
fn inputs(image: &SourceImage, wanted: &ImageUse, options: &EncodeOptions, limit: u64) -> Inputs {
    // Every field by name: a new one does not compile until it is looked at.
    let ImageUse {
        image: _,
        role,
        alpha,
        sampler,
    } = wanted;
    let name = format!("{} ({role:?})", image.name);
    let machine = (options.kernels == Kernels::Native).then(cache::processor);
    Inputs::new(Kind::Texture, module_path!(), name)
        .content("image", &image.bytes)
        .settings("role", role)
        .settings("alpha", alpha)
        .settings("wrap", &[sampler.wrap_u, sampler.wrap_v])
        .settings("settings", options)
        .settings("processor", &machine)
        // A smaller limit must refuse what a larger one let pass.
        .settings("limit", &limit)
}

fn encode_one(
    image: &SourceImage,
    wanted: &ImageUse,
    options: &EncodeOptions,
    limit_pixels: u64,
) -> Result<EncodedTexture> {
    let image = decode_image(image, limit_pixels)?;
    let alpha = if wanted.alpha != AlphaUse::Ignore && is_opaque(&image.texels) {
        AlphaUse::Opaque
    } else {
        wanted.alpha
    };
    let source = Source {
        width: image.width,
        height: image.height,
        texels: &image.texels,
        wrap_u: wanted.sampler.wrap_u,
        wrap_v: wanted.sampler.wrap_v,
        alpha,
    };
    Ok(encode(&source, wanted.role, options))
}

/// Appends the encoded images; equal ones are stored once. Returns the stored index of each.
pub fn store(
    texels: &mut Texels,
    scene: &Scene,
    plan: &Plan,
    encoded: &[EncodedTexture],
) -> Vec<u32> {
    let mut stored: Vec<u32> = Vec::with_capacity(encoded.len());
    for (index, (texture, wanted)) in encoded.iter().zip(&plan.images).enumerate() {
        let same = |other: &usize| {
            let (have, use_) = (&encoded[*other], &plan.images[*other]);
            use_.role == wanted.role
                && have.format == texture.format
                && have.levels == texture.levels
        };
        if let Some(twin) = (0..index).find(same) {
            stored.push(stored[twin]);
            continue;
        }
        let name = &scene.images[wanted.image as usize].name;
        let info = ImageInfo {
            name,
            role: match wanted.role {
                Role::Color => ImageRole::Color,
                Role::Data => ImageRole::Data,
                Role::Normal => ImageRole::Normal,
            },
            format: texture.format,
            swizzle: IDENTITY_SWIZZLE,
            width: texture.width,
            height: texture.height,
            layers: 1,
        };
        stored.push(texels.push(&info, texture.levels.iter().map(Vec::as_slice)));
        let bytes = texture.levels.iter().map(|level| level.len() as u64).sum();
        texels.report.extend(rows(name, texture, bytes));
        if let Some(lacks) = texture.report.missed_db {
            let message = format!(
                "image `{name}` as {:?} reaches {:.2} dB, {lacks:.2} less than --texture-quality asks for; \
                 the best preset is stored",
                texture.format, texture.report.psnr_db
            );
            let origin = &scene.images[wanted.image as usize].origin;
            let warning = Diagnostic::warning("texture-quality-missed", origin, message);
            texels.diagnostics.push(warning);
        }
    }
    stored
}

/// The rows of one image in the speed-against-error report.
fn rows(name: &str, texture: &EncodedTexture, bytes: u64) -> Vec<Row> {
    let report: &TextureReport = &texture.report;
    let setting = format!("{:?} {}", texture.format, report.codec.setting());
    let row = |metric: String, error| Row {
        stage: "texture".into(),
        item: name.to_owned(),
        setting: setting.trim_end().into(),
        seconds: report.seconds,
        throughput: Some(report.megapixels_per_second),
        throughput_unit: "Mpix/s",
        metric,
        error,
        bytes,
    };
    // A lossless image has no finite PSNR; 999 stands for it, since JSON has no infinity.
    let finite = |psnr: f64| if psnr.is_finite() { psnr } else { 999.0 };
    let mut rows = vec![
        row("psnr dB".into(), finite(report.psnr_db)),
        row("p99 block rmse /255".into(), report.p99_block_rmse),
    ];
    if let Some(psnr) = report.psnr_linear_light_db {
        rows.push(row("psnr dB, linear light".into(), finite(psnr)));
    }
    if let Some(angle) = &report.normal_angle_deg {
        rows.push(row("normal p50 degrees".into(), angle.p50));
        rows.push(row("normal p99 degrees".into(), angle.p99));
        rows.push(row("normal max degrees".into(), angle.max));
    }
    if let Some(lacks) = report.missed_db {
        rows.push(row("psnr dB less the target".into(), -lacks));
    }
    let levels = report.alpha_coverage_delta.len();
    for (level, delta) in report.alpha_coverage_delta.iter().enumerate() {
        // The last level has one texel, which covers all or nothing.
        let bound = if level + 1 == levels {
            ", one texel"
        } else {
            ""
        };
        rows.push(row(
            format!("alpha coverage delta, mip {level}{bound}"),
            *delta,
        ));
    }
    let coverage = report
        .alpha_coverage_delta
        .iter()
        .take(levels.saturating_sub(1));
    if let Some(worst) = coverage.map(|delta| delta.abs()).max_by(f64::total_cmp) {
        rows.push(row("alpha coverage delta, worst mip".into(), worst));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_begin_at_multiples_of_sixteen() {
        let mut texels = Texels::default();
        let info = ImageInfo {
            name: "a",
            role: ImageRole::Data,
            format: TextureFormat::Rgba8Unorm,
            swizzle: IDENTITY_SWIZZLE,
            width: 3,
            height: 1,
            layers: 1,
        };
        let levels: [&[u8]; 2] = [&[1; 12], &[2; 4]];
        assert_eq!(texels.push(&info, levels.into_iter()), 0);
        assert_eq!(texels.push(&info, levels.into_iter()), 1);
        let offsets: Vec<u64> = texels
            .images
            .iter()
            .flat_map(|image| image.levels.iter().map(|level| level.offset))
            .collect();
        assert_eq!(offsets, [0, 16, 32, 48]);
        assert_eq!(texels.bytes[12..16], [0; 4]);

        let mut other = Texels::default();
        other.push(&info, levels.into_iter());
        assert_eq!(texels.append(other), 2);
        assert_eq!(texels.push(&info, levels.into_iter()), 3);
        let image = |index: usize| {
            let levels = texels.images[index].levels.iter();
            levels
                .map(|level| {
                    texels.bytes[level.offset as usize..][..level.length as usize].to_vec()
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(image(2), levels);
        assert_eq!(image(3), levels);
    }
}
