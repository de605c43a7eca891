//! Decodes and encodes the planned images, and lays all texels out in one section.

mod rows;

use std::sync::atomic::{AtomicUsize, Ordering};

use cairn_format::TextureFormat;
use cairn_format::header::{ALIGNMENT, align_up};
use cairn_format::scene::{Image, ImageRole, Level, Swizzle};

use crate::bounded;
use crate::cache::{self, Inputs, Kind, Session};
use crate::content::{self, Stored};
use crate::diagnostic::{Diagnostic, Result};
use crate::encode::toksvig::WideningReport;
use crate::encode::{EncodeOptions, Kernels, Role};
use crate::import::{DecodedImage, decode_image};
use crate::materials::{ImageUse, Plan, Widening};
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
        let images = job.iter().flat_map(|&index| {
            let wanted = &plan.images[index as usize];
            [
                Some(wanted.image),
                wanted.widening.map(|widening| widening.normal),
            ]
        });
        let needed = images
            .flatten()
            .map(|image| memory::of_image(&scene.images[image as usize], left, limit_pixels));
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
        format!("{} ({:?})", wanted.name(scene), wanted.role)
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
            widening,
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
        if let Some(widening) = widening {
            let Widening {
                normal,
                normal_wrap,
                normal_scale,
                factor,
                textured,
            } = widening;
            inputs = inputs
                .content(&label("normals"), &scene.images[*normal as usize].bytes)
                .settings(&label("wrap of the normals"), normal_wrap)
                .settings(
                    &label("widening"),
                    &(normal_scale.to_bits(), factor.to_bits(), textured),
                );
        }
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
    let read = |index: u32| read(scene, wanted(index), options, limit_pixels);
    if let &[occlusion, roughness] = job {
        let (mut image, (other, widening)) = (read(occlusion)?.0, read(roughness)?);
        if widening.is_some() {
            content::fill_levels(&mut image, wanted(occlusion), options);
        }
        let both = [&image, &other];
        return Ok(
            match content::store_companions(both, wanted(roughness), options) {
                Some(both) => vec![with(both, widening)],
                None => vec![
                    content::store(image, wanted(occlusion), options),
                    with(content::store(other, wanted(roughness), options), widening),
                ],
            },
        );
    }
    job.iter()
        .map(|&index| {
            let (image, widening) = read(index)?;
            Ok(with(
                content::store(image, wanted(index), options),
                widening,
            ))
        })
        .collect()
}

fn with(mut stored: Stored, widening: Option<WideningReport>) -> Stored {
    stored.texture.report.widening = widening;
    stored
}

/// An image as materials read it, its roughness widened where that is asked for.
fn read(
    scene: &Scene,
    wanted: &ImageUse,
    options: &EncodeOptions,
    limit_pixels: u64,
) -> Result<(DecodedImage, Option<WideningReport>)> {
    let decode = |image: u32| decode_image(&scene.images[image as usize], limit_pixels);
    let Some(widening) = wanted.widening else {
        return Ok((decode(wanted.image)?, None));
    };
    let normals = decode(widening.normal)?;
    let data = match widening.textured {
        true => Some(decode(wanted.image)?),
        false => None,
    };
    let (image, report) = content::widen(normals, data.as_ref(), wanted, &widening, options);
    Ok((image, Some(report)))
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
        let wanted = &plan.images[*first as usize];
        let image = &scene.images[wanted.image as usize];
        let name = &wanted.name(scene);
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
        texels.report.extend(rows::of(name, texture, bytes));
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
    let unpaired = plan.unpaired.iter().map(|&index| {
        let name = &scene.materials[index as usize].name;
        let message = format!(
            "material `{name}` reads normals and roughness at different coordinates; --toksvig leaves its roughness alone"
        );
        let origin = scene.origin(format!("/materials/{index}"));
        Diagnostic::warning("toksvig-unpaired", &origin, message)
    });
    texels.diagnostics.extend(unpaired);
    encoded.of.iter().map(|&texture| indices[texture]).collect()
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
