//! Tests of whole encoded chains: shapes, colour, normals, coverage, error floors, determinism.

use cairn_format::texture::mip_extent;

use super::*;

/// A deterministic stream of numbers in [0,1).
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn image(width: u32, height: u32, texel: impl FnMut(u32, u32) -> [u8; 4]) -> Vec<[u16; 4]> {
    let mut texel = texel;
    (0..width * height)
        .map(|index| texel(index % width, index / width).map(|code| u16::from(code) * 257))
        .collect()
}

pub(super) fn source(width: u32, height: u32, texels: &[[u16; 4]]) -> Source<'_> {
    Source {
        width,
        height,
        texels,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Repeat,
        alpha: AlphaUse::Ignore,
    }
}

/// The texels of one level as a shader reads them, before any transfer function.
fn decode(texture: &EncodedTexture, level: u32) -> Vec<[f32; 4]> {
    let width = mip_extent(texture.width, level) as usize;
    let height = mip_extent(texture.height, level) as usize;
    let across = width.div_ceil(4);
    let blocks: Vec<bc::Block> = texture.levels[level as usize]
        .chunks_exact(16)
        .map(|bytes| bc::decode_block(texture.format, bytes))
        .collect();
    (0..width * height)
        .map(|index| {
            let (x, y) = (index % width, index / width);
            blocks[y / 4 * across + x / 4][y % 4 * 4 + x % 4]
        })
        .collect()
}

/// Gradients under noise of a few codes: hard for flat blocks, easy for the eye.
fn gradient(width: u32, height: u32) -> Vec<[u16; 4]> {
    let mut random = random(11);
    image(width, height, |x, y| {
        let (u, v) = (
            f64::from(x) / f64::from(width),
            f64::from(y) / f64::from(height),
        );
        [u, v, 0.5 + 0.5 * u * v, 1.0 - 0.5 * u]
            .map(|value| (value * 235.0 + random() * 12.0) as u8)
    })
}

/// A unit normal map of waves, 8-bit.
fn waves(width: u32, height: u32) -> Vec<[u16; 4]> {
    image(width, height, |x, y| {
        let dx = 0.6 * (f64::from(x) * 0.11).sin();
        let dy = 0.6 * (f64::from(y) * 0.07 + f64::from(x) * 0.02).cos();
        let length = (dx * dx + dy * dy + 1.0).sqrt();
        let [x, y, z] = [dx, dy, 1.0].map(|v| ((v / length * 0.5 + 0.5) * 255.0).round() as u8);
        [x, y, z, 255]
    })
}

#[test]
fn chains_have_every_level_at_its_size() {
    for (width, height) in [(1, 1), (1, 7), (9, 1), (5, 3), (4, 4), (17, 64), (33, 31)] {
        let texels = gradient(width, height);
        for role in [Role::Color, Role::Data, Role::Normal] {
            for alpha in [
                AlphaUse::Ignore,
                AlphaUse::Blend,
                AlphaUse::Mask { cutoff: 0.5 },
            ] {
                let source = Source {
                    alpha,
                    ..source(width, height, &texels)
                };
                let texture = encode(&source, role, &EncodeOptions::default());
                assert_eq!(texture.format, role.format(Target::Desktop));
                assert_eq!(texture.levels.len() as u32, full_mip_count(width, height));
                for (level, bytes) in (0..).zip(&texture.levels) {
                    let size = [width, height].map(|extent| mip_extent(extent, level));
                    assert_eq!(
                        bytes.len() as u64,
                        texture.format.level_bytes(size[0], size[1])
                    );
                }
                let report = &texture.report;
                assert_eq!(report.level_psnr_db.len(), texture.levels.len());
                assert!(
                    report.level_psnr_db.iter().all(|psnr| *psnr > 25.0),
                    "{report:?}"
                );
                assert!(report.p99_block_rmse.is_finite());
                let masked = alpha != AlphaUse::Ignore && alpha != AlphaUse::Blend;
                let deltas = report.alpha_coverage_delta.len();
                let expected = masked && role != Role::Normal;
                assert_eq!(deltas, if expected { texture.levels.len() } else { 0 });
            }
        }
    }
}

