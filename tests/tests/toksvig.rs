//! Lost normal length as roughness, from the bake to the picture.

use cairn_bake::{Options, Silent, Summary};
use cairn_format::{Package, TextureFormat};
use cairn_player::gpu::GpuOptions;
use cairn_player::headless::{HeadlessOptions, render};
use cairn_player::settings::{AoSettings, ContactSettings, Settings, ShadowSettings};
use cairn_tests::{camera, options, require_vulkan};

/// Pixels of a side of the small picture; spheres are six wide.
const SIZE: usize = 128;
/// Pixels of the large picture for each of those.
const FACTOR: usize = 8;
/// Rows of the small picture that the four rows of spheres take, from the first on.
const FIRST: usize = 48;
const ROW: usize = 8;

fn baked(toksvig: bool, threads: usize) -> (Vec<u8>, Summary) {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    let options = Options {
        textures: cairn_bake::encode::EncodeOptions {
            toksvig,
            ..Default::default()
        },
        ..options("bumps/bumps.gltf", Some("hall/sky.hdr"), &output)
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool");
    let summary = pool
        .install(|| cairn_bake::bake(&options, &Silent))
        .expect("a bake");
    (std::fs::read(output).expect("the package"), summary)
}

#[test]
fn widened_roughness_is_stored_and_reported() {
    let (plain, _) = baked(false, 2);
    let (bytes, summary) = baked(true, 1);
    assert!(bytes == baked(true, 3).0, "1 and 3 threads differ");
    let [plain, widened] = [plain, bytes].map(|bytes| Package::from_bytes(&bytes).expect("good"));
    let names = |package: &Package| -> Vec<String> {
        let images = package.scene().images.iter();
        images.map(|image| image.name.to_string()).collect()
    };
    assert!(
        !names(&plain)
            .iter()
            .any(|name| name.starts_with("roughness of"))
    );
    // Of the hammered and the scratched map in four roughnesses each, and of the coats and what lies under them.
    let own: Vec<String> = names(&widened)
        .into_iter()
        .filter(|name| name.starts_with("roughness of"))
        .collect();
    assert_eq!(own.len(), 8 + 1, "{own:?}");
    for image in widened.scene().images.iter() {
        if image.name.starts_with("roughness of") {
            assert_eq!(image.format.native(), TextureFormat::Bc4Unorm);
            assert_eq!(image.levels.len(), 9);
        }
    }
    for (before, after) in [(&plain, &widened)].map(|(a, b)| (a.materials(), b.materials())) {
        let (before, after) = (before.expect("materials"), after.expect("materials"));
        for (before, after) in before.iter().zip(after) {
            assert!(before.roughness_factor < 1.0 && after.roughness_factor == 1.0);
        }
    }
    let settings = &widened.scene().provenance.settings;
    assert!(
        settings
            .iter()
            .any(|one| one.name == "toksvig" && one.value == "on")
    );
    let rows = |metric: &str| -> Vec<f64> {
        let rows = summary.report.iter();
        rows.filter(|row| row.stage == "toksvig" && row.metric == metric)
            .map(|row| row.error)
            .collect()
    };
    let [rises, after, before] = [
        "roughness rise, mip 4",
        "lobe error, mip 4",
        "lobe error if not widened, mip 4",
    ]
    .map(rows);
    assert!(
        rises.len() > 8 && rises.iter().all(|rise| *rise > 0.0),
        "{rises:?}"
    );
    for (after, before) in after.iter().zip(&before) {
        assert!(*after < before + 0.01, "{after} {before}");
    }
    let sum = |all: &[f64]| all.iter().sum::<f64>();
    assert!(sum(&after) < 0.7 * sum(&before), "{after:?} {before:?}");
}

/// Linear radiance of `side` x `side` pixels.
fn radiance(bytes: &[u8], side: usize) -> Vec<[f32; 4]> {
    let package = Package::from_bytes(bytes).expect("a good package");
    let options = HeadlessOptions {
        size: [side as u32; 2],
        camera: camera(&package, "far"),
        settings: Settings {
            shadow: ShadowSettings {
                enabled: false,
                ..Default::default()
            },
            ao: AoSettings {
                enabled: false,
                ..Default::default()
            },
            contact: ContactSettings {
                enabled: false,
                ..Default::default()
            },
            ..Settings::default()
        },
        frames: 1,
        hdr: true,
        gpu: GpuOptions {
            validation: true,
            ..GpuOptions::default()
        },
    };
    let image = render(&package, &options).expect("a picture");
    assert_eq!(image.validation, Vec::<String>::new());
    image.hdr.expect("radiance")
}

/// What a picture of eight times the pixels, which hardly reads a mip, shows in each of this one's.
fn reduced(large: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let texel = |index: usize| {
        let (x, y) = (index % SIZE * FACTOR, index / SIZE * FACTOR);
        let mut sum = [0.0; 4];
        for row in y..y + FACTOR {
            for texel in &large[row * SIZE * FACTOR + x..][..FACTOR] {
                (0..4).for_each(|channel| sum[channel] += texel[channel]);
            }
        }
        sum.map(|sum| sum / (FACTOR * FACTOR) as f32)
    };
    (0..SIZE * SIZE).map(texel).collect()
}

/// Root mean square difference of each row of spheres.
fn errors(picture: &[[f32; 4]], truth: &[[f32; 4]]) -> [f64; 4] {
    [0, 1, 2, 3].map(|row| {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in FIRST + row * ROW..FIRST + (row + 1) * ROW {
            for x in FIRST..FIRST + 4 * ROW {
                for (a, b) in picture[y * SIZE + x][..3].iter().zip(&truth[y * SIZE + x]) {
                    sum += f64::from(a - b).powi(2);
                    count += 1.0;
                }
            }
        }
        (sum / count).sqrt()
    })
}

#[test]
fn far_bumps_look_like_the_mean_of_near_ones() {
    if !require_vulkan("far_bumps_look_like_the_mean_of_near_ones") {
        return;
    }
    let (plain, widened) = (baked(false, 2).0, baked(true, 2).0);
    let truth = reduced(&radiance(&plain, SIZE * FACTOR));
    let plain = errors(&radiance(&plain, SIZE), &truth);
    let widened = errors(&radiance(&widened, SIZE), &truth);
    eprintln!(
        "hammered, scratched, lacquer, coats: {plain:.3?} as filtered, {widened:.3?} widened"
    );
    let sum = |rows: [f64; 4]| rows.iter().map(|row| row * row).sum::<f64>().sqrt();
    assert!(sum(widened) < 0.9 * sum(plain));
    // Hammered metal and coats gain most, and nothing is lost.
    assert!(widened[0] < 0.9 * plain[0] && widened[3] < 0.75 * plain[3]);
    assert!((0..4).all(|row| widened[row] < plain[row] + 0.01));
}
