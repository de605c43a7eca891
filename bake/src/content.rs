//! How an image is stored, by what its texels hold of what materials read: data in as few channels as vary, constant
//! images as one texel, occlusion beside roughness where both fit.

use cairn_format::scene::{IDENTITY_SWIZZLE, Swizzle};

use crate::constants::constant;
use crate::encode::toksvig::{self, WideningReport};
use crate::encode::{
    AlphaUse, Altered, Codec, EncodeOptions, EncodedTexture, Role, Source, Target, Universal,
    data_levels, encode_levels, is_opaque,
};
use crate::import::DecodedImage;
use crate::materials::{ImageUse, Widening};

/// An encoded image, and what shaders read of it.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Debug, PartialEq)]
pub struct Stored {
    pub texture: EncodedTexture,
    pub role: Role,
    pub swizzle: [Swizzle; 4],
}

/// What to encode, and how it is read.
struct Plan {
    image: DecodedImage,
    role: Role,
    alpha: AlphaUse,
    swizzle: [Swizzle; 4],
    /// Why the blocks of the file are not stored, where they could have been.
    altered: Option<Altered>,
}

/// Encodes an image as `wanted` asks for.
pub fn store(mut image: DecodedImage, wanted: &ImageUse, options: &EncodeOptions) -> Stored {
    let held = held(&image, wanted.channels);
    let mut altered = None;
    if held.iter().all(|channel| *channel != Held::Varies) {
        image.width = 1;
        image.height = 1;
        image.texels.truncate(1);
        image.smaller.clear();
        altered = image.universal.take().map(|_| Altered::Constant);
    }
    match wanted.role {
        Role::Normal if image.pair => image.rebuild_normals(),
        // Of blocks of a pair, shaders would read grey.
        Role::Color if image.pair => image.universal = None,
        _ => {}
    }
    let alpha = if wanted.alpha != AlphaUse::Ignore && is_opaque(&image.texels) {
        AlphaUse::Opaque
    } else {
        wanted.alpha
    };
    let plan = match wanted.role {
        Role::Data => Plan {
            altered,
            ..data(image, held, alpha, options)
        },
        role => Plan {
            image,
            role,
            alpha,
            swizzle: if role == Role::Normal {
                swizzle(role, [Some(0), Some(1), None, None], options)
            } else {
                IDENTITY_SWIZZLE
            },
            altered,
        },
    };
    finish(&plan, wanted, options)
}

/// Encodes occlusion and the one channel of metallic-roughness that varies as one image of two channels: each keeps
/// the blocks that it would have alone. `None` where sizes differ or more varies; what shaders then read of both is
/// the first's occlusion and the second's roughness and metallic.
pub fn store_companions(
    [occlusion, roughness]: [&DecodedImage; 2],
    wanted: &ImageUse,
    options: &EncodeOptions,
) -> Option<Stored> {
    let alike = (occlusion.width, occlusion.height) == (roughness.width, roughness.height)
        && occlusion.smaller.len() == roughness.smaller.len();
    let held = held(roughness, wanted.channels);
    let varying: Vec<usize> = (0..4).filter(|&c| held[c] == Held::Varies).collect();
    let &[channel] = varying.as_slice() else {
        return None;
    };
    if !alike || held[1..3].contains(&Held::Value) || constants(occlusion)[0].is_some() {
        return None;
    }
    let pair = |first: &[[u16; 4]], second: &[[u16; 4]]| {
        let texels = first.iter().zip(second);
        texels
            .map(|(first, second)| [first[0], second[channel], 0, u16::MAX])
            .collect()
    };
    let smaller = occlusion.smaller.iter().zip(&roughness.smaller);
    let image = DecodedImage {
        texels: pair(&occlusion.texels, &roughness.texels),
        smaller: smaller.map(|(first, second)| pair(first, second)).collect(),
        pair: true,
        universal: None,
        ..*occlusion
    };
    let altered = [occlusion, roughness]
        .iter()
        .any(|image| image.universal.is_some());
    let mut read = [Some(0), None, None, None];
    read[channel] = Some(1);
    let mut swizzle = swizzle(Role::Pair, read, options);
    for (swizzle, held) in swizzle[1..3].iter_mut().zip(&held[1..3]) {
        *swizzle = held.constant().unwrap_or(*swizzle);
    }
    let plan = Plan {
        image,
        role: Role::Pair,
        alpha: AlphaUse::Ignore,
        swizzle,
        altered: altered.then_some(Altered::Packed),
    };
    Some(finish(&plan, wanted, options))
}