#[test]
fn checkerboard_averages_in_linear_light() {
    let texels = image(8, 8, |x, y| {
        if (x + y) % 2 == 0 {
            [255; 4]
        } else {
            [0, 0, 0, 255]
        }
    });
    for filter in [MipFilter::Box, MipFilter::Kaiser] {
        let options = EncodeOptions {
            filter,
            ..EncodeOptions::default()
        };
        for (role, expected) in [(Role::Color, 188.0), (Role::Data, 128.0)] {
            let texture = encode(&source(8, 8, &texels), role, &options);
            for level in 1..4 {
                for texel in decode(&texture, level) {
                    for value in &texel[..3] {
                        assert!((value * 255.0 - expected).abs() <= 1.0, "{role:?} {value}");
                    }
                    assert!(texel[3] >= 254.0 / 255.0);
                }
            }
        }
    }
}

#[test]
fn unused_alpha_is_stored_opaque() {
    let texels = gradient(12, 12);
    assert!(!is_opaque(&texels));
    let texture = encode(
        &source(12, 12, &texels),
        Role::Color,
        &EncodeOptions::default(),
    );
    for level in 0..4 {
        assert!(
            decode(&texture, level)
                .iter()
                .all(|texel| texel[3] >= 254.0 / 255.0)
        );
    }
}

#[test]
fn transparent_colour_does_not_bleed() {
    let texels = image(8, 8, |x, y| {
        if (x + y) % 2 == 0 {
            [200, 40, 0, 255]
        } else {
            [0, 255, 0, 0]
        }
    });
    let source = Source {
        alpha: AlphaUse::Blend,
        ..source(8, 8, &texels)
    };
    let texture = encode(&source, Role::Color, &EncodeOptions::default());
    for texel in decode(&texture, 1) {
        let codes = texel.map(|value| value * 255.0);
        for (code, expected) in codes.into_iter().zip([200.0, 40.0, 0.0, 128.0]) {
            assert!((code - expected).abs() <= 3.0, "{codes:?}");
        }
    }
}

#[test]
fn transparent_regions_keep_their_colour() {
    let texels = image(8, 8, |_, _| [10, 200, 90, 0]);
    let source = Source {
        alpha: AlphaUse::Blend,
        ..source(8, 8, &texels)
    };
    let texture = encode(&source, Role::Color, &EncodeOptions::default());
    for level in 0..4 {
        for texel in decode(&texture, level) {
            assert!((texel[1] * 255.0 - 200.0).abs() <= 2.0, "{texel:?}");
            assert_eq!(texel[3], 0.0);
        }
    }
}

#[test]
fn flat_normals_stay_flat() {
    let texels = image(20, 12, |_, _| [128, 128, 255, 255]);
    let texture = encode(
        &source(20, 12, &texels),
        Role::Normal,
        &EncodeOptions::default(),
    );
    for level in 0..texture.levels.len() as u32 {
        for texel in decode(&texture, level) {
            let (x, y) = (2.0 * texel[0] - 1.0, 2.0 * texel[1] - 1.0);
            let z = (1.0 - x * x - y * y).max(0.0).sqrt();
            assert!(f64::from(z).acos().to_degrees() < 0.35, "{texel:?}");
        }
    }
    let angle = texture.report.normal_angle_deg.expect("a normal map");
    assert!(angle.max < 0.35, "{angle:?}");
}

#[test]
fn zero_normals_point_up_and_opposite_ones_cancel() {
    // Left half: no direction at all. Right half: +x beside -x, whose mean has none either.
    let texels = image(16, 16, |x, _| match (x < 8, x % 2) {
        (true, _) => [128, 128, 128, 255],
        (false, 0) => [255, 128, 128, 255],
        (false, _) => [0, 128, 128, 255],
    });
    let texture = encode(
        &source(16, 16, &texels),
        Role::Normal,
        &EncodeOptions {
            filter: MipFilter::Box,
            ..EncodeOptions::default()
        },
    );
    for level in 1..5 {
        for texel in decode(&texture, level) {
            for value in &texel[..2] {
                assert!(
                    (value - 0.5).abs() <= 1.5 / 255.0,
                    "level {level}: {texel:?}"
                );
            }
        }
    }
    let lengths = &texture.report.normal_mean_length;
    assert!((lengths[0] - 1.0).abs() < 1e-5);
    assert!(lengths[1] < 0.51, "{lengths:?}");
}

