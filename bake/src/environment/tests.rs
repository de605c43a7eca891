//! Whole-stage tests of the environment bake against its contracts.

use std::f64::consts::PI;
use std::path::Path;

use glam::DVec3;

use super::cubemap::{energy, texel_at, texel_direction, to_f64};
use super::*;

fn small_options() -> EnvironmentOptions {
    EnvironmentOptions {
        prefiltered_size: 64,
        irradiance_size: 8,
        probes: 6,
        sun: SunMode::Keep,
        error: 2e-4,
        ..EnvironmentOptions::default()
    }
}

fn bake(input: &Equirect, options: &EnvironmentOptions) -> EnvironmentProducts {
    bake_environment(input.clone(), options, &|_, _| {})
}

fn map(width: u32, height: u32, radiance: impl Fn(DVec3) -> [f32; 3]) -> Equirect {
    let texels = (0..width * height)
        .map(|index| {
            let u = (f64::from(index % width) + 0.5) / f64::from(width);
            let polar = (f64::from(index / width) + 0.5) / f64::from(height) * PI;
            let longitude = (u - 0.5) * 2.0 * PI;
            let radius = libm::sin(polar);
            radiance(DVec3::new(
                radius * libm::cos(longitude),
                libm::cos(polar),
                radius * libm::sin(longitude),
            ))
        })
        .collect();
    Equirect {
        width,
        height,
        texels,
    }
}

fn smooth(direction: DVec3) -> [f32; 3] {
    let DVec3 { x, y, z } = direction;
    [
        (2.0 + x + y * z) as f32,
        (1.5 + y * y * y - 0.3 * x) as f32,
        (1.0 + 0.9 * z * x) as f32,
    ]
}

fn all_levels(products: &EnvironmentProducts) -> impl Iterator<Item = &Vec<[f32; 3]>> {
    let cubes = [&products.sky, &products.irradiance, &products.prefiltered];
    cubes.into_iter().flat_map(|cube| cube.levels.iter())
}

/// Reports of cubes; nine coefficients differ from them by what they cannot hold.
fn integrals(products: &EnvironmentProducts) -> impl Iterator<Item = &StageReport> {
    let rows = products.reports.iter();
    rows.filter(|report| !report.name.starts_with("harmonics"))
}

fn error_of(products: &EnvironmentProducts, name: &str) -> f64 {
    let report = products.reports.iter().find(|report| report.name == name);
    report.and_then(|report| report.error).unwrap()
}

#[test]
fn constant_skies_are_reproduced_at_every_size() {
    for (width, height) in [(64, 32), (1, 1), (2, 1), (1, 7), (3, 5), (31, 17)] {
        for scale in [1.0_f32, 1e-6, 1e6] {
            let colour = [0.25 * scale, scale, 3.0 * scale];
            let products = bake(&map(width, height, |_| colour), &small_options());
            for texel in all_levels(&products).flatten() {
                for channel in 0..3 {
                    let ratio = texel[channel] * products.scale / colour[channel];
                    assert!((ratio - 1.0).abs() < 1e-5, "{width}x{height}: {ratio}");
                }
            }
        }
    }
}

#[test]
fn black_stays_black_and_sizes_are_as_documented() {
    let products = bake(&map(64, 32, |_| [0.0; 3]), &small_options());
    assert!(
        all_levels(&products)
            .flatten()
            .all(|texel| *texel == [0.0; 3])
    );
    assert_eq!(products.clamped_texels, 0);
    assert!(
        products
            .reports
            .iter()
            .all(|report| report.error == Some(0.0))
    );
    assert_eq!((products.sky.size, products.sky.levels.len()), (64, 7));
    assert_eq!(
        (products.irradiance.size, products.irradiance.levels.len()),
        (8, 1)
    );
    assert_eq!(products.prefiltered.levels.len(), 4);
    for cube in [&products.sky, &products.irradiance, &products.prefiltered] {
        for (level, texels) in cube.levels.iter().enumerate() {
            let size = cube.level_size(level) as usize;
            assert_eq!(texels.len(), 6 * size * size);
        }
    }
    let options = EnvironmentOptions::default();
    let sizes = |width| {
        Sizes::new(
            &Equirect {
                width,
                height: 1,
                texels: Vec::new(),
            },
            &options,
        )
    };
    assert_eq!(
        [sizes(1024).sky, sizes(4096).sky, sizes(16_384).sky],
        [512, 2048, 2048]
    );
    assert_eq!(sizes(1024).prefiltered_levels, 6);
}

