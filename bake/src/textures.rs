//! Decodes and encodes the planned images, and lays all texels out in one section.

use std::sync::atomic::{AtomicUsize, Ordering};

use cairn_format::TextureFormat;
use cairn_format::header::{ALIGNMENT, align_up};
use cairn_format::scene::{Image, ImageRole, Level, Swizzle};

use crate::bounded;
use crate::cache::{self, Inputs, Kind, Session};
use crate::content::{self, Stored};
use crate::diagnostic::{Diagnostic, Result};
use crate::encode::{EncodeOptions, EncodedTexture, Kernels, Role, TextureReport};
use crate::import::decode_image;
use crate::materials::{ImageUse, Plan};
use crate::memory;
use crate::report::Row;
use crate::scene::Scene;

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

/// The plan's images, encoded.
#[derive(Debug)]
pub struct Encoded {
    /// With the plan's image whose name each has.
    pub textures: Vec<(Stored, u32)>,
    /// Index into `textures` of each of the plan's images.
    pub of: Vec<usize>,
}

/// Most texels of an image, and bytes that images may take while they are encoded.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub pixels: u64,
    pub memory: u64,
}

/// Encodes the plan's images, each on all cores that are free; as many are decoded at once as there are threads, or
/// fewer where memory is limited.
///
/// # Errors
/// The first image, in plan order, that cannot be decoded, or that alone takes more memory than there is.
pub fn encode_all(
    scene: &Scene,
    plan: &Plan,
    options: &EncodeOptions,
    limits: Limits,
    session: &Session,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Encoded> {
    let limit_pixels = limits.pixels;
    let jobs = jobs(plan);
    let done = AtomicUsize::new(0);
    let encode = |index: usize| {
        let job = &jobs[index];
        let stored = session.fetch(
            || inputs(scene, plan, job, options, limit_pixels),
            || encode_job(scene, plan, job, options, limit_pixels),
        )?;
        // A job of two gives one texture for both, or one for each.
        let stored: Vec<(Stored, u32)> = match stored.len() {
            1 => stored.into_iter().zip(job.last().copied()).collect(),
            _ => stored.into_iter().zip(job.iter().copied()).collect(),
        };
        let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(finished as f32 / jobs.len() as f32);
        Ok(stored)
    };
    let left = limits.memory;
    let needed = jobs.iter().map(|job| {
        let images = job.iter().map(|&index| plan.images[index as usize].image);
        let needed =
            images.map(|image| memory::of_image(&scene.images[image as usize], left, limit_pixels));
        needed.sum::<Result<u64>>()
    });
    let needed = needed.collect::<Result<Vec<u64>>>()?;
    let mut results: Vec<Result<Vec<(Stored, u32)>>> = Vec::with_capacity(jobs.len());
    for batch in memory::batches(&needed, rayon::current_num_threads(), left) {
        results.extend(bounded::map(batch.len(), |index| {
            encode(batch.start + index)
        }));
    }
    let mut encoded = Encoded {
        textures: Vec::new(),
        of: vec![0; plan.images.len()],
    };
    for (job, stored) in jobs.iter().zip(results) {
        let stored = stored?;
        for (at, &index) in job.iter().enumerate() {
            encoded.of[index as usize] = encoded.textures.len() + at.min(stored.len() - 1);
        }
        encoded.textures.extend(stored);
    }
    Ok(encoded)
}

/// Images that are encoded together, in the order of the first of each.
fn jobs(plan: &Plan) -> Vec<Vec<u32>> {
    let pair = |index: u32| plan.companions.iter().find(|pair| pair.contains(&index));
    let images = 0..plan.images.len() as u32;
    images
        .filter_map(|index| match pair(index) {
            None => Some(vec![index]),
            Some(pair) if pair.iter().min() == Some(&index) => Some(pair.to_vec()),
            Some(_) => None,
        })
        .collect()
}

/// What decides the bytes of a job's textures.
fn inputs(scene: &Scene, plan: &Plan, job: &[u32], options: &EncodeOptions, limit: u64) -> Inputs {
    let machine = (options.kernels == Kernels::Native).then(cache::processor);
    let name = |index: &u32| {
        let wanted = &plan.images[*index as usize];
        let image = &scene.images[wanted.image as usize];
        format!("{} ({:?})", image.name, wanted.role)
    };
    let names: Vec<String> = job.iter().map(name).collect();
    let mut inputs = Inputs::new(Kind::Texture, module_path!(), names.join(" and "))
        .settings("settings", options)
        .settings("processor", &machine)
        // A smaller limit must refuse what a larger one let pass.
        .settings("limit", &limit);
    for (number, &index) in job.iter().enumerate() {
        // Every field by name: a new one does not compile until it is looked at.
        let ImageUse {
            image,
            role,
            channels,
            alpha,
            sampler,
        } = &plan.images[index as usize];
        let label = |what: &str| match number {
            0 => what.to_owned(),
            _ => format!("{what} of the second"),
        };
        inputs = inputs
            .content(&label("image"), &scene.images[*image as usize].bytes)
            .settings(&label("role"), role)
            .settings(&label("channels"), channels)
            .settings(&label("alpha"), alpha)
            .settings(&label("wrap"), &[sampler.wrap_u, sampler.wrap_v]);
    }
    inputs
}

/// The textures of a job: one of each image, or one of both.
fn encode_job(
    scene: &Scene,
    plan: &Plan,
    job: &[u32],
    options: &EncodeOptions,
    limit_pixels: u64,
) -> Result<Vec<Stored>> {
    let wanted = |index: u32| &plan.images[index as usize];
    let decode =
        |index: u32| decode_image(&scene.images[wanted(index).image as usize], limit_pixels);
    if let &[occlusion, roughness] = job {
        let images = [decode(occlusion)?, decode(roughness)?];
        let both = [&images[0], &images[1]];
        return Ok(
            match content::store_companions(both, wanted(roughness), options) {
                Some(both) => vec![both],
                None => images
                    .into_iter()
                    .zip(job)
                    .map(|(image, index)| content::store(image, wanted(*index), options))
                    .collect(),
            },
        );
    }
    job.iter()
        .map(|&index| Ok(content::store(decode(index)?, wanted(index), options)))
        .collect()
}

/// Appends the encoded images; equal ones are stored once. Returns the stored index of each of the plan's.
pub fn store(texels: &mut Texels, scene: &Scene, plan: &Plan, encoded: &Encoded) -> Vec<u32> {
    let mut indices: Vec<u32> = Vec::with_capacity(encoded.textures.len());
    for (at, (stored, first)) in encoded.textures.iter().enumerate() {
        let Stored {
            texture,
            role,
            swizzle,
        } = stored;
        let same = |other: &usize| {
            let have = &encoded.textures[*other].0;
            have.role == *role
                && have.swizzle == *swizzle
                && have.texture.format == texture.format
                && have.texture.levels == texture.levels
        };
        if let Some(twin) = (0..at).find(same) {
            indices.push(indices[twin]);
            continue;
        }
        let image = &scene.images[plan.images[*first as usize].image as usize];
        let name = &image.name;
        let info = ImageInfo {
            name,
            role: match role {
                Role::Color => ImageRole::Color,
                Role::Data | Role::Pair | Role::Single => ImageRole::Data,
                Role::Normal => ImageRole::Normal,
            },
            format: texture.format,
            swizzle: *swizzle,
            width: texture.width,
            height: texture.height,
            layers: 1,
        };
        indices.push(texels.push(&info, texture.levels.iter().map(Vec::as_slice)));
        let bytes = texture.levels.iter().map(|level| level.len() as u64).sum();
        texels.report.extend(rows(name, texture, bytes));
        if let Some(lacks) = texture.report.missed_db {
            let message = format!(
                "image `{name}` as {:?} reaches {:.2} dB, {lacks:.2} less than --texture-quality asks for; \
                 the best preset is stored",
                texture.format, texture.report.psnr_db
            );
            let warning = Diagnostic::warning("texture-quality-missed", &image.origin, message);
            texels.diagnostics.push(warning);
        }
    }
    encoded.of.iter().map(|&texture| indices[texture]).collect()
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
    let mut altered = report.altered_levels.clone();
    altered.sort_unstable();
    for levels in altered.chunk_by(|one, other| one == other) {
        let metric = format!("levels encoded again: {}", levels[0].reason());
        rows.push(row(metric, levels.len() as f64));
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
    use cairn_format::scene::IDENTITY_SWIZZLE;

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