/// What one channel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Held {
    /// Nothing that a material reads.
    Unread,
    Zero,
    One,
    /// One value between these.
    Value,
    Varies,
}

impl Held {
    fn constant(self) -> Option<Swizzle> {
        match self {
            Self::Zero => Some(Swizzle::Zero),
            Self::One => Some(Swizzle::One),
            _ => None,
        }
    }
}

/// The value of each channel that has only one, in all levels.
fn constants(image: &DecodedImage) -> [Option<u16>; 4] {
    let levels = image.smaller.iter().map(|level| constant(level));
    levels.fold(constant(&image.texels), |all, level| {
        std::array::from_fn(|channel| all[channel].filter(|_| all[channel] == level[channel]))
    })
}

fn held(image: &DecodedImage, channels: u8) -> [Held; 4] {
    let constant = constants(image);
    std::array::from_fn(|channel| match constant[channel] {
        _ if channels >> channel & 1 == 0 => Held::Unread,
        Some(0) => Held::Zero,
        Some(u16::MAX) => Held::One,
        Some(_) => Held::Value,
        None => Held::Varies,
    })
}

/// Data in as few channels as hold more than 0 or 1.
fn data(
    mut image: DecodedImage,
    held: [Held; 4],
    alpha: AlphaUse,
    options: &EncodeOptions,
) -> Plan {
    let stored: Vec<usize> = (0..4)
        .filter(|&channel| matches!(held[channel], Held::Value | Held::Varies))
        .collect();
    if options.target == Target::Portable && image.universal.is_some() {
        return as_it_is(image, held, alpha, options);
    }
    let role = match stored.len() {
        0 | 1 => Role::Single,
        2 => Role::Pair,
        _ => {
            return Plan {
                image,
                role: Role::Data,
                alpha,
                swizzle: IDENTITY_SWIZZLE,
                altered: None,
            };
        }
    };
    let moved = |texels: &mut Vec<[u16; 4]>| {
        for texel in texels {
            let channel = |at: usize| stored.get(at).map_or(0, |&channel| texel[channel]);
            *texel = [channel(0), channel(1), 0, u16::MAX];
        }
    };
    image.universal = None;
    moved(&mut image.texels);
    image.smaller.iter_mut().for_each(moved);
    let place = |channel| stored.iter().position(|&stored| stored == channel);
    let mut swizzle = swizzle(role, std::array::from_fn(place), options);
    for (swizzle, held) in swizzle.iter_mut().zip(&held) {
        *swizzle = held.constant().unwrap_or(*swizzle);
    }
    Plan {
        image,
        role,
        alpha: AlphaUse::Ignore,
        swizzle,
        altered: None,
    }
}

/// Data in the channels that the blocks of the file have.
fn as_it_is(
    image: DecodedImage,
    held: [Held; 4],
    alpha: AlphaUse,
    options: &EncodeOptions,
) -> Plan {
    let (role, mut read) = match image.pair {
        true => (
            Role::Pair,
            swizzle(Role::Pair, [Some(0), Some(1), None, None], options),
        ),
        false => (Role::Data, IDENTITY_SWIZZLE),
    };
    for (read, held) in read.iter_mut().zip(&held) {
        *read = held.constant().unwrap_or(*read);
    }
    Plan {
        image,
        role,
        alpha,
        swizzle: read,
        altered: None,
    }
}

/// What shaders read as each component: the stored value of a place, or 0, or 1 as alpha.
fn swizzle(role: Role, places: [Option<usize>; 4], options: &EncodeOptions) -> [Swizzle; 4] {
    let channels = role.pair_channels(options.target);
    std::array::from_fn(|component| match places[component] {
        Some(place) => IDENTITY_SWIZZLE[channels[place]],
        None if component == 3 => Swizzle::One,
        None => Swizzle::Zero,
    })
}