#[test]
fn products_match_the_reference_on_smooth_and_sunny_skies() {
    let sunny = |direction: DVec3| {
        if direction.dot(DVec3::new(0.5, 0.6, -0.62).normalize()) > 0.999 {
            [1e6, 9e5, 8e5]
        } else {
            [1e-2, 2e-2, 3e-2]
        }
    };
    let noise = |direction: DVec3| {
        let hash = libm::sin(direction.dot(DVec3::new(127.1, 311.7, 74.7))) * 43_758.545;
        [(hash - libm::floor(hash)) as f32 * 4.0, 0.5, 0.1]
    };
    let skies = [
        ("smooth", map(128, 64, smooth), 2e-3),
        ("sunny", map(128, 64, sunny), 5e-3),
        ("noise", map(128, 64, noise), 5e-3),
        ("odd", map(61, 43, noise), 5e-3),
    ];
    for (name, input, bound) in skies {
        let options = EnvironmentOptions {
            probes: 24,
            ..small_options()
        };
        let products = bake(&input, &options);
        for report in integrals(&products) {
            let error = report.error.unwrap();
            eprintln!("{name:7} {:12} {error:.2e} {}", report.name, report.metric);
            assert!(error < bound, "{name} {}: {error}", report.name);
        }
        assert!(error_of(&products, "sky") < 1e-4);
        assert!(error_of(&products, "irradiance") < 3e-4);
    }
}

#[test]
fn single_texel_suns_reach_every_product() {
    let (width, height) = (64_u32, 32_u32);
    for (column, row) in [(0, 16), (63, 16), (17, 0), (40, 31), (31, 9)] {
        let mut input = map(width, height, |_| [1e-2; 3]);
        input.texels[row * width as usize + column] = [1e6; 3];
        let products = bake(&input, &small_options());
        let exact = input.energy(&Rows::new(height)).x;
        for (level, texels) in products.sky.levels.iter().enumerate() {
            let sum = energy(texels, products.sky.level_size(level)).x * f64::from(products.scale);
            assert!(
                (sum / exact - 1.0).abs() < 1e-3,
                "level {level}: {sum} {exact}"
            );
        }
        assert_eq!((products.clamped_texels, products.scale), (0, 16.0));
        // In a polar row the map's texels are finer than the cube's, which places the sun only to
        // within a cube texel.
        let polar = row == 0 || row == height as usize - 1;
        let bound = if polar { 1e-2 } else { 5e-4 };
        assert!(error_of(&products, "irradiance") < bound);
        assert!(
            all_levels(&products)
                .flatten()
                .flatten()
                .all(|v| v.is_finite() && *v * products.scale >= 0.0098)
        );
    }
}

#[test]
fn quarter_turns_of_the_map_turn_the_products() {
    let (width, height) = (64_u32, 32_u32);
    let bright = |direction: DVec3| {
        let [r, g, b] = smooth(direction);
        [r + if direction.x > 0.97 { 50.0 } else { 0.0 }, g, b]
    };
    let input = map(width, height, bright);
    let mut turned = input.clone();
    for row in turned.texels.chunks_exact_mut(width as usize) {
        row.rotate_right(width as usize / 4);
    }
    let (first, second) = (
        bake(&input, &small_options()),
        bake(&turned, &small_options()),
    );
    for (a, b) in [
        (&first.sky, &second.sky),
        (&first.irradiance, &second.irradiance),
        (&first.prefiltered, &second.prefiltered),
    ] {
        for level in 0..a.levels.len() {
            let size = a.level_size(level);
            for (index, value) in a.levels[level].iter().enumerate() {
                let from = texel_direction(index, size);
                // A quarter turn of longitude takes +X to +Z and +Z to -X.
                let to = DVec3::new(-from.z, from.y, from.x);
                let other = to_f64(b.levels[level][texel_at(to, size)]);
                let error = (other - to_f64(*value)).length() / other.length();
                assert!(error < 1e-5, "level {level} texel {index}: {error}");
            }
        }
    }
}