#[test]
fn normal_error_is_bounded() {
    let texels = waves(128, 96);
    let texture = encode(
        &source(128, 96, &texels),
        Role::Normal,
        &EncodeOptions::default(),
    );
    let angle = texture.report.normal_angle_deg.expect("a normal map");
    assert!(
        angle.p50 < 0.5 && angle.p99 < 1.2 && angle.max < 2.0,
        "{angle:?}"
    );
    // The report against a direct evaluation.
    let worst = decode(&texture, 0)
        .iter()
        .zip(&texels)
        .map(|(stored, exact)| {
            let exact = glam::DVec3::from_array(std::array::from_fn(|c| {
                f64::from(exact[c]) / 65535.0 * 2.0 - 1.0
            }));
            let (x, y) = (
                f64::from(stored[0]) * 2.0 - 1.0,
                f64::from(stored[1]) * 2.0 - 1.0,
            );
            let z = (1.0 - x * x - y * y).max(0.0).sqrt();
            glam::DVec3::new(x, y, z).angle_between(exact).to_degrees()
        })
        .fold(0.0, f64::max);
    assert!((worst - angle.max).abs() < 1e-3, "{worst} {angle:?}");
}

#[test]
fn bc7_error_is_bounded_and_falls_with_quality() {
    let texels = gradient(256, 128);
    let psnr = |quality: Quality, role| {
        let options = EncodeOptions {
            effort: quality.into(),
            ..EncodeOptions::default()
        };
        encode(&source(256, 128, &texels), role, &options)
            .report
            .psnr_db
    };
    let qualities = [Quality::Fast, Quality::Default, Quality::Best];
    let [fast, default, best] = qualities.map(|quality| psnr(quality, Role::Color));
    assert!(default >= 38.0, "{default}");
    assert!(
        fast <= default && default <= best,
        "{fast} {default} {best}"
    );
    assert!((psnr(Quality::Default, Role::Data) - default).abs() < 1e-6);
}

#[test]
fn reported_error_is_that_of_the_blocks() {
    let texels = gradient(37, 22);
    let source = Source {
        alpha: AlphaUse::Blend,
        ..source(37, 22, &texels)
    };
    let texture = encode(&source, Role::Color, &EncodeOptions::default());
    let decoded = decode(&texture, 0);
    let (mut stored, mut linear) = (0.0, 0.0);
    for (value, exact) in decoded.iter().zip(&texels) {
        for channel in 0..4 {
            let exact = f64::from(exact[channel]) / 65535.0;
            stored += (f64::from(value[channel]) - exact).powi(2);
            if channel < 3 {
                let light = srgb::decode_f64(f64::from(value[channel]));
                linear += (light - srgb::decode_f64(exact)).powi(2);
            }
        }
    }
    let count = texels.len() as f64;
    let stored = -10.0 * (stored / (4.0 * count)).log10();
    let linear = -10.0 * (linear / (3.0 * count)).log10();
    let report = &texture.report;
    assert!(
        (report.psnr_db - stored).abs() < 1e-3,
        "{report:?} {stored}"
    );
    let reported = report.psnr_linear_light_db.expect("a colour texture");
    assert!((reported - linear).abs() < 1e-3, "{reported} {linear}");
}

/// Leaves: thin antialiased ellipses and single texels.
fn leaves(size: u32) -> Vec<[u16; 4]> {
    let mut random = random(5);
    let mut alpha = vec![0_u8; (size * size) as usize];
    for _ in 0..size * size / 64 {
        let (cx, cy) = (random() * f64::from(size), random() * f64::from(size));
        let (rx, ry) = (0.4 + 2.0 * random(), 0.4 + random());
        for y in 0..8_i64 {
            for x in 0..8_i64 {
                let (px, py) = (cx.floor() as i64 + x - 4, cy.floor() as i64 + y - 4);
                let (dx, dy) = ((px as f64 + 0.5 - cx) / rx, (py as f64 + 0.5 - cy) / ry);
                let value = ((1.5 - (dx * dx + dy * dy)).clamp(0.0, 1.0) * 255.0) as u8;
                let wrapped = |p: i64| p.rem_euclid(i64::from(size)) as usize;
                let index = wrapped(py) * size as usize + wrapped(px);
                alpha[index] = alpha[index].max(value);
            }
        }
    }
    for _ in 0..size * size / 40 {
        alpha[(random() * f64::from(size * size)) as usize] = 255;
    }
    image(size, size, |x, y| {
        [60, 140, 40, alpha[(y * size + x) as usize]]
    })
}

