//! UASTC sources: which levels are stored bit for bit, and why others are not.

use basisu::uastc::unpack::unpack_uastc;
use cairn_format::texture::mip_extent;

use super::*;
use crate::import::Universal;
use crate::scene::Sampler;

const SIZE: [u32; 2] = [20, 12];
const TOP: u16 = u16::MAX;

fn image(texel: impl Fn(f32, f32) -> [f32; 4]) -> DecodedImage {
    let texels = (0..SIZE[0] * SIZE[1]).map(|index| {
        let place = |at: u32, extent: u32| at as f32 / (extent - 1) as f32;
        let color = texel(
            place(index % SIZE[0], SIZE[0]),
            place(index / SIZE[0], SIZE[1]),
        );
        color.map(|value| (value * f32::from(TOP)) as u16)
    });
    DecodedImage {
        width: SIZE[0],
        height: SIZE[1],
        texels: texels.collect(),
        smaller: Vec::new(),
        source_bits: 16,
        has_alpha: true,
        pair: false,
        universal: None,
    }
}

fn wanted(role: Role, channels: u8, alpha: AlphaUse) -> ImageUse {
    ImageUse {
        image: 0,
        role,
        channels,
        alpha,
        sampler: Sampler::default(),
        widening: None,
    }
}

fn portable() -> EncodeOptions {
    EncodeOptions {
        target: Target::Portable,
        ..EncodeOptions::default()
    }
}

fn unpacked(blocks: &[u8], level: u32, srgb: bool) -> Vec<[u16; 4]> {
    let [width, height] = SIZE.map(|size| mip_extent(size, level) as usize);
    let texel = |index: usize| {
        let (x, y) = (index % width, index / width);
        let block = y / 4 * width.div_ceil(4) + x / 4;
        let texels = unpack_uastc(&blocks.as_chunks::<16>().0[block], srgb).expect("UASTC");
        texels[y % 4 * 4 + x % 4]
            .c
            .map(|code| u16::from(code) * 257)
    };
    (0..width * height).map(texel).collect()
}

/// A source that a file with the blocks of `first` would give.
fn source(first: &Stored, pair: bool) -> DecodedImage {
    let srgb = first.texture.format.is_srgb();
    let levels = (0..).zip(&first.texture.levels);
    let mut levels = levels.map(|(level, blocks)| {
        let texels = unpacked(blocks, level, srgb).into_iter();
        let place = |[x, y, z, w]: [u16; 4]| match pair {
            true => [x, w, 0, TOP],
            false => [x, y, z, w],
        };
        texels.map(place).collect()
    });
    DecodedImage {
        width: SIZE[0],
        height: SIZE[1],
        texels: levels.next().expect("a level"),
        smaller: levels.collect(),
        source_bits: 8,
        has_alpha: !pair,
        pair,
        universal: Some(Universal {
            levels: first.texture.levels.clone(),
        }),
    }
}

fn color(x: f32, y: f32) -> [f32; 4] {
    [x, y, 0.3 + 0.5 * x * y, 1.0 - 0.4 * x]
}

fn color_source() -> DecodedImage {
    let wanted = wanted(Role::Color, 15, AlphaUse::Value);
    source(&store(image(color), &wanted, &portable()), false)
}

fn blocks(image: &DecodedImage) -> Vec<Vec<u8>> {
    image.universal.as_ref().expect("blocks").levels.clone()
}

#[test]
fn levels_are_stored_bit_for_bit() {
    let image = color_source();
    let expected = blocks(&image);
    for alpha in [AlphaUse::Ignore, AlphaUse::Value, AlphaUse::Blend] {
        let stored = store(image.clone(), &wanted(Role::Color, 15, alpha), &portable());
        assert_eq!(stored.texture.levels, expected);
        let report = &stored.texture.report;
        assert_eq!(report.codec, Codec::Passed);
        assert_eq!(
            (report.psnr_db, report.p99_block_rmse),
            (f64::INFINITY, 0.0)
        );
        assert_eq!(report.altered_levels, []);
    }
}