#[test]
fn any_texel_shift_of_the_map_rotates_the_products() {
    let (width, height) = (96_u32, 48_u32);
    let input = map(width, height, smooth);
    let rows = Rows::new(height);
    for shift in [1_usize, 7, 41] {
        let mut turned = input.clone();
        for row in turned.texels.chunks_exact_mut(width as usize) {
            row.rotate_right(shift);
        }
        let products = bake(&turned, &small_options());
        let angle = 2.0 * PI * shift as f64 / f64::from(width);
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        let back = |n: DVec3| DVec3::new(cosine * n.x + sine * n.z, n.y, cosine * n.z - sine * n.x);
        let check = |texels: &[[f32; 3]], size: u32, alpha: Option<f64>| {
            let probes = verify::probe_texels(20, size);
            let normals: Vec<DVec3> = probes
                .iter()
                .map(|&index| back(texel_direction(index, size)))
                .collect();
            let kernel = alpha.map_or(Kernel::Cosine, Kernel::Lobe);
            let exact = Oracle::new(&input, &rows, 2e-4).integrals(&normals, kernel);
            let found = probes.iter().map(|&index| to_f64(texels[index]));
            let error = verify::relative_rms(found, &exact);
            assert!(error < small_options().error, "shift {shift}: {error}");
        };
        check(
            &products.irradiance.levels[0],
            products.irradiance.size,
            None,
        );
        let cube = &products.prefiltered;
        for level in 1..cube.levels.len() {
            let roughness = level_roughness(level, cube.levels.len());
            let alpha = Some(roughness * roughness);
            check(&cube.levels[level], cube.level_size(level), alpha);
        }
    }
}

/// Largest step between neighbouring texels within faces and across their edges.
fn steps(texels: &[[f32; 3]], size: u32) -> (f64, f64) {
    let side = size as usize;
    let (mut inside, mut across): (f64, f64) = (0.0, 0.0);
    for index in 0..texels.len() {
        let (face, x, y) = (index / (side * side), index % side, index / side % side);
        for (dx, dy) in [(1_i64, 0_i64), (0, 1), (-1, 0), (0, -1)] {
            let (nx, ny) = (x as i64 + dx, y as i64 + dy);
            let coordinate = |i: i64| (2.0 * i as f64 + 1.0) / f64::from(size) - 1.0;
            let limit = 1.0 + 1e-6;
            let (s, t) = (coordinate(nx), coordinate(ny));
            let leaves = s.abs() > 1.0 || t.abs() > 1.0;
            // Just beyond the edge, so the neighbour is the adjacent face's border texel.
            let (s, t) = (s.clamp(-limit, limit), t.clamp(-limit, limit));
            let neighbour = texel_at(DVec3::from(face_direction(face, s, t)), size);
            let step = (to_f64(texels[index]) - to_f64(texels[neighbour])).length();
            if leaves {
                assert_ne!(neighbour / (side * side), face);
                across = across.max(step);
            } else {
                inside = inside.max(step);
            }
        }
    }
    (inside, across)
}

#[test]
fn steps_across_cube_edges_are_no_larger_than_inside_faces() {
    let products = bake(&map(128, 64, smooth), &small_options());
    for cube in [&products.sky, &products.irradiance, &products.prefiltered] {
        for (level, texels) in cube.levels.iter().enumerate() {
            let size = cube.level_size(level);
            if size < 4 {
                continue;
            }
            let (inside, across) = steps(texels, size);
            assert!(across < 1.1 * inside, "size {size}: {across} > {inside}");
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let input = map(96, 40, smooth);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| bake(&input, &small_options()))
    };
    let (one, five) = (run(1), run(5));
    assert_eq!(one.sky, five.sky);
    assert_eq!(one.irradiance, five.irradiance);
    assert_eq!(one.prefiltered, five.prefiltered);
    for (a, b) in one.reports.iter().zip(&five.reports) {
        assert_eq!((&a.name, a.error), (&b.name, b.error));
    }
}

#[test]
fn park_panorama_meets_the_error_bounds() {
    let path = Path::new("/work/shared/assets/hdri/pmndrs-assets/park.hdr");
    if !path.exists() {
        eprintln!("SKIPPED: {} is absent", path.display());
        return;
    }
    let decoded = image::open(path).unwrap().into_rgb32f();
    let mut input = Equirect {
        width: decoded.width(),
        height: decoded.height(),
        texels: decoded.pixels().map(|pixel| pixel.0).collect(),
    };
    assert_eq!(input.sanitize(), 0);
    let products = bake(&input, &EnvironmentOptions::default());
    eprintln!(
        "{}x{}, sky {}",
        input.width, input.height, products.sky.size
    );
    for report in integrals(&products) {
        let error = report.error.unwrap();
        eprintln!(
            "{:12} {:7.3} s  {error:.2e} {} ({:.2} s to measure)",
            report.name, report.seconds, report.metric, report.verify_seconds
        );
        assert!(error < 2e-3, "{}: {error}", report.name);
    }
    assert!(error_of(&products, "sky") < 1e-5);
}