/// The data that a material reads with its roughness widened by `normals`, all levels.
pub fn widen(
    mut normals: DecodedImage,
    data: Option<&DecodedImage>,
    wanted: &ImageUse,
    widening: &Widening,
    options: &EncodeOptions,
) -> (DecodedImage, WideningReport) {
    if normals.pair {
        normals.rebuild_normals();
    }
    let [wrap_u, wrap_v] = widening.normal_wrap;
    let surface = toksvig::Surface {
        normals: Source {
            wrap_u,
            wrap_v,
            ..source(&normals, wanted, AlphaUse::Ignore)
        },
        normal_scale: widening.normal_scale,
        data: data.map(|data| source(data, wanted, AlphaUse::Ignore)),
        data_levels: data.map_or(&[], |data| &data.smaller),
        factor: widening.factor,
    };
    let widened = toksvig::widen(&surface, options.filter);
    let mut levels = widened.levels.into_iter();
    let image = DecodedImage {
        width: widened.width,
        height: widened.height,
        texels: levels.next().unwrap_or_default(),
        smaller: levels.collect(),
        source_bits: 16,
        has_alpha: false,
        pair: false,
        universal: None,
    };
    (image, widened.report)
}

/// Gives data that has one level alone all of them, so that it can go with data that has.
pub fn fill_levels(image: &mut DecodedImage, wanted: &ImageUse, options: &EncodeOptions) {
    if image.smaller.is_empty() {
        image.smaller = data_levels(&source(image, wanted, AlphaUse::Ignore), options.filter);
    }
}

fn source<'a>(image: &'a DecodedImage, wanted: &ImageUse, alpha: AlphaUse) -> Source<'a> {
    Source {
        width: image.width,
        height: image.height,
        texels: &image.texels,
        wrap_u: wanted.sampler.wrap_u,
        wrap_v: wanted.sampler.wrap_v,
        alpha,
    }
}

fn finish(plan: &Plan, wanted: &ImageUse, options: &EncodeOptions) -> Stored {
    let source = source(&plan.image, wanted, plan.alpha);
    let universal = plan.image.universal.as_ref().map(|universal| Universal {
        levels: &universal.levels,
        pair: plan.image.pair,
    });
    let mut texture = encode_levels(&source, &plan.image.smaller, universal, plan.role, options);
    texture.report.altered_levels.extend(plan.altered);
    let mut swizzle = plan.swizzle;
    if plan.role == Role::Normal && texture.report.codec == Codec::Passed && !plan.image.pair {
        swizzle[1] = Swizzle::Green;
    }
    Stored {
        texture,
        role: plan.role,
        swizzle,
    }
}