#[test]
fn levels_that_a_file_lacks_are_made() {
    let mut image = color_source();
    let expected = blocks(&image);
    image.smaller.truncate(1);
    image.universal.as_mut().unwrap().levels.truncate(2);
    let stored = store(
        image,
        &wanted(Role::Color, 15, AlphaUse::Value),
        &portable(),
    );
    assert_eq!(stored.texture.levels.len(), 5);
    assert_eq!(stored.texture.levels[..2], expected[..2]);
    let made = &stored.texture.report.level_psnr_db[2..];
    assert!(made.iter().all(|db| (25.0..200.0).contains(db)), "{made:?}");
}

#[test]
fn masks_keep_their_coverage() {
    let image = color_source();
    let expected = blocks(&image);
    let mask = wanted(Role::Color, 15, AlphaUse::Mask { cutoff: 0.8 });
    let stored = store(image.clone(), &mask, &portable());
    assert_eq!(stored.texture.levels[0], expected[0]);
    let report = &stored.texture.report;
    // A mean of alpha covers half as ramps do, until a level has too few texels for it.
    assert!(!report.altered_levels.is_empty());
    assert!(
        report
            .altered_levels
            .iter()
            .all(|level| *level == Altered::Coverage)
    );
    let kept = (0..5).filter(|&level| stored.texture.levels[level] == expected[level]);
    assert_eq!(kept.count() + report.altered_levels.len(), 5);
    let deltas = &report.alpha_coverage_delta[..4];
    assert!(deltas.iter().all(|delta| delta.abs() <= 0.01), "{deltas:?}");
    let plain = EncodeOptions {
        plain_alpha: true,
        ..portable()
    };
    assert_eq!(store(image, &mask, &plain).texture.levels, expected);
}

#[test]
fn colour_that_bleeds_is_encoded_again() {
    let hollow = |x: f32, y: f32| [x, y, 0.5, if x < 0.5 { 0.0 } else { 1.0 }];
    let first = store(
        image(hollow),
        &wanted(Role::Color, 15, AlphaUse::Value),
        &portable(),
    );
    let image = source(&first, false);
    let stored = store(
        image.clone(),
        &wanted(Role::Color, 15, AlphaUse::Blend),
        &portable(),
    );
    assert_eq!(stored.texture.report.altered_levels, [Altered::Bled]);
    assert_ne!(stored.texture.levels[0], blocks(&image)[0]);
    assert_eq!(stored.texture.levels[1..], blocks(&image)[1..]);
}

/// A low bump, whose averaged normals are hardly shorter; its normals as long as `length`.
fn normals(length: f32) -> impl Fn(f32, f32) -> [f32; 4] {
    move |x, y| {
        let normal = glam::Vec3::new(x - 0.5, 0.5 - y, 3.0).normalize() * length;
        let [x, y, z] = (normal * 0.5 + 0.5).to_array();
        [x, y, z, 1.0]
    }
}

#[test]
fn normals_pass_as_colour_where_they_are_of_unit_length() {
    let role = |role| wanted(role, 7, AlphaUse::Ignore);
    let file = |length| {
        let data = store(image(normals(length)), &role(Role::Data), &portable());
        source(&data, false)
    };
    let unit = file(1.0);
    let stored = store(unit.clone(), &role(Role::Normal), &portable());
    assert_eq!(stored.texture.levels, blocks(&unit));
    assert_eq!(stored.swizzle[..2], [Swizzle::Red, Swizzle::Green]);
    let angle = stored.texture.report.normal_angle_deg.expect("angles");
    assert!(angle.p99 > 0.0 && angle.p99 < 2.0, "{angle:?}");
    // Levels that are made lie in the same channels.
    let mut lacking = unit.clone();
    lacking.smaller.clear();
    lacking.universal.as_mut().unwrap().levels.truncate(1);
    let made = store(lacking, &role(Role::Normal), &portable()).texture;
    for level in 1..5 {
        let psnr = made.report.level_psnr_db[level as usize];
        assert!(psnr > 35.0, "level {level}: {psnr} dB");
        let texels = unpacked(&made.levels[level as usize], level, false);
        let expected = unpacked(&blocks(&unit)[level as usize], level, false);
        for ([x, y, ..], [wanted_x, wanted_y, ..]) in texels.iter().zip(&expected) {
            assert!(x.abs_diff(*wanted_x).max(y.abs_diff(*wanted_y)) < 16 * 257);
        }
    }
    let short = store(file(0.6), &role(Role::Normal), &portable());
    assert_eq!(short.texture.report.altered_levels, [Altered::NotUnit]);
    assert_eq!(short.swizzle[..2], [Swizzle::Red, Swizzle::Alpha]);
}