#[test]
fn masked_coverage_is_kept() {
    let size = 256;
    let texels = leaves(size);
    for cutoff in [0.25, 0.5, 0.8] {
        let source = Source {
            alpha: AlphaUse::Mask { cutoff },
            ..source(size, size, &texels)
        };
        let texture = encode(&source, Role::Color, &EncodeOptions::default());
        let deltas = &texture.report.alpha_coverage_delta;
        assert_eq!(deltas.len(), 9);
        for (level, delta) in deltas.iter().enumerate() {
            // One texel covers all or nothing.
            if mip_extent(size, level as u32) >= 2 {
                assert!(
                    delta.abs() <= 0.01,
                    "cutoff {cutoff}, level {level}: {deltas:?}"
                );
            }
        }
        // The reported figure is that of the decoded blocks.
        let alpha: Vec<u8> = decode(&texture, 3)
            .iter()
            .map(|texel| (texel[3] * 255.0).round() as u8)
            .collect();
        let grid = |size| coverage::Grid {
            width: size,
            height: size,
            wrap: [Wrap::Repeat; 2],
            cutoff,
        };
        let top: Vec<u8> = texels.iter().map(|texel| (texel[3] / 257) as u8).collect();
        let expected = grid(size / 8).coverage(&alpha) - grid(size).coverage(&top);
        assert!((deltas[3] - expected).abs() < 1e-12);
    }
}

#[test]
fn plain_alpha_loses_coverage() {
    let texels = leaves(128);
    let source = Source {
        alpha: AlphaUse::Mask { cutoff: 0.8 },
        ..source(128, 128, &texels)
    };
    let options = EncodeOptions {
        plain_alpha: true,
        ..EncodeOptions::default()
    };
    let deltas = encode(&source, Role::Color, &options)
        .report
        .alpha_coverage_delta;
    // All of it is gone.
    assert!(deltas[4] < -0.02, "{deltas:?}");
}

/// The cheapest preset that reaches the target is taken for the whole chain; where none does, the best, and it is said.
#[test]
fn targets_choose_presets() {
    let texels = gradient(64, 64);
    let report = |effort: Effort| {
        let options = EncodeOptions {
            effort,
            ..EncodeOptions::default()
        };
        encode(&source(64, 64, &texels), Role::Color, &options).report
    };
    let presets = Quality::ALL.map(|quality| report(quality.into()));
    for (at, preset) in presets.iter().enumerate() {
        assert_eq!(preset.missed_db, None);
        let centibel = (preset.psnr_db * 100.0) as u32;
        let found = report(Effort::AtLeast { centibel });
        assert_eq!(found.codec, preset.codec, "preset {at}");
        assert_eq!(found.level_psnr_db, preset.level_psnr_db);
        assert_eq!(found.missed_db, None);
    }
    let best = &presets[2];
    let found = report(Effort::AtLeast { centibel: 9000 });
    assert_eq!(found.codec, best.codec);
    assert!(
        found
            .missed_db
            .is_some_and(|missed| (90.0 - best.psnr_db - missed).abs() < 1e-9)
    );
}

/// Colour noise costs alpha its precision: what block compression moves across the cutoff is given back.
#[test]
fn coverage_is_that_of_the_decoded_blocks() {
    let size = 256;
    let mut random = random(23);
    let mut texels = leaves(size);
    for texel in &mut texels {
        for value in &mut texel[..3] {
            *value = (random() * 255.0) as u16 * 257;
        }
    }
    let source = Source {
        alpha: AlphaUse::Mask { cutoff: 0.7 },
        ..source(size, size, &texels)
    };
    let options = EncodeOptions {
        effort: Quality::Fast.into(),
        ..EncodeOptions::default()
    };
    let report = encode(&source, Role::Color, &options).report;
    let deltas = &report.alpha_coverage_delta;
    assert!(
        deltas[1..4].iter().all(|delta| delta.abs() < 0.001),
        "{deltas:?}"
    );
    // Scaled alpha is what the error is measured against.
    assert!(
        report.level_psnr_db[4..7].iter().all(|psnr| *psnr > 25.0),
        "{report:?}"
    );
}