#[cfg(test)]
mod universal_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Target;
    use crate::scene::{Sampler, Wrap};
    use cairn_format::TextureFormat;

    use Swizzle::{Alpha, Blue, Green, One, Red, Zero};

    fn image(texel: impl Fn(u16) -> [u16; 4]) -> DecodedImage {
        DecodedImage {
            width: 8,
            height: 4,
            texels: (0..32).map(|index| texel(index * 2000)).collect(),
            smaller: Vec::new(),
            source_bits: 16,
            has_alpha: false,
            pair: false,
            universal: None,
        }
    }

    fn wanted(role: Role, channels: u8) -> ImageUse {
        ImageUse {
            image: 0,
            role,
            channels,
            alpha: AlphaUse::Ignore,
            sampler: Sampler::default(),
            widening: None,
        }
    }

    fn options(target: Target) -> EncodeOptions {
        EncodeOptions {
            target,
            ..EncodeOptions::default()
        }
    }

    #[test]
    fn data_takes_the_channels_that_vary() {
        let top = u16::MAX;
        let desktop = options(Target::Desktop);
        let stored = |texel: fn(u16) -> [u16; 4], channels| {
            let stored = store(image(texel), &wanted(Role::Data, channels), &desktop);
            (stored.texture.format, stored.swizzle)
        };
        let bc4 = TextureFormat::Bc4Unorm;
        let bc5 = TextureFormat::Bc5Unorm;
        // Roughness alone, metallic nowhere or everywhere.
        assert_eq!(
            stored(|v| [0, v, 0, u16::MAX], 6),
            (bc4, [Zero, Red, Zero, One])
        );
        assert_eq!(
            stored(|v| [7, v, u16::MAX, u16::MAX], 6),
            (bc4, [Zero, Red, One, One])
        );
        assert_eq!(
            stored(|v| [v, v, v / 2, u16::MAX], 6),
            (bc5, [Zero, Red, Green, One])
        );
        assert_eq!(
            stored(|v| [v, v, 300, u16::MAX], 6),
            (bc5, [Zero, Red, Green, One])
        );
        assert_eq!(stored(|v| [9, 9, 9, v], 8), (bc4, [Zero, Zero, Zero, Red]));
        let all = stored(|v| [v, v / 2, v / 3, u16::MAX], 7);
        assert_eq!(all, (TextureFormat::Bc7Unorm, [Red, Green, Blue, Alpha]));
        let portable = store(
            image(|v| [v, top - v, v / 2, top]),
            &wanted(Role::Data, 6),
            &options(Target::Portable),
        );
        assert_eq!(portable.texture.format, TextureFormat::UastcUnorm);
        assert_eq!(portable.swizzle, [Zero, Red, Alpha, One]);
    }

    #[test]
    fn what_is_read_as_one_value_is_one_texel() {
        let desktop = options(Target::Desktop);
        let flat = store(image(|v| [v, 300, 0, v]), &wanted(Role::Data, 6), &desktop);
        assert_eq!((flat.texture.width, flat.texture.levels.len()), (1, 1));
        assert_eq!(flat.swizzle, [Zero, Red, Zero, One]);
        let color = store(image(|v| [9, 9, 9, v]), &wanted(Role::Color, 7), &desktop);
        assert_eq!((color.texture.width, color.texture.height), (1, 1));
    }

    #[test]
    fn normals_of_universal_blocks_are_read_from_red_and_alpha() {
        let waves = |v| [v, u16::MAX - v, 60_000, u16::MAX];
        for (target, expected) in [
            (Target::Desktop, [Red, Green, Zero, One]),
            (Target::Portable, [Red, Alpha, Zero, One]),
        ] {
            let stored = store(image(waves), &wanted(Role::Normal, 7), &options(target));
            assert_eq!(stored.swizzle, expected);
            assert!(stored.texture.report.psnr_db > 30.0, "{target:?}");
        }
    }

    /// Both halves of the pair are the blocks that each image has alone.
    #[test]
    fn companions_share_an_image_without_loss() {
        let desktop = options(Target::Desktop);
        let occlusion = image(|v| [v / 2, 1, 2, u16::MAX]);
        let roughness = image(|v| [3, u16::MAX - v, 0, u16::MAX]);
        let both = [&occlusion, &roughness];
        let pair = store_companions(both, &wanted(Role::Data, 6), &desktop).expect("a pair");
        assert_eq!(pair.swizzle, [Red, Green, Zero, One]);
        let alone = [
            store(occlusion.clone(), &wanted(Role::Data, 1), &desktop),
            store(roughness.clone(), &wanted(Role::Data, 6), &desktop),
        ];
        for (level, pair) in pair.texture.levels.iter().enumerate() {
            for (at, block) in pair.chunks(16).enumerate() {
                let [first, second] =
                    [0, 1].map(|image| &alone[image].texture.levels[level][at * 8..][..8]);
                assert_eq!(block, [first, second].concat());
            }
        }
        let metal = image(|v| [3, v, v / 2, u16::MAX]);
        assert_eq!(
            store_companions([&occlusion, &metal], &wanted(Role::Data, 6), &desktop),
            None
        );
        let mut larger = occlusion.clone();
        (larger.width, larger.height) = (4, 8);
        assert_eq!(
            store_companions([&larger, &roughness], &wanted(Role::Data, 6), &desktop),
            None
        );
    }

    /// Normals of two channels widen as those of three do.
    #[test]
    fn normals_of_a_pair_widen_as_whole_ones_do() {
        let whole = image(|v| {
            let x = f32::from(v) / 65535.0 - 0.5;
            let code = |value: f32| ((0.5 * value + 0.5) * 65535.0) as u16;
            [code(x), code(0.0), code((1.0 - x * x).sqrt()), u16::MAX]
        });
        let mut pair = whole.clone();
        pair.pair = true;
        for texel in &mut pair.texels {
            texel[2] = 0;
        }
        let widening = Widening {
            normal: 0,
            normal_wrap: [Wrap::Repeat; 2],
            normal_scale: 1.0,
            factor: 0.2,
            textured: false,
        };
        let [whole, pair] = [whole, pair].map(|normals| {
            let options = EncodeOptions::default();
            widen(normals, None, &wanted(Role::Data, 6), &widening, &options).0
        });
        let last = |image: &DecodedImage| image.smaller.last().expect("levels")[0][1];
        assert!(last(&whole) > 20_000 && last(&whole).abs_diff(last(&pair)) < 10);
    }
}