#[test]
fn normals_of_two_channels_pass_in_red_and_alpha() {
    let normal = wanted(Role::Normal, 7, AlphaUse::Ignore);
    let image = source(&store(image(normals(1.0)), &normal, &portable()), true);
    let expected = blocks(&image);
    let stored = store(image.clone(), &normal, &portable());
    assert_eq!(stored.texture.levels, expected);
    let read = [Swizzle::Red, Swizzle::Alpha, Swizzle::Zero, Swizzle::One];
    assert_eq!(stored.swizzle, read);
    let angle = stored.texture.report.normal_angle_deg.expect("angles");
    assert!(angle.max < 0.01, "{angle:?}");
    // As colour, the two channels are no grey.
    let stored = store(
        image,
        &wanted(Role::Color, 7, AlphaUse::Ignore),
        &portable(),
    );
    assert_ne!(stored.texture.report.codec, Codec::Passed);
}

#[test]
fn data_passes_in_the_channels_of_the_file() {
    let [zero, one] = [Swizzle::Zero, Swizzle::One];
    let data = |x: f32, y: f32| [x, 0.2 + 0.5 * y, 0.0, 1.0];
    let all = wanted(Role::Data, 15, AlphaUse::Value);
    let rgb = source(&store(image(color), &all, &portable()), false);
    let stored = store(
        rgb.clone(),
        &wanted(Role::Data, 6, AlphaUse::Ignore),
        &portable(),
    );
    assert_eq!(stored.texture.levels, blocks(&rgb));
    assert_eq!(stored.swizzle, IDENTITY_SWIZZLE);
    let pair = store(
        image(data),
        &wanted(Role::Data, 3, AlphaUse::Ignore),
        &portable(),
    );
    assert_eq!(pair.role, Role::Pair);
    let pair = source(&pair, true);
    let stored = store(
        pair.clone(),
        &wanted(Role::Data, 6, AlphaUse::Ignore),
        &portable(),
    );
    assert_eq!(stored.texture.levels, blocks(&pair));
    assert_eq!(stored.swizzle[1..3], [Swizzle::Alpha, zero]);
    assert_eq!(stored.texture.report.codec, Codec::Passed);
    // What is one value, or shares an image, is made anew.
    let flat = store(
        rgb.clone(),
        &wanted(Role::Data, 0, AlphaUse::Ignore),
        &portable(),
    );
    assert_eq!(flat.texture.report.altered_levels, [Altered::Constant]);
    let alone = |image: &DecodedImage| DecodedImage {
        smaller: Vec::new(),
        ..image.clone()
    };
    let both = [&alone(&rgb), &alone(&pair)];
    let roughness = wanted(Role::Data, 6, AlphaUse::Ignore);
    let packed = store_companions(both, &roughness, &portable()).expect("a pair");
    assert_eq!(packed.texture.report.altered_levels, [Altered::Packed]);
    assert_eq!(packed.swizzle[3], one);
}

#[test]
fn desktop_transcodes_where_that_reaches_the_target() {
    let image = color_source();
    let stored = |centibel| {
        let options = EncodeOptions {
            effort: crate::encode::Effort::AtLeast { centibel },
            ..EncodeOptions::default()
        };
        let wanted = wanted(Role::Color, 15, AlphaUse::Value);
        store(image.clone(), &wanted, &options).texture.report
    };
    let loose = stored(4000);
    assert_eq!((loose.codec, loose.missed_db), (Codec::Transcoded, None));
    assert!(loose.psnr_db >= 40.0 && loose.psnr_db.is_finite());
    let strict = stored(9000);
    assert!(matches!(strict.codec, Codec::Bc7 { .. }));
    assert!(strict.missed_db.is_some() && strict.altered_levels.is_empty());
    let preset = store(
        image.clone(),
        &wanted(Role::Color, 15, AlphaUse::Value),
        &EncodeOptions::default(),
    );
    assert!(matches!(preset.texture.report.codec, Codec::Bc7 { .. }));
}