/// Without the correction this pattern vanishes at the first halving.
#[test]
fn single_texel_leaves_do_not_vanish() {
    let texels = image(128, 128, |x, y| {
        [90, 120, 30, if x % 4 == 1 && y % 4 == 2 { 255 } else { 0 }]
    });
    let masked = Source {
        alpha: AlphaUse::Mask { cutoff: 0.5 },
        ..source(128, 128, &texels)
    };
    let texture = encode(&masked, Role::Color, &EncodeOptions::default());
    let delta = &texture.report.alpha_coverage_delta;
    // The 4x4 sample points lie symmetric about a lone texel, so that its coverage moves in steps of four.
    assert!(delta[1].abs() <= 1.0 / 64.0, "{delta:?}");
    let blend = Source {
        alpha: AlphaUse::Blend,
        ..masked
    };
    let plain = encode(&blend, Role::Color, &EncodeOptions::default());
    assert!(decode(&plain, 1).iter().all(|texel| texel[3] < 0.5));
    assert!(decode(&texture, 1).iter().any(|texel| texel[3] >= 0.5));
}

#[test]
fn bytes_and_figures_do_not_depend_on_threads() {
    let (width, height) = (150, 93);
    let colour = gradient(width, height);
    let normals = waves(width, height);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a thread pool");
        pool.install(|| {
            [
                (Role::Color, &colour, AlphaUse::Mask { cutoff: 0.7 }),
                (Role::Data, &colour, AlphaUse::Blend),
                (Role::Normal, &normals, AlphaUse::Ignore),
            ]
            .map(|(role, texels, alpha)| {
                let source = Source {
                    alpha,
                    ..source(width, height, texels)
                };
                let mut texture = encode(&source, role, &EncodeOptions::default());
                texture.report.seconds = 0.0;
                texture.report.megapixels_per_second = 0.0;
                texture
            })
        })
    };
    let one = run(1);
    assert!(one == run(4));
    assert!(one == run(3));
}

#[test]
fn constants_are_seen() {
    let mut texels = vec![[1, 2, 3, 65535]; 12];
    assert_eq!(
        constant_value(&source(4, 3, &texels)),
        Some([1, 2, 3, 65535])
    );
    assert!(is_opaque(&texels));
    texels[11][3] = 65534;
    assert_eq!(constant_value(&source(4, 3, &texels)), None);
    assert!(!is_opaque(&texels));
    assert_eq!(constant_value(&source(0, 0, &[])), None);
}

/// Prints throughput and error on real textures; they must be good, not only present.
#[test]
fn flight_helmet() {
    let folder = std::path::Path::new("/work/shared/assets/khronos/FlightHelmet");
    if !folder.is_dir() {
        eprintln!("SKIPPED: {} is absent", folder.display());
        return;
    }
    for (name, role, floor) in [
        ("LeatherPartsMat_BaseColor", Role::Color, 40.0),
        ("LeatherPartsMat_OcclusionRoughMetal", Role::Data, 38.0),
        ("LeatherPartsMat_Normal", Role::Normal, 38.0),
    ] {
        let path = folder.join(format!("FlightHelmet_Materials_{name}.png"));
        let decoded = image::open(&path)
            .expect("a PNG of the Khronos samples")
            .into_rgba16();
        let texels: &[[u16; 4]] = bytemuck::cast_slice(decoded.as_raw());
        let source = source(decoded.width(), decoded.height(), texels);
        for quality in [Quality::Fast, Quality::Default, Quality::Best] {
            for kernels in [Kernels::Reproducible, Kernels::Native] {
                let options = EncodeOptions {
                    effort: quality.into(),
                    kernels,
                    ..EncodeOptions::default()
                };
                let report = encode(&source, role, &options).report;
                eprintln!(
                    "{name} {quality:?} {kernels:?}: {:.2} Mpix/s, {:.2} dB, linear {:.2?}, p99 {:.2}, {:.3?}, mips {:.1?}",
                    report.megapixels_per_second,
                    report.psnr_db,
                    report.psnr_linear_light_db,
                    report.p99_block_rmse,
                    report.normal_angle_deg,
                    report.level_psnr_db,
                );
                if quality != Quality::Fast {
                    assert!(report.psnr_db > floor, "{name}: {}", report.psnr_db);
                }
                if role == Role::Normal {
                    break;
                }
            }
        }
    }
}
